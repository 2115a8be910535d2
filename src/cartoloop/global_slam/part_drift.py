# SPDX-License-Identifier: Apache-2.0
"""Where two parts hold together, and by how far they may be displaced elsewhere."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.global_slam.following import WINDOW_M
from cartoloop.global_slam.graph_adjustment import violated_closures
from cartoloop.global_slam.join_evidence import TwoParts
from cartoloop.global_slam.sessions import NodeSubmaps

DRIFT_SHARE = 0.02
"""Parts may be displaced by this share of the path to where they hold together: local SLAM drifts
by half of it; and at most by as much as places are followed."""

_APART_M = 1e7
"""Between the paths of two sessions, more than any path is long [m]."""


class Drift(NamedTuple):
    """By how far nodes and submaps may be displaced, since the parts are bent.

    Attributes
    ----------
    of_nodes, of_submaps : float64, of all in the graph [m].
    """

    of_nodes: FloatArray
    of_submaps: FloatArray

    def between(self, nodes: IntArray, submap: int) -> FloatArray:
        """Return by how far nodes of one part may be displaced in a submap of the other [m]."""
        drift: FloatArray = np.minimum(self.of_nodes[nodes] + self.of_submaps[submap], WINDOW_M)
        return drift


def held_at(parts: TwoParts) -> FloatArray:
    """Return where nodes of one part are that closures connect to the other, shape (k, 2) [m].

    Closures that the poses do not bear out hold nothing.
    """
    places: FloatArray = parts.graph.node_poses[_held(parts)[1], :2]
    return places


def drift_of(parts: TwoParts) -> Drift:
    """Return by how far the parts may be displaced, by the path to where they hold together.

    The straight way there says little: a session may come by the same place twice, and drift in
    between.
    """
    graph, own = parts.graph, NodeSubmaps.of(parts.graph)
    submaps, nodes = _held(parts)
    is_held = np.isin(own.first, submaps) | np.isin(own.last, submaps)
    is_held[nodes] = True
    away = np.zeros(graph.num_nodes)
    if is_held.any():
        steps = np.hypot(*np.diff(graph.node_poses[:, :2], axis=0).T)
        # Nodes in turn that share no submap are of two sessions.
        steps[own.first[1:] > own.last[:-1]] = _APART_M
        path = np.concatenate(([0.0], np.cumsum(steps)))
        held = path[is_held]
        after = np.searchsorted(held, path).clip(1, max(len(held) - 1, 1))
        away = np.minimum(
            np.abs(path - held[after - 1]), np.abs(path - held[np.minimum(after, len(held) - 1)])
        )
        # Where nothing of a session holds, others of its part do.
        away[away >= _APART_M / 2] = 0.0
    of_submaps = np.full(graph.num_submaps, np.inf)
    for ends in (own.first, own.last):
        np.minimum.at(of_submaps, ends, away)
    of_submaps[~np.isfinite(of_submaps)] = 0.0
    return Drift(DRIFT_SHARE * away, DRIFT_SHARE * of_submaps)


def _held(parts: TwoParts) -> tuple[IntArray, IntArray]:
    """Return submap and node of the closures that hold the parts together."""
    graph = parts.graph
    closures, is_violated = violated_closures(graph)
    closures = closures[~is_violated]
    submaps, nodes = graph.index_a[closures], graph.index_b[closures]
    of_submap, of_node = parts.of_submaps[submaps], parts.of_nodes[nodes]
    is_between = (of_submap != of_node) & (of_submap >= 0) & (of_node >= 0)
    return submaps[is_between], nodes[is_between]
