# SPDX-License-Identifier: Apache-2.0
"""Sessions in the pose graph: which nodes and submaps are whose, and which parts are connected."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.session import Session, session_numbers
from cartoloop.submaps.finished_grid import FinishedGrid


@dataclass(frozen=True, slots=True)
class MappedSessions:
    """A map that mapping goes on from: what global SLAM has to know of it.

    Attributes
    ----------
    sessions : of the map, in order.
    graph : its pose graph.
    grids : of the submaps; all count as finished.
    node_points : the returns of each node [m], tracking frame.
    tf_local_node : float64, shape (n, 3), before loop closure, in the local frame of its session.
    closures : the record of the map.
    """

    sessions: Sequence[Session]
    graph: PoseGraph
    grids: Sequence[FinishedGrid]
    node_points: Sequence[FloatArray]
    tf_local_node: FloatArray
    closures: Closures


class SessionRanges:
    """Where each session begins in the graph, and the connected part that it belongs to.

    Attributes
    ----------
    first_nodes, first_submaps : where each session begins, ascending.
    parts : number of the part of each session.
    """

    def __init__(self) -> None:
        self.first_nodes: list[int] = []
        self.first_submaps: list[int] = []
        self.parts: list[int] = []

    def __len__(self) -> int:
        return len(self.parts)

    def in_part(self, part: int) -> tuple[int, ...]:
        """Return the numbers of the sessions in a part."""
        return tuple(number for number, each in enumerate(self.parts) if each == part)

    def begin(self, first_node: int, first_submap: int, part: int | None = None) -> int:
        """Begin a session, by default in a part of its own; return the number of its part."""
        self.first_nodes.append(first_node)
        self.first_submaps.append(first_submap)
        self.parts.append(max(self.parts, default=-1) + 1 if part is None else part)
        return self.parts[-1]

    def join(self, part: int, into: int) -> None:
        """Note that a part is connected to another one from now on."""
        self.parts = [into if each == part else each for each in self.parts]

    def of_nodes(self, count: int) -> IntArray:
        """Return the part of each of the first nodes, shape (count,)."""
        return self._parts(self.first_nodes, count)

    def of_submaps(self, count: int) -> IntArray:
        """Return the part of each of the first submaps, shape (count,)."""
        return self._parts(self.first_submaps, count)

    def _parts(self, firsts: Sequence[int], count: int) -> IntArray:
        return np.array(self.parts, dtype=np.int64)[session_numbers(firsts, count)]


@dataclass(frozen=True, slots=True)
class NodeSubmaps:
    """The submaps that nodes were inserted into.

    Attributes
    ----------
    first, last : int64, shape (n,), the oldest and the newest of each node.
    """

    first: IntArray
    last: IntArray

    @classmethod
    def of(cls, graph: PoseGraph) -> NodeSubmaps:
        """Return those of the nodes of a graph; submap 0 where it holds none of a node."""
        own = np.flatnonzero(graph.kinds == ConstraintKind.INTRA_SUBMAP)
        first = np.full(graph.num_nodes, graph.num_submaps)
        last = np.zeros(graph.num_nodes, dtype=np.int64)
        np.minimum.at(first, graph.index_b[own], graph.index_a[own])
        np.maximum.at(last, graph.index_b[own], graph.index_a[own])
        return cls(np.minimum(first, last), last)
