# SPDX-License-Identifier: Apache-2.0
"""Reading saved maps back."""

from __future__ import annotations

import math

import numpy as np
import pytest
from PIL import Image

from cartoloop.errors import InputError
from cartoloop.evaluation.map_image import UNKNOWN, read_map
from cartoloop.sensor.pose import Pose, transform_points
from tests.map_output.small_result import small_result

YAML = """\
image: {image}
mode: {mode}
resolution: 0.05
origin: [-1.0, 2.0, 0.0]
negate: {negate}
occupied_thresh: 0.65
free_thresh: 0.196
"""

# one row of pixels: occupied, unknown, free
SHADES = np.array([[0, 205, 254]], dtype=np.uint8)


def write_map(folder, pixels=SHADES, image="map.pgm", text=YAML, mode="trinary", negate=0):
    Image.fromarray(pixels).save(folder / image)
    path = folder / "map.yaml"
    path.write_text(text.format(image=image, mode=mode, negate=negate))
    return path


def kinds(map_image):
    """Return the first row as ROS's cell values: 100 occupied, 0 free, -1 neither."""
    row = map_image.occupancy[0]
    free = (row >= 0.0) & (row < map_image.free_thresh)
    return np.where(row > map_image.occupied_thresh, 100, np.where(free, 0, -1)).tolist()


def test_reads_what_the_mapper_writes(tmp_path):
    result = small_result()
    result.save(tmp_path)

    map_image = read_map(tmp_path)

    # row 10 of the submap is its wall, at y = 0.5 m; what is below 0.25 m is floor
    assert map_image.resolution == 0.05
    assert map_image.sample(np.array([[1.0, 0.5]]))[0] > map_image.occupied_thresh
    assert map_image.sample(np.array([[1.0, 0.2]]))[0] < map_image.free_thresh
    assert map_image.sample(np.array([[-0.2, 0.5]]))[0] == pytest.approx(1.0 - 205 / 255)


def test_a_folder_stands_for_its_map_yaml(tmp_path):
    path = write_map(tmp_path)

    assert np.array_equal(read_map(tmp_path).occupancy, read_map(path).occupancy)


@pytest.mark.parametrize("image", ["map.pgm", "map.png"])
@pytest.mark.parametrize("colours", [False, True])
def test_shades_differ_in_grey_and_in_colour(tmp_path, image, colours):
    pixels = np.repeat(SHADES[..., np.newaxis], 3, axis=2) if colours else SHADES

    map_image = read_map(write_map(tmp_path, pixels, "map.ppm" if colours else image))

    assert kinds(map_image) == [100, -1, 0]


def test_the_first_row_is_the_bottom(tmp_path):
    map_image = read_map(write_map(tmp_path, np.array([[0], [254]], dtype=np.uint8)))

    assert map_image.occupancy[0, 0] < map_image.free_thresh
    assert map_image.occupancy[1, 0] > map_image.occupied_thresh


def test_sixteen_bits_a_pixel_are_shades_too(tmp_path):
    pixels = (SHADES.astype(np.uint16)) * 257

    assert kinds(read_map(write_map(tmp_path, pixels, "map.png"))) == [100, -1, 0]


def test_negate_makes_bright_pixels_occupied(tmp_path):
    map_image = read_map(write_map(tmp_path, 255 - SHADES, negate=1))

    assert kinds(map_image) == [100, -1, 0]


def test_transparent_pixels_are_unknown_in_scale_mode(tmp_path):
    pixels = np.array([[(0, 0, 0, 255), (0, 0, 0, 0), (255, 255, 255, 255)]], dtype=np.uint8)

    map_image = read_map(write_map(tmp_path, pixels, "map.png", mode="scale"))

    assert map_image.occupancy.tolist() == [[1.0, UNKNOWN, 0.0]]


def test_transparency_is_a_channel_in_trinary_mode(tmp_path):
    pixels = np.array([[(0, 0, 0, 255), (0, 0, 0, 0)]], dtype=np.uint8)

    map_image = read_map(write_map(tmp_path, pixels, "map.png"))

    # the mean of four channels, as map_server takes it: 0.25 and 0 bright
    assert map_image.occupancy[0].tolist() == pytest.approx([0.75, 1.0])


def test_raw_pixels_are_percent(tmp_path):
    pixels = np.array([[0, 50, 100, 101, 255]], dtype=np.uint8)

    map_image = read_map(write_map(tmp_path, pixels, mode="raw"))

    assert map_image.occupancy[0].tolist() == pytest.approx([0.0, 0.5, 1.0, UNKNOWN, UNKNOWN])


def test_the_origin_is_the_pose_of_the_lower_left_corner(tmp_path):
    text = YAML.replace("[-1.0, 2.0, 0.0]", "[-1.0, 2.0, 0.5]")
    map_image = read_map(write_map(tmp_path, np.zeros((4, 8), np.uint8), text=text))
    pixels = np.array([(0.0, 0.0), (8.0, 4.0), (3.0, 1.5), (8.2, 1.0), (1.0, -0.2)])
    points = transform_points(Pose(-1.0, 2.0, 0.5), pixels * 0.05)

    assert map_image.to_pixels(points) == pytest.approx(pixels)
    assert map_image.holds(points[2:]).tolist() == [True, False, False]
    assert map_image.sample(points[2:]).tolist() == [1.0, UNKNOWN, UNKNOWN]


