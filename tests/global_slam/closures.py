# SPDX-License-Identifier: Apache-2.0
"""Requests for closures, and what searches found, made by hand."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cartoloop.global_slam.closure_matches import FinalMatches, Requests, SearchMatches
from cartoloop.global_slam.closure_status import Reason, Status
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.pose_graph import ClosureConstraints

INFORMATION = np.array([(4.0, 1.0, 0.5), (1.0, 5.0, 0.25), (0.5, 0.25, 6.0)])


def requests(*pairs):
    """Requests for pairs of submap and node."""
    submap, node = np.array(pairs, dtype=np.int32).reshape(-1, 2).T
    count = len(pairs)
    return Requests(
        submap,
        node,
        submap,
        np.zeros((count, 3)),
        np.full(count, 1.0),
        np.full(count, np.radians(10.0)),
    )


def search_matches(
    rows, poses=(0.0, 0.0, 0.0), *, score=0.9, runner_up=0.0, information=INFORMATION
):
    """What a search found in these rows; one value, or one per row."""
    count = len(rows)
    return SearchMatches(
        row=np.array(rows, dtype=np.int32),
        tf_submap_node=np.array(np.broadcast_to(poses, (count, 3)), dtype=np.float64),
        information=np.array(np.broadcast_to(information, (count, 3, 3))),
        residual=np.full(count, 0.25),
        score=np.array(np.broadcast_to(score, count), dtype=np.float64),
        runner_up=np.array(np.broadcast_to(runner_up, count), dtype=np.float64),
        moved_m=np.full(count, 0.03125),
        moved_rad=np.full(count, 0.015625),
    )


class Measurement(NamedTuple):
    """One closure as it was measured."""

    submap: int
    node: int
    tf_submap_node: tuple[float, float, float]
    information: np.ndarray
    score: float
    runner_up: float
    residual: float


def closure(
    submap, node, pose=(0.0, 0.0, 0.0), *, score=0.9, runner_up=0.0, information=None, residual=0.25
):
    """One closure."""
    matrix = np.eye(3) if information is None else information
    return Measurement(submap, node, tuple(pose), matrix, score, runner_up, residual)


def final_matches(closures, reasons=None):
    """Matches of the last pass."""
    count = len(closures)
    return FinalMatches(
        submap=np.array([one.submap for one in closures], dtype=np.int64),
        node=np.array([one.node for one in closures], dtype=np.int64),
        tf_submap_node=np.array([one.tf_submap_node for one in closures]).reshape(-1, 3),
        information=np.array([one.information for one in closures]).reshape(-1, 3, 3),
        residual=np.array([one.residual for one in closures], dtype=np.float64),
        moved_m=np.full(count, 0.125),
        moved_rad=np.full(count, 0.5),
        reason=np.array(reasons or [Reason.FITS] * count, dtype=np.int8),
    )


def record(found=(), final=(), rejected=(), num_nodes=20):
    """A record of closures that searches found, and of those that the last pass measured."""
    closures = Closures()
    if found:
        rows = closures.request(requests(*((one.submap, one.node) for one in found)), num_nodes)
        closures.note_searched(rows, 0.5)
        matches = search_matches(
            rows,
            [one.tf_submap_node for one in found],
            score=[one.score for one in found],
            runner_up=[one.runner_up for one in found],
            information=[one.information for one in found],
        )
        closures.add_found(matches, num_nodes)
    if final or rejected:
        replaced = np.full(len(found), Reason.NO_OVERLAP, dtype=np.int8)
        matches = final_matches([*final, *rejected])
        [rows] = closures.note_last_pass(replaced, [matches])
        closures.note_contradicted(rows[len(final) :])
    return closures


def add_to_graph(graph, closures):
    """Add the closures of a record that are in the graph."""
    some = closures.with_status(Status.FINAL, Status.FOUND)
    graph.add_loop_closures(
        ClosureConstraints(some.row, some.submap, some.node, some.tf_submap_node, some.information)
    )
