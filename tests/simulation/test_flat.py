# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest

from cartoloop.simulation import LIDARS, drive, flat
from tests.reference.naive_wall_ranges import naive_wall_ranges
from tests.simulation.wall_clearance import clearance

SEEDS = range(6)
LENGTHS = [4.09, 5.4, 9.9, 15.09, 15.12]


@pytest.mark.parametrize("seed", SEEDS)
def test_tape_lines_are_free_from_wall_to_wall(seed):
    world = flat(seed)
    for x1, y1, x2, y2 in world.tape_lines.tolist():
        middle = ((x1 + x2) / 2, (y1 + y2) / 2, math.atan2(y2 - y1, x2 - x1))
        there, back = naive_wall_ranges(
            world.walls, np.array([middle]), np.array([0.0, math.pi]), 20.0
        )[0]
        half = math.dist((x1, y1), (x2, y2)) / 2
        assert there == pytest.approx(half, abs=1e-3)
        assert back == pytest.approx(half, abs=1e-3)


@pytest.mark.parametrize("seed", SEEDS)
def test_nothing_stands_beside_a_tape_line_but_what_it_ends_at(seed):
    world = flat(seed)
    for line in world.tape_lines.reshape(-1, 2, 2):
        length = np.linalg.norm(line[1] - line[0])
        shares = np.linspace(0.4 / length, 1.0 - 0.4 / length, 60)[:, None]
        assert clearance(world.walls, line[0] + shares * (line[1] - line[0])).min() > 0.25


def test_tape_lines_are_as_long_as_the_papers():
    lines = flat().tape_lines
    lengths = np.hypot(*(lines[:, 2:] - lines[:, :2]).T)
    assert lines.dtype == np.float64
    for length in LENGTHS:
        assert np.abs(lengths - length).min() < 1e-9
    assert 4.0 < lengths.min() < lengths.max() < 15.2


def test_a_trolley_is_pushed_slowly_and_turned_gently():
    world = flat()
    motion = drive(world.route, *world.pace)
    steps = np.hypot(*np.diff(motion.poses[:, :2], axis=0).T)
    turns, seconds = np.abs(np.diff(motion.poses[:, 2])), np.diff(motion.times)
    assert (steps / seconds).max() < 0.31
    assert (turns / seconds).max() < 0.3
    assert world.lidar is LIDARS["lds"]
    assert not world.has_odometry


def test_another_flat_has_other_rooms():
    assert not np.array_equal(flat(0).tape_lines, flat(1).tape_lines)
