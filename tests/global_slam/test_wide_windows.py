# SPDX-License-Identifier: Apache-2.0
"""Where the drift may place a node: the window holds it, and is no wider than it has to be."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cartoloop.config import ConstraintSearchConfig, WideSearchConfig
from cartoloop.global_slam.submap_paths import LOST_M, SubmapPaths
from cartoloop.global_slam.wide_windows import wide_reach
from cartoloop.kernels.due_pairs import NodePlace
from cartoloop.sensor.pose import compose_all, relative_all

WIDE = WideSearchConfig(min_path_length=50.0, rotation_drift_deg=0.3, translation_drift=0.05)
CONFIG = ConstraintSearchConfig(
    min_linear_search_window=0.0, min_angular_search_window_deg=0.0, wide_search=WIDE
)
STEP = 5.0
NUM_SUBMAPS = 41
NO_CLOSURES = np.zeros((0, 2), dtype=np.int64)
BOX = (-15.0, -15.0, 15.0, 15.0)


def steps():
    """Round a square with sides of 50 m, a submap every 5 m."""
    turns = np.zeros(NUM_SUBMAPS - 1)
    turns[9::10] = math.pi / 2
    return np.column_stack((np.full(NUM_SUBMAPS - 1, STEP), np.zeros(NUM_SUBMAPS - 1), turns))


def chain(moves):
    poses = np.zeros((NUM_SUBMAPS, 3))
    for i, move in enumerate(moves):
        poses[i + 1] = compose_all(poses[i][np.newaxis], move[np.newaxis])[0]
    return poses


def reach(poses, closures=NO_CLOSURES, boxes=(BOX,), lost_before=NUM_SUBMAPS, **changes):
    config = CONFIG.model_copy(update={"wide_search": WIDE.model_copy(update=changes)})
    travelled = STEP * np.arange(NUM_SUBMAPS)
    travelled[lost_before:] += LOST_M
    last = NUM_SUBMAPS - 1
    place = NodePlace(0, *poses[last].tolist(), float(travelled[last]), last, last, last, 0.0)
    ends = np.array(closures).reshape(-1, 2)
    paths = SubmapPaths(config, travelled, ends, np.zeros(len(ends)))
    return wide_reach(config, paths, place, poses, travelled, np.array(boxes))


def drifted(random):
    """The chain as dead reckoning sees it."""
    moves = steps()
    moves[:, :2] += random.normal(0.0, WIDE.translation_drift * math.sqrt(STEP), (len(moves), 2))
    turn = math.radians(WIDE.rotation_drift_deg) * math.sqrt(STEP)
    moves[:, 2] += random.normal(0.0, turn, len(moves))
    return chain(moves)


def test_the_window_is_the_drift_of_random_walks():
    true = chain(steps())
    expected = relative_all(true[0], true[-1])[0]
    random = np.random.default_rng(5)
    inside, ratios = 0, []
    for _ in range(300):
        found = reach(drifted(random))
        error = found.tf_submap_node[0] - expected
        distance = np.hypot(*error[:2])
        inside += bool(
            distance <= found.linear_window[0] and abs(error[2]) <= found.angular_window[0]
        )
        ratios.append((distance / found.linear_window[0]) ** 2)
    assert inside >= 295
    # Three standard deviations along the larger axis: in the mean, at most 2 / 9 of the square.
    assert 0.6 / 9 < np.mean(ratios) < 2.2 / 9


def test_closures_on_the_path_make_the_window_smaller():
    true = chain(steps())
    closed = reach(true, closures=[(1, 25)])
    assert closed.linear_window[0] < 0.7 * reach(true).linear_window[0]


def test_pairs_with_a_short_path_are_left_to_the_other_search():
    assert len(reach(chain(steps()), closures=[(0, 38)]).due) == 0


def test_submaps_out_of_reach_are_not_searched():
    assert reach(chain(steps())).due.tolist() == [0]
    far = (200.0, 200.0, 230.0, 230.0)
    assert len(reach(chain(steps()), boxes=(far,)).due) == 0


def test_a_lost_robot_is_searched_anywhere_in_submaps():
    box = (-4.0, -6.0, 20.0, 12.0)
    found = reach(chain(steps()), boxes=(box,), lost_before=NUM_SUBMAPS - 1)
    assert found.due.tolist() == [0]
    assert found.angular_window[0] == pytest.approx(math.pi)
    assert found.tf_submap_node[0, :2] == pytest.approx((8.0, 3.0))
    assert found.linear_window[0] == pytest.approx(12.0)


def test_the_likeliest_submaps_are_searched_if_there_are_many():
    many = reach(chain(steps()), boxes=(BOX,) * 25)
    few = reach(chain(steps()), boxes=(BOX,) * 25, max_submaps=3)
    assert len(many.due) > 3
    assert len(few.due) == 3
    assert set(few.due) <= set(many.due)


@pytest.mark.parametrize("angle", [0.0, 0.7, -2.0])
def test_the_window_does_not_depend_on_the_axes(angle):
    poses = chain(steps())
    turned = compose_all(np.array([(3.0, -1.0, angle)]), poses)
    first, second = reach(poses), reach(turned)
    assert second.linear_window == pytest.approx(first.linear_window)
    assert second.angular_window == pytest.approx(first.angular_window)


def test_the_drift_follows_the_positions_that_are_asked_for():
    paths = SubmapPaths(CONFIG, STEP * np.arange(NUM_SUBMAPS), NO_CLOSURES, np.zeros(0))
    straight = np.column_stack((STEP * np.arange(NUM_SUBMAPS), np.zeros(NUM_SUBMAPS)))
    square = chain(steps())[:, :2]
    first, again, other = (paths.drift_from(3, each) for each in (straight, straight, square))
    fresh = SubmapPaths(CONFIG, STEP * np.arange(NUM_SUBMAPS), NO_CLOSURES, np.zeros(0))
    assert np.array_equal(first, again)
    assert not np.allclose(first, other)
    assert np.array_equal(other, fresh.drift_from(3, square))
    assert np.array_equal(paths.drift_from(5, square), fresh.drift_from(5, square))
