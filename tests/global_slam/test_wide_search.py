# SPDX-License-Identifier: Apache-2.0
"""A loop that is open by more than any search window of single scans closes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cartoloop.config import ConstraintSearchConfig, GlobalSlamConfig, WideSearchConfig
from cartoloop.global_slam.closure_status import Status
from cartoloop.global_slam.global_slam import GlobalSlam
from cartoloop.global_slam.graph_adjustment import GraphAdjustment
from cartoloop.global_slam.pose_graph import ConstraintKind
from cartoloop.runtime.stage_timer import StageTimer
from cartoloop.sensor.pose import Pose, compose, inverse, relative_all, transform_points
from cartoloop.submaps.finished_grid import MAX_PROBABILITY, MIN_PROBABILITY
from cartoloop.submaps.node import Node
from cartoloop.submaps.probability_grid import ProbabilityGrid
from cartoloop.submaps.submap import Submap

SIDE, STEP, VIEW = 25.0, 0.5, 7.0
NODES_A_SUBMAP = 20
TURN_ERROR = math.radians(0.08)
"""Error of the heading that local SLAM adds with every node [rad]."""
NUM_NODES = int(4 * SIDE / STEP) + 60


def clutter():
    """Walls of posts at random places along the path: every place is distinct."""
    random = np.random.default_rng(2)
    corners = random.uniform(-6.0, SIDE + 6.0, (260, 2))
    boxes = []
    for x, y in corners:
        length, angle = random.uniform(0.4, 1.6), random.choice((0.0, math.pi / 2))
        along = np.arange(0.0, length, 0.05)
        boxes.append(np.column_stack((x + along * math.cos(angle), y + along * math.sin(angle))))
    return np.concatenate(boxes)


CLUTTER = clutter()


def true_pose(node):
    """Round a square."""
    side, along = divmod(node * STEP, SIDE)
    corner = [(0.0, 0.0), (SIDE, 0.0), (SIDE, SIDE), (0.0, SIDE)][int(side) % 4]
    heading = 0.5 * math.pi * (side % 4)
    return Pose(
        corner[0] + along * math.cos(heading), corner[1] + along * math.sin(heading), heading
    )


def seen_from(pose):
    near = CLUTTER[np.hypot(*(CLUTTER - pose[:2]).T) < VIEW]
    return transform_points(inverse(pose), near)


def local_poses():
    poses, local = [], true_pose(0)
    for node in range(NUM_NODES):
        poses.append(local)
        step = compose(inverse(true_pose(node)), true_pose(node + 1))
        local = compose(local, Pose(step.x, step.y, step.theta + TURN_ERROR))
    return poses


LOCAL = local_poses()


def submap(index, first):
    """All that is seen on the path of its nodes, distorted as their local poses are."""
    origin = LOCAL[first]
    grid = ProbabilityGrid(0.05)
    grid.cover(-500, -500, 500, 500)
    grid.cells[:] = MIN_PROBABILITY
    for node in range(first, min(first + 2 * NODES_A_SUBMAP, NUM_NODES), 4):
        tf_submap_node = compose(inverse(origin), LOCAL[node])
        points = transform_points(tf_submap_node, seen_from(true_pose(node)))
        cells = np.rint(points / 0.05).astype(int)
        grid.cells[cells[:, 1] - grid.first_row, cells[:, 0] - grid.first_col] = MAX_PROBABILITY
    return Submap(index, LOCAL[first], grid)


def nodes():
    submaps = []
    for k in range(NUM_NODES):
        if k % NODES_A_SUBMAP == 0:
            submaps.append(submap(len(submaps), k))
        active = tuple(submaps[-2:])
        is_last = k % NODES_A_SUBMAP == NODES_A_SUBMAP - 1 and len(active) == 2
        done = active[0] if is_last else None
        information = np.diag((1e4, 1e4, 1e5))
        points = seen_from(true_pose(k))
        yield Node(k, 0.1 * k, LOCAL[k], points, active, information, done)


def run(**wide):
    config = GlobalSlamConfig(
        optimize_every_n_nodes=20,
        num_threads=1,
        constraint_search=ConstraintSearchConfig(
            wide_search=WideSearchConfig(min_path_length=60.0, rotation_drift_deg=1.5, **wide)
        ),
    )
    slam = GlobalSlam(config, StageTimer())
    for node in nodes():
        slam.add_node(node)
        active = [each for each in node.submaps if each is not node.finished]
    slam.finish(active)
    slam.close()
    return slam


def gap_between_the_rounds(slam):
    """Largest distance between nodes of the second round and those of the first there [m]."""
    round_nodes = int(4 * SIDE / STEP)
    again = np.arange(round_nodes + 10, NUM_NODES - 10)
    first, second = slam.graph.node_poses[again - round_nodes], slam.graph.node_poses[again]
    apart = relative_all(first, second)
    return float(np.hypot(apart[:, 0], apart[:, 1]).max())


@pytest.fixture(scope="module")
def slam():
    return run()


def test_local_slam_alone_is_far_off():
    assert math.dist(LOCAL[NUM_NODES - 1][:2], true_pose(NUM_NODES - 1)[:2]) > 3.0


def test_hypotheses_that_agree_close_the_loop(slam):
    assert gap_between_the_rounds(slam) < 0.1


def test_a_loop_stays_open_as_long_as_too_few_agree():
    slam = run(min_hypotheses=1000)
    assert gap_between_the_rounds(slam) > 1.0
    assert np.count_nonzero(slam.closures.status == Status.HYPOTHESIS) >= 2


def test_every_pair_has_one_row(slam):
    closures = slam.closures
    pairs = list(zip(closures.submap.tolist(), closures.node.tolist(), strict=True))
    assert len(set(pairs)) == len(pairs)


def test_the_result_does_not_depend_on_the_number_of_threads(slam):
    assert np.array_equal(run().graph.node_poses, slam.graph.node_poses)


def test_trusted_closures_that_the_rest_contradicts_lose_trust():
    """While mapping: in the end, less of the information of the chain is used."""
    graph = run().graph
    few = np.flatnonzero(graph.kinds == ConstraintKind.LOOP_CLOSURE)[:3]
    graph.is_trusted[few] = True
    graph.relative_poses[few[0]] += (4.0, 0.0, 0.0)
    GraphAdjustment(graph, GlobalSlamConfig()).run(50)

    assert graph.is_trusted[few].tolist() == [False, True, True]