@pytest.mark.parametrize(
    "text",
    [
        "# a map\n---\n" + YAML,
        YAML.replace("{image}", '"{image}"  # beside it'),
        YAML.replace("[-1.0, 2.0, 0.0]", "\n- -1.0\n- 2.0\n- 0.0"),
        YAML.replace("[-1.0, 2.0, 0.0]", "\n  - -1.\n  - 2\n  - 0e0\n"),
        YAML.replace("mode: {mode}\n", ""),
        YAML.replace("{negate}", "false"),
    ],
)
def test_yaml_may_be_written_differently(tmp_path, text):
    map_image = read_map(write_map(tmp_path, text=text))

    assert map_image.origin == Pose(-1.0, 2.0, 0.0)
    assert kinds(map_image) == [100, -1, 0]


def test_the_image_may_have_an_absolute_path(tmp_path):
    (tmp_path / "elsewhere").mkdir()
    path = write_map(tmp_path)
    moved = (tmp_path / "map.pgm").rename(tmp_path / "elsewhere" / "floor.pgm")
    path.write_text(YAML.format(image=moved, mode="trinary", negate=0))

    assert kinds(read_map(path)) == [100, -1, 0]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("resolution: 0.05\n", "", "lacks resolution; a map_server YAML file has image"),
        ("negate: 0\nocc", "occ", "lacks negate"),
        ("resolution: 0.05", "resolution: fine", "resolution is 'fine'; expected a number"),
        ("resolution: 0.05", "resolution: nan", "resolution is 'nan'; expected a number"),
        ("resolution: 0.05", "resolution: [1]", "expected a number"),
        ("resolution: 0.05", "resolution: 0", "resolution is 0; expected metres a pixel"),
        ("resolution: 0.05", "resolution: 50", "resolution is 50; expected metres a pixel"),
        ("occupied_thresh: 0.65", "occupied_thresh: 65", "occupied_thresh 65; expected 0 to 1"),
        ("free_thresh: 0.196", "free_thresh: 0.9", "the first not above the second"),
        ("free_thresh: 0.196", "free_thresh: -1", "free_thresh is -1, occupied_thresh 0.65"),
        ("[-1.0, 2.0, 0.0]", "[-1.0, 2.0]", "expected [x, y, yaw]"),
        ("[-1.0, 2.0, 0.0]", "0.0", "expected [x, y, yaw]"),
        ("[-1.0, 2.0, 0.0]", "[-1.0, 2.0, north]", "origin is 'north'; expected a number"),
        ("negate: 0", "negate: maybe", "negate is 'maybe'; expected 0 or 1"),
        ("mode: trinary", "mode: binary", "mode is 'binary'; expected trinary, scale, raw"),
        ("image: map.pgm", "image:", "image is ''; expected the name of an image file"),
        ("image: map.pgm", "image: other.pgm", "other.pgm: no such image; "),
        ("mode: trinary", "trinary", "map.yaml:2: expected 'key: value', found 'trinary'"),
    ],
)
def test_impossible_values_are_errors_of_one_line(tmp_path, old, new, message):
    path = write_map(tmp_path)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))

    with pytest.raises(InputError) as caught:
        read_map(path)

    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"P5\n3 2\n255\nabc", b"no image at all"])
def test_broken_images_are_errors_of_one_line(tmp_path, content):
    path = write_map(tmp_path)
    (tmp_path / "map.pgm").write_bytes(content)

    with pytest.raises(InputError, match=r"map\.pgm: cannot be read as an image: ") as caught:
        read_map(path)

    assert "\n" not in str(caught.value)


def test_an_image_shorter_than_its_header_says_is_refused(tmp_path):
    path = write_map(tmp_path, np.zeros((50, 50), np.uint8))
    image = tmp_path / "map.pgm"
    image.write_bytes(image.read_bytes()[:-100])

    with pytest.raises(InputError, match="cannot be read as an image"):
        read_map(path)


def test_missing_files_are_errors(tmp_path):
    with pytest.raises(InputError, match=r"none\.yaml: cannot be read: No such file"):
        read_map(tmp_path / "none.yaml")
    with pytest.raises(InputError, match=r"holds no map\.yaml; give the YAML file"):
        read_map(tmp_path)


def test_the_image_itself_is_no_yaml(tmp_path):
    write_map(tmp_path, np.full((9, 9), 254, np.uint8))

    with pytest.raises(InputError, match="is no text; expected the YAML file of a map"):
        read_map(tmp_path / "map.pgm")


def test_a_turned_map_is_as_far_across_as_any(tmp_path):
    text = YAML.replace("[-1.0, 2.0, 0.0]", f"[0.0, 0.0, {math.pi / 2!r}]")
    map_image = read_map(write_map(tmp_path, np.zeros((4, 8), np.uint8), text=text))

    # 0.4 m wide and 0.2 m high, its x along the map's y
    assert map_image.holds(np.array([(-0.1, 0.3), (-0.3, 0.1)])).tolist() == [True, False]
