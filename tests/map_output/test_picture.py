# SPDX-License-Identifier: Apache-2.0
"""The picture of the map."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop.map_output.colours import (
    CLOSURE_COLOUR,
    INK,
    LIGHT,
    PLACE_COLOURS,
    TRAJECTORY_COLOUR,
)
from cartoloop.map_output.occupancy_map import OccupancyMap
from cartoloop.map_output.picture import MapPicture, draw_map, nice_length
from cartoloop.quality.verdict import Kind, Place, Severity


def room(rows=60, cols=100, resolution=0.05):
    """Free floor in the lower half with a wall above it, unknown beyond."""
    probability = np.full((rows, cols), -1.0, dtype=np.float32)
    probability[5 : rows // 2, 5:-5] = 0.05
    probability[rows // 2 : rows // 2 + 2, 5:-5] = 0.95
    return OccupancyMap(probability, 10.0, 20.0, resolution)


def nearness(picture, colour):
    return np.abs(np.asarray(picture).astype(int) - colour).max(axis=2)


def test_floor_is_white_walls_dark_and_unknown_background():
    pixels = np.asarray(draw_map(room()))

    zoom = 8
    left = (pixels.shape[1] - 100 * zoom) // 2
    column = pixels[40 : 40 + 60 * zoom, left + 50 * zoom]
    assert tuple(column[5 * zoom]) == LIGHT.ground
    assert column[29 * zoom].max() < 60
    assert tuple(column[45 * zoom]) == (255, 255, 255)


def test_layers_are_drawn_only_if_given():
    path = np.array([[10.5, 20.5, 0.0], [14.0, 20.5, 0.0]])
    closures = np.array([[11.0, 21.0, 13.0, 21.0]])

    bare = draw_map(room())
    full = draw_map(room(), trajectory=path, closures=closures)

    assert nearness(bare, TRAJECTORY_COLOUR).min() > 60
    assert nearness(bare, CLOSURE_COLOUR).min() > 60
    assert nearness(full, TRAJECTORY_COLOUR).min() < 5
    assert nearness(full, CLOSURE_COLOUR).min() < 5


def test_the_trajectory_lies_where_the_map_says():
    picture = draw_map(room(), trajectory=np.array([[11.0, 20.5], [14.0, 20.5]]))

    zoom = 8
    left = (picture.width - 100 * zoom) // 2
    red, _, blue = np.moveaxis(np.asarray(picture)[: 40 + 60 * zoom].astype(int), 2, 0)
    rows, cols = np.nonzero(blue - red > 60)
    assert rows.mean() == pytest.approx(40 + (60 - 0.5 / 0.05) * zoom, abs=2)
    assert cols.min() == pytest.approx(left + 1.0 / 0.05 * zoom, abs=3)
    assert cols.max() == pytest.approx(left + 4.0 / 0.05 * zoom, abs=3)


def test_doubtful_and_wrong_places_are_circles_around_them():
    def place(x, severity):
        return Place(x, 20.7, 0.5, 1.0, 2.0, Kind.GAP, severity, "a gap", "")

    picture = MapPicture(room())
    places = [place(11.0, Severity.DOUBTFUL), place(12.5, Severity.WRONG)]
    picture.draw(trajectory=None, closures=None, places=[*places, place(14.0, Severity.MINOR)])

    for severity, x in ((Severity.DOUBTFUL, 11.0), (Severity.WRONG, 12.5)):
        rows, cols = np.nonzero(nearness(picture.canvas, PLACE_COLOURS[severity]) < 40)
        on_map = (rows > 40 + (60 - 14) * 8) & (rows < 40 + 60 * 8)  # the half without its number
        left = (picture.canvas.width - 100 * 8) // 2
        ring = (cols[on_map] - left) / 8 * 0.05 + 10.0
        assert ring.min() == pytest.approx(x - 0.5, abs=0.05)
        assert np.median(ring) == pytest.approx(x, abs=0.2)
    bare = MapPicture(room())
    bare.draw(trajectory=None, closures=None, places=[place(14.0, Severity.MINOR)])
    assert bare.canvas.tobytes() == draw_map(room()).tobytes()


@pytest.mark.parametrize("shape", [(1, 1), (1, 700), (4500, 30), (30, 9000)])
def test_maps_of_any_size_become_pictures_of_handy_size(shape):
    probability = np.full(shape, 0.05, dtype=np.float32)

    picture = draw_map(
        OccupancyMap(probability, 0.0, 0.0, 0.05),
        trajectory=np.zeros((1, 3)),
        closures=np.zeros((0, 4)),
    )

    assert picture.mode == "RGB"
    assert 400 <= max(picture.size) <= 4200


def test_a_caption_stands_above_the_map_and_is_broken():
    bare = np.asarray(draw_map(room()))
    parts = ["a recording", "extent 4.0 m × 1.0 m", "floor area 4.0 m²", *6 * ["more of it"]]

    full = np.asarray(draw_map(room(), caption=parts))

    added = len(full) - len(bare)
    assert added > 2 * 28  # several lines, as the picture is narrow
    assert np.array_equal(full[40 + added :], bare[40:])  # the rest is as it was
    rows, cols = np.nonzero(nearness(full[: 40 + added], INK) < 5)
    assert cols.min() >= 40 and cols.max() <= full.shape[1] - 40
    assert rows.min() >= 40 and rows.max() < 40 + added


def test_numbers_of_places_are_on_discs_of_their_colour():
    picture = MapPicture(room())
    place = Place(12.0, 20.7, 0.5, 1.0, 2.0, Kind.GAP, Severity.DOUBTFUL, "a gap", "")
    picture.draw(trajectory=None, closures=None, places=[place])

    disc = nearness(picture.canvas, PLACE_COLOURS[Severity.DOUBTFUL]) < 5
    pixels, bare = np.asarray(picture.canvas), np.asarray(draw_map(room()))
    black = (pixels.max(axis=2) < 40) & (bare[: len(pixels)].max(axis=2) > 200)
    black[-64:] = False  # the legend
    rows, cols = np.nonzero(black)
    assert len(rows) > 15
    around = disc[rows.min() - 6 : rows.max() + 7, cols.min() - 6 : cols.max() + 7]
    assert around.mean() > 0.4


def test_the_same_map_yields_the_same_picture():
    path = np.random.default_rng(0).uniform((10.5, 20.5), (14.0, 22.5), (50, 2))

    assert (
        draw_map(room(), trajectory=path).tobytes() == draw_map(room(), trajectory=path).tobytes()
    )


@pytest.mark.parametrize(
    ("limit", "length"),
    [(1, 1), (1.99, 1), (2, 2), (4.9, 2), (7, 5), (35, 20), (0.3, 0.2), (1e3, 1e3)],
)
def test_scale_bars_have_nice_lengths(limit, length):
    assert nice_length(limit) == pytest.approx(length)


def test_a_path_ends_where_positions_are_missing():
    occupancy_map = OccupancyMap(np.full((80, 80), 0.1, np.float32), 0.0, 0.0, 0.05)
    there, end = [(0.5, 1.0), (1.0, 1.0)], [(np.nan, np.nan)]
    back = [(2.5, 1.0), (3.0, 1.0)]
    broken = draw_map(occupancy_map, trajectory=np.array([*there, *end, *back]))
    whole = draw_map(occupancy_map, trajectory=np.array([*there, *back]))
    halves = [draw_map(occupancy_map, trajectory=np.array(part)) for part in (there, back)]
    bare = np.array(draw_map(occupancy_map, trajectory=np.zeros((0, 2))))
    drawn, *parts = (np.any(np.array(each) != bare, axis=2) for each in (broken, *halves))
    assert np.array_equal(drawn, parts[0] | parts[1])
    assert np.any(np.array(whole) != np.array(broken))
