# SPDX-License-Identifier: Apache-2.0
"""Composition of submaps."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as st_numpy

from cartoloop.config import SubmapConfig
from cartoloop.errors import OutputError
from cartoloop.kernels.map_composition import NEUTRAL, add_submap, cell_evidence
from cartoloop.map_output.occupancy_map import UNKNOWN, compose_map
from cartoloop.submaps.finished_grid import FinishedGrid
from tests.reference.naive_map_composition import naive_add_submap, naive_cell_evidence

CONFIG = SubmapConfig()
LOG_ODDS = np.interp(np.arange(256), (1, NEUTRAL, 255), (-2.2, 0.0, 4.4)).astype(np.float32)
LOG_ODDS[0] = 0.0
FREE, OCCUPIED, RATHER_OCCUPIED = 1, 255, 191


def finished_grid(cells, origin_x=0.0, origin_y=0.0, resolution=CONFIG.resolution):
    return FinishedGrid(cells, origin_x, origin_y, resolution)


def wall_grid(offset_cells=0, size=80):
    """A free square with a wall one cell wide along y in its middle, centred on the frame."""
    cells = np.full((size, size), FREE, np.uint8)
    cells[:, size // 2 + offset_cells] = OCCUPIED
    start = -(size // 2) * CONFIG.resolution
    return finished_grid(cells, start, start)


def at(occupancy_map, x, y):
    col = math.floor((x - occupancy_map.origin_x) / occupancy_map.resolution)
    row = math.floor((y - occupancy_map.origin_y) / occupancy_map.resolution)
    return occupancy_map.probability[row, col]


@settings(max_examples=30, deadline=None)
@given(
    cells=st_numpy.arrays(np.uint8, st.tuples(st.integers(1, 8), st.integers(1, 8))),
    x=st.floats(-4, 10),
    y=st.floats(-4, 10),
    theta=st.floats(-math.pi, math.pi),
    scale=st.floats(0.5, 2.0),
)
def test_kernel_equals_the_naive_sum(cells, x, y, theta, scale):
    padded = np.pad(cells, 1)
    evidence = np.empty(padded.shape, np.float32)
    cell_evidence(padded, LOG_ODDS, evidence)
    cos, sin = scale * math.cos(theta), scale * math.sin(theta)
    affine = np.array([x, cos, -sin, y, sin, cos])
    assert np.array_equal(evidence, naive_cell_evidence(padded, LOG_ODDS))
    total, known = np.zeros((9, 11), np.float32), np.zeros((9, 11), np.bool_)
    naive_total, naive_known = total.copy(), known.copy()

    for _ in range(2):
        add_submap(padded, evidence, affine, np.array([0, 9, 0, 11]), total, known)
        naive_add_submap(padded, evidence, affine, naive_total, naive_known)

    assert np.array_equal(known, naive_known)
    assert total == pytest.approx(naive_total, abs=1e-5)


def test_a_submap_in_place_keeps_its_probabilities():
    cells = np.array([[1, 126, 0, 1], [1, 64, 1, 255]], np.uint8)
    half = CONFIG.resolution / 2

    occupancy_map = compose_map([finished_grid(cells, half, half)], np.zeros((1, 3)), CONFIG)

    inner = occupancy_map.probability[5:-5, 5:-5]
    assert inner.shape == (2, 4)
    assert (occupancy_map.origin_x, occupancy_map.origin_y) == pytest.approx((-0.25, -0.25))
    assert inner[0, 0] == pytest.approx(0.1)
    assert inner[0, 1] == pytest.approx(0.1 + 125 / 254 * 0.8)
    assert inner[0, 2] == UNKNOWN
    assert inner[0, 3] == inner[1, 2] == pytest.approx(0.5)  # beside a hit
    assert inner[1, 3] > 0.9  # hits weigh more than misses
    assert inner[1, 1] == pytest.approx(0.1 + 63 / 254 * 0.8)


def test_the_origin_is_the_lower_left_corner_and_rows_go_up():
    cells = np.full((3, 5), FREE, np.uint8)
    cells[2, 4] = OCCUPIED
    pose = np.array([[10.0, 20.0, 0.0]])

    occupancy_map = compose_map([finished_grid(cells, 0.025, 0.025)], pose, CONFIG)

    assert at(occupancy_map, 10.0 + 4.5 * 0.05, 20.0 + 2.5 * 0.05) > 0.9
    assert at(occupancy_map, 10.0 + 0.5 * 0.05, 20.0 + 0.5 * 0.05) == pytest.approx(0.1)
    pixel = occupancy_map.to_pixels(np.array([[10.0, 20.0]]))
    assert pixel == pytest.approx(np.array([[5.0, 3 + 5.0]]))


def test_a_quarter_turn_turns_the_map():
    cells = np.full((1, 4), FREE, np.uint8)
    cells[0, 3] = OCCUPIED
    pose = np.array([[0.0, 0.0, math.pi / 2]])

    occupancy_map = compose_map([finished_grid(cells, 0.025, 0.025)], pose, CONFIG)

    assert at(occupancy_map, -0.025, 0.175) > 0.9
    assert at(occupancy_map, -0.025, 0.025) == pytest.approx(0.1)


@pytest.mark.parametrize("angle_deg", [0.0, 3.0, 17.0, 30.0, 45.0, 71.0, 90.0])
def test_turned_submaps_leave_no_holes_in_walls_and_floors(angle_deg):
    theta = math.radians(angle_deg)
    shift = np.array([[0.013, 0.031, theta]])

    occupancy_map = compose_map([wall_grid()], shift, CONFIG)

    along = np.arange(-1.8, 1.8, 0.01)
    cos, sin = math.cos(theta), math.sin(theta)
    x, y = 0.013 - sin * along, 0.031 + cos * along
    assert min(at(occupancy_map, px, py) for px, py in zip(x, y, strict=True)) > 0.5
    beside_x, beside_y = x + 0.2 * cos, y + 0.2 * sin
    beside = [at(occupancy_map, px, py) for px, py in zip(beside_x, beside_y, strict=True)]
    assert max(beside) == pytest.approx(0.1, abs=1e-3)


def test_evidence_adds_up_over_submaps():
    weak = finished_grid(np.full((1, 1), RATHER_OCCUPIED, np.uint8), 0.025, 0.025)

    once = compose_map([weak], np.zeros((1, 3)), CONFIG).probability.max()
    thrice = compose_map([weak] * 3, np.zeros((3, 3)), CONFIG).probability.max()

    assert 0.7 < once < thrice


def test_a_passer_by_seen_once_is_outweighed_but_a_wall_is_not():
    hit = finished_grid(np.full((1, 1), OCCUPIED, np.uint8), 0.025, 0.025)
    free = finished_grid(np.full((1, 1), FREE, np.uint8), 0.025, 0.025)

    def judged(hits, misses):
        grids = [free] * misses + [hit] * hits
        return compose_map(grids, np.zeros((len(grids), 3)), CONFIG).probability.max()

    assert judged(hits=1, misses=1) > 0.65
    assert judged(hits=1, misses=4) < 0.196
    assert judged(hits=3, misses=1) > 0.98


def test_the_order_of_submaps_does_not_matter():
    grids = [wall_grid(), wall_grid(3), wall_grid(-2)]
    poses = np.array([[0, 0, 0], [0.3, 0.1, 0.2], [-0.4, 0.2, -1.0]])

    forward = compose_map(grids, poses, CONFIG)
    backward = compose_map(grids[::-1], poses[::-1], CONFIG)

    assert forward.probability == pytest.approx(backward.probability, abs=1e-5)
    assert (forward.origin_x, forward.origin_y) == (backward.origin_x, backward.origin_y)


def test_walls_a_pixel_apart_do_not_wipe_each_other_out():
    occupancy_map = compose_map([wall_grid(0), wall_grid(1)], np.zeros((2, 3)), CONFIG)

    row = occupancy_map.probability[40]
    assert np.count_nonzero(row > 0.65) >= 1


def test_nothing_seen_is_one_unknown_cell():
    empty = finished_grid(np.zeros((4, 4), np.uint8))

    for grids, poses in (([], np.zeros((0, 3))), ([empty], np.zeros((1, 3)))):
        assert compose_map(grids, poses, CONFIG).probability.tolist() == [[UNKNOWN]]


def test_a_map_that_came_apart_is_refused_with_its_size():
    poses = np.array([[0, 0, 0], [1e5, 1e5, 0]])

    with pytest.raises(OutputError, match="100"):
        compose_map([wall_grid(), wall_grid()], poses, CONFIG)
