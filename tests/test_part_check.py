# SPDX-License-Identifier: Apache-2.0
"""Parts on which few scans agree are examined more strictly."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop.global_slam.join_evidence import GeometryCheck, Strictness, TwoParts
from cartoloop.global_slam.pose_graph import ClosureConstraints, PoseGraph
from cartoloop.global_slam.tentative_join import held_at
from cartoloop.map_output.part_walls import WallFault
from cartoloop.part_check import FLOOR_SHARES, STRICT_WALLS_M
from cartoloop.part_check import strict_fault as fault_of
from cartoloop.sensor.scan_points import ScanPoints


def checked(length=50.0, on_floor=0.0):
    return GeometryCheck(length, 0.0, 1000 - round(1000 * on_floor), round(1000 * on_floor), "")


def strict_fault(found, faults, usual=0.0, strictness=Strictness.FEW_SCORE_HIGH):
    return fault_of(found, faults, FLOOR_SHARES[strictness], usual)


def walls(*lengths):
    return [WallFault(1.0, 2.0, length, 5.0) for length in lengths]


def test_parts_that_agree_pass():
    assert strict_fault(checked(), []) == ""
    assert strict_fault(checked(), walls(0.4)) == ""


def test_pieces_of_walls_count_together():
    fault = strict_fault(checked(length=10.0), walls(0.4, 0.3))
    assert "walls of 0.7 m in 2 pieces" in fault


@pytest.mark.parametrize(("length", "passes"), [(60.0, False), (130.0, True)])
def test_long_overlaps_may_have_more_of_them(length, passes):
    pieces = walls(0.7, 0.5)
    assert sum(piece.length for piece in pieces) > STRICT_WALLS_M
    assert (strict_fault(checked(length), pieces) == "") is passes


def test_returns_on_floor_are_limited():
    assert strict_fault(checked(on_floor=0.07), []) == ""
    assert "9% of the returns" in strict_fault(checked(on_floor=0.09), [])


def test_more_returns_on_floor_pass_where_they_are_usual():
    assert strict_fault(checked(on_floor=0.1), [], 0.09) == ""
    assert "few scans agree" in strict_fault(checked(on_floor=0.1), [], 0.07)


def test_less_floor_passes_where_few_scans_are_distinct():
    strictness = Strictness.FEW_DISTINCT
    assert strict_fault(checked(on_floor=0.02), [], 0.0, strictness) == ""
    assert strict_fault(checked(on_floor=0.05), [], 0.05, strictness) == ""
    assert strict_fault(checked(on_floor=0.05), [], 0.01, strictness) != ""


def connected(*closures):
    """Return three parts of a submap each at the origin, of which the last is left out.

    The nodes of part k are 10 k m along x, and 1 m apart along y.

    Parameters
    ----------
    closures : submap, node and by how much the match disagrees with the poses [m].
    """
    graph = PoseGraph()
    for _ in range(3):
        graph.add_submap((0.0, 0.0, 0.0))
    poses = np.array([(10.0 * part, float(i), 0.0) for part in range(3) for i in range(4)])
    graph.add_nodes([tuple(pose) for pose in poses.tolist()])
    submaps, nodes, errors = (np.array(column) for column in zip(*closures, strict=True))
    matches = poses[nodes.astype(np.int64)] + errors[:, np.newaxis] * (1.0, 0.0, 0.0)
    count = len(closures)
    graph.add_loop_closures(
        ClosureConstraints(
            np.arange(count),
            submaps.astype(np.int64),
            nodes.astype(np.int64),
            matches,
            np.tile(np.eye(3), (count, 1, 1)),
        )
    )
    of_nodes = np.repeat((0, 1, -1), 4)
    return TwoParts(graph, [], ScanPoints.of([]), of_nodes, np.array((0, 1, -1)))


def test_parts_hold_where_closures_connect_them():
    within, left_out = [(0, 1, 0.0), (1, 5, 0.0)], [(2, 0, 0.0), (0, 9, 0.0)]
    between = [(0, 6, 0.05), (1, 2, 0.0)]
    held = held_at(connected(*within, *left_out, *between))
    assert held.tolist() == [[10.0, 2.0], [0.0, 2.0]]


def test_closures_that_the_poses_contradict_hold_nothing():
    held = held_at(connected((0, 6, 0.05), (0, 7, 1.5)))
    assert held.tolist() == [[10.0, 2.0]]
