# SPDX-License-Identifier: Apache-2.0
"""Lines measured in a map against the tape: table I."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.config import Config, SubmapConfig
from cartoloop.errors import ConfigError, InputError
from cartoloop.evaluation.lines import Lines, measure_lines, read_lines
from cartoloop.evaluation.map_image import read_map
from cartoloop.map_output.map_files import pgm_bytes, yaml_text
from cartoloop.map_output.occupancy_map import compose_map
from cartoloop.sensor.pose import Pose, transform_points
from cartoloop.simulation.lidar import Lidar, true_ranges
from cartoloop.submaps.submap import ActiveSubmaps
from tests.evaluation.drawn_map import FREE, RESOLUTION, UNMOVED, draw_wall, room


def lines_of(*rows):
    table = np.array([(*row, math.nan)[:5] for row in rows], dtype=float)
    places = tuple(f"lines.txt:{number}" for number in range(1, len(rows) + 1))
    return Lines(table[:, :4], table[:, 4], places)


def test_measures_face_to_face_whatever_the_ends_given():
    image = room(4.03, 3.03)

    error = measure_lines(
        image,
        lines_of((3.1, 5.0, 6.8, 5.0, 4.03), (3.4, 5.3, 7.4, 5.3, 4.03), (5, 3.8, 5, 6.2, 3.0)),
    )

    assert [line.length for line in error.lines] == pytest.approx([4.05, 4.05, 3.05], abs=0.01)
    assert error.lines[0].walls[0] == pytest.approx((2.975, 5.0), abs=0.005)
    assert error.errors == pytest.approx([0.02, 0.02, 0.05], abs=0.01)
    assert error.lines[2].relative_error == pytest.approx(error.errors[2] / 3.0)
    assert error.lines[2].error_pixels_per_end(error.resolution) == pytest.approx(0.5, abs=0.1)
    assert error.mean_absolute_error == pytest.approx(0.03, abs=0.01)
    assert error.num_within_a_pixel == 3


def test_a_wrong_tape_is_no_pixel_away():
    error = measure_lines(room(4.0, 3.0), lines_of((3, 5, 7, 5, 4.0), (3, 5, 7, 5, 4.3)))

    assert error.num_within_a_pixel == 1
    assert error.lines[1].error < -0.2
    assert error.lines[1].relative_error < -0.05


def test_rounding_does_not_decide_what_is_within_a_pixel():
    image = room(4.03, 3.03)  # 4.05 m in pixels

    error = measure_lines(image, lines_of((3, 5, 7, 5, 3.949999), (3, 5, 7, 5, 3.949)))

    assert error.errors == pytest.approx([0.100001, 0.101], abs=1e-5)
    assert error.num_within_a_pixel == 1


@settings(max_examples=60, deadline=None)
@given(
    width=st.floats(1.5, 6.0),
    depth=st.floats(1.5, 6.0),
    centre=st.tuples(st.floats(4.9, 5.1), st.floats(4.9, 5.1)),
    angle=st.one_of(st.sampled_from([0.0, math.pi / 4, math.pi / 2]), st.floats(-3.2, 3.2)),
    thickness=st.sampled_from([1, 2]),
    origin=st.builds(Pose, st.floats(-20, 20), st.floats(-20, 20), st.floats(-3, 3)),
    off=st.tuples(st.floats(-0.35, 0.35), st.floats(-0.35, 0.35)),
    turned_deg=st.floats(-1.0, 1.0),
    aside=st.floats(-0.4, 0.4),
)
def test_a_drawn_room_is_measured_to_a_pixel_at_each_end(
    width, depth, centre, angle, thickness, origin, off, turned_deg, aside
):
    image = room(width, depth, centre, angle, thickness=thickness, origin=origin)
    direction = angle + math.radians(turned_deg)
    along = np.array((math.cos(direction), math.sin(direction)))
    middle = centre + aside * np.array((-math.sin(angle), math.cos(angle)))
    start, end = middle - (width / 2 + off[0]) * along, middle + (width / 2 + off[1]) * along
    ends = transform_points(origin, np.array((start, end))).ravel()

    error = measure_lines(image, lines_of((*ends, width)))

    assert len(error.errors) == 1
    assert abs(error.lines[0].error) <= 2 * RESOLUTION
    assert error.num_within_a_pixel == 1


def test_does_not_depend_on_the_direction_of_the_line():
    image = room(4.03, 3.0, angle=0.3)

    there, back = measure_lines(image, lines_of((3.2, 4.4, 6.8, 5.6), (6.8, 5.6, 3.2, 4.4))).lines

    assert there.length == pytest.approx(back.length, abs=0.005)
    assert there.walls[0] == pytest.approx(back.walls[1], abs=0.005)


def test_a_missing_wall_is_flagged_and_does_not_count():
    image = room(4.0, 3.0)
    image.occupancy[90:110, 130:] = FREE  # a door of 1 m in the right wall

    error = measure_lines(image, lines_of((3, 5, 7, 5, 4.0), (3, 4.2, 7, 4.2, 4.0)))

    through_the_door, beside_it = error.lines
    assert through_the_door.walls[0] is not None
    assert through_the_door.walls[1] is None
    assert through_the_door.length is None
    assert through_the_door.error is None
    assert beside_it.length == pytest.approx(4.0, abs=0.1)
    assert len(error.errors) == 1


def test_walls_farther_than_the_search_are_not_taken():
    image, lines = room(4.0, 3.0), lines_of((3.7, 5, 7, 5, 4.0))

    assert measure_lines(image, lines).lines[0].walls[0] is None
    assert measure_lines(image, lines, search=0.8).lines[0].length == pytest.approx(4.0, abs=0.1)


def test_short_lines_are_measured_from_their_middle():
    image = room(0.6, 3.0, centre=(5.02, 5.0))

    (line,) = measure_lines(image, lines_of((4.7, 5, 5.3, 5, 0.6))).lines

    assert line.length == pytest.approx(0.6, abs=0.1)


def test_furniture_farther_from_the_ends_is_not_in_the_way():
    image = room(4.0, 3.0)
    draw_wall(image, (5.9, 4.5), (5.9, 5.5))

    (line,) = measure_lines(image, lines_of((3, 5, 7, 5, 4.0))).lines

    assert line.length == pytest.approx(4.0, abs=0.1)


def test_without_the_tape_there_is_a_length_and_no_error():
    error = measure_lines(room(4.0, 3.0), lines_of((3, 5, 7, 5)))

    assert error.lines[0].length == pytest.approx(4.0, abs=0.1)
    assert error.lines[0].error is None
    assert error.lines[0].relative_error is None
    assert error.mean_absolute_error is None
    assert error.num_within_a_pixel == 0


def test_dictionaries_hold_all_and_are_json():
    image = room(4.0, 3.0)

    content = measure_lines(image, lines_of((3, 5, 7, 5, 4.0), (3, 5, 6, 5))).to_dict()

    assert json.loads(json.dumps(content, allow_nan=False)) == content
    assert content["num_lines"] == 2
    assert content["num_compared"] == 1
    first, second = content["lines"]
    assert first["tape"] == 4.0
    assert first["error"] == pytest.approx(first["map"] - 4.0)
    assert first["error_pixels_per_end"] == pytest.approx(first["error"] / 0.1)
    assert content["mean_absolute_error"] == abs(first["error"])
    assert second["walls"][1] is None
    assert second["tape"] is second["map"] is second["error"] is None


def test_lines_off_the_map_are_errors_with_their_place():
    with pytest.raises(
        InputError,
        match=r"lines\.txt:2: end 2 of the line, \(7, 15\), is off the map, 10 m by 10 m",
    ):
        measure_lines(room(4.0, 3.0), lines_of((3, 5, 7, 5), (3, 5, 7, 15)))


@pytest.mark.parametrize("search", [0.0, -1.0, math.nan, math.inf, 11.0])
def test_impossible_searches_are_refused(search):
    with pytest.raises(ConfigError, match="around the ends of lines; expected more than 0"):
        measure_lines(room(4.0, 3.0), lines_of((3, 5, 7, 5)), search)


def test_reads_lines_with_and_without_the_tape(tmp_path):
    path = tmp_path / "lines.txt"
    path.write_text("# x1 y1 x2 y2 length\n\n0 1.5 2 -3 4.09\n1 1 2 2  # the tape ran out\n")

    lines = read_lines(path)

    assert lines.ends.tolist() == [[0.0, 1.5, 2.0, -3.0], [1.0, 1.0, 2.0, 2.0]]
    assert lines.lengths[0] == 4.09
    assert math.isnan(lines.lengths[1])
    assert lines.places == (f"{path}:3", f"{path}:4")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("# nothing\n", ": is empty; expected lines of 'x1 y1 x2 y2 [length]'"),
        ("0 0 1 1\n0 0 1\n", ":2: expected 4 or 5 numbers 'x1 y1 x2 y2 [length]', found '0 0 1'"),
        ("0 0 1 1 2 3\n", ":1: expected 4 or 5 numbers"),
        ("0 0 1 one\n", ":1: expected 4 or 5 numbers"),
        ("0 0 1 nan\n", ":1: expected 4 or 5 numbers"),
        ("0 0 1 1 inf\n", ":1: expected 4 or 5 numbers"),
        ("1 2 1 2 3\n", ":1: both ends of the line are the same"),
        ("0 0 1 1 0\n", ":1: the length is 0; expected metres above 0"),
    ],
)
def test_files_without_lines_are_errors_of_one_line(tmp_path, text, message):
    path = tmp_path / "lines.txt"
    path.write_text(text)

    with pytest.raises(InputError) as caught:
        read_lines(path)

    assert str(caught.value).startswith(f"{path}{message}")
    assert "\n" not in str(caught.value)


def test_missing_files_and_images_are_no_lines(tmp_path):
    (tmp_path / "map.pgm").write_bytes(b"P5\n1 1\n255\n\xfe")

    with pytest.raises(InputError, match="cannot be read: No such file"):
        read_lines(tmp_path / "none.txt")
    with pytest.raises(InputError, match="is no text; expected lines of"):
        read_lines(tmp_path / "map.pgm")


def map_of_scans(folder, corners, tf_map_world, range_noise):
    """Write the map of a room with these corners, of scans at known poses; return it read back."""
    walls = np.hstack((corners, np.roll(corners, -1, axis=0)))
    lidar = Lidar(num_beams=720, angle_min=-math.pi, angle_increment=math.tau / 720)
    rng = np.random.default_rng(3)
    config = SubmapConfig(num_range_data=20)
    active = ActiveSubmaps(config)
    grids, poses = [], []
    for x, y in rng.uniform(-1.0, 1.0, (40, 2)):
        theta = rng.uniform(-math.pi, math.pi)
        (ranges,) = true_ranges(walls, np.array([[x, y, theta]]), lidar)
        ranges = ranges + rng.normal(0.0, range_noise, len(ranges))
        angles = theta + lidar.angle_min + lidar.angle_increment * np.arange(len(ranges))
        returns = np.array((x, y)) + ranges[:, np.newaxis] * np.column_stack(
            (np.cos(angles), np.sin(angles))
        )
        insertion = active.insert(Pose(x, y, theta), returns, np.empty((0, 2)))
        if insertion.finished:
            grids.append(insertion.finished.grid.finish())
            origin = np.array([insertion.finished.tf_local_submap[:2]])
            poses.append((*transform_points(tf_map_world, origin)[0], tf_map_world.theta))
    assert len(grids) >= 1
    occupancy_map = compose_map(grids, np.array(poses), config)
    options = Config().map_output
    (folder / "map.pgm").write_bytes(pgm_bytes(occupancy_map, options))
    (folder / "map.yaml").write_text(yaml_text(occupancy_map, options, "map.pgm"))
    return read_map(folder)


@pytest.mark.parametrize(
    "tf_map_world", [UNMOVED, Pose(0.0, 0.0, 0.4), Pose(0.013, -0.02, math.pi / 4)]
)
@pytest.mark.parametrize("range_noise", [0.0, 0.03])
def test_a_map_of_simulated_scans_is_as_long_as_its_room(tmp_path, tf_map_world, range_noise):
    # faces at places that are not on the grid
    left, right, low, high = -2.113, 3.229, -1.871, 2.014
    corners = np.array([(left, low), (right, low), (right, high), (left, high)])
    image = map_of_scans(tmp_path, corners, tf_map_world, range_noise)
    world = np.array([(left, 0.3), (right, 0.3), (0.7, low), (0.7, high)])
    ends = transform_points(tf_map_world, world).reshape(-1, 4)

    error = measure_lines(image, lines_of((*ends[0], right - left), (*ends[1], high - low)))

    assert len(error.errors) == 2
    assert np.abs(error.errors).max() <= 2 * image.resolution
    assert error.num_within_a_pixel == 2
