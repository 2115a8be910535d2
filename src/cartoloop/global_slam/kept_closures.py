# SPDX-License-Identifier: Apache-2.0
"""Closures of searches that stay in the last pass: between sessions, where it matches fewer.

The last pass accepts scans that see the same as a submap. Where the end of one session and the
beginning of another share little of what they see, no scan fits so well, and the pass matches
nothing there. Within a session the chain of submaps holds such places; between sessions only loop
closures do, so that without them walls would stand twice.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import BoolArray, IntArray
from cartoloop.global_slam.closure_matches import FinalMatches, Matched
from cartoloop.global_slam.closure_status import Reason
from cartoloop.global_slam.pose_graph import TRUE_ROTATION_RAD, TRUE_TRANSLATION_M, PoseGraph
from cartoloop.global_slam.sessions import NodeSubmaps, SessionRanges
from cartoloop.sensor.pose import relative_all, wrap_angles
from cartoloop.session import session_numbers


def with_kept_closures(
    passes: Sequence[FinalMatches],
    found: Matched,
    graph: PoseGraph,
    sessions: SessionRanges,
) -> list[FinalMatches]:
    """Return the matches of a last pass, and the closures of searches that stay.

    A closure between two sessions stays, as the search measured it, if the adjusted map agrees with
    it, and the pass accepts fewer matches between the two submaps than searches found.

    Parameters
    ----------
    passes : by submap; each pair once.
    found : what searches found.
    """
    of_submaps = session_numbers(sessions.first_submaps, graph.num_submaps)
    of_nodes = session_numbers(sessions.first_nodes, graph.num_nodes)
    is_between = of_submaps[found.submap] != of_nodes[found.node]
    between = np.flatnonzero(is_between & _agrees(found, graph))
    if len(between) == 0:
        return list(passes)
    own = NodeSubmaps.of(graph).first
    fitting = [np.flatnonzero(each.reason == Reason.FITS) for each in passes]
    submaps, nodes = (
        np.concatenate([column[fits] for column, fits in zip(columns, fitting, strict=True)])
        for columns in ([each.submap for each in passes], [each.node for each in passes])
    )
    pairs = _keys(found.submap[between], own[found.node[between]])
    num_matched = _counts(pairs, np.sort(_keys(submaps, own[nodes])))
    is_due = num_matched < _counts(pairs, np.sort(pairs))
    kept = found.take(between[is_due])
    return [
        _with(each, kept.take(np.flatnonzero(kept.submap == submap)))
        for submap, each in enumerate(passes)
    ]


def _agrees(found: Matched, graph: PoseGraph) -> BoolArray:
    """Return which closures the poses of a graph agree with, so that they may be true."""
    poses = relative_all(graph.submap_poses[found.submap], graph.node_poses[found.node])
    error = found.tf_submap_node - poses
    turn = np.abs(wrap_angles(error[:, 2]))
    agrees: BoolArray = np.hypot(error[:, 0], error[:, 1]) <= TRUE_TRANSLATION_M
    return agrees & (turn <= TRUE_ROTATION_RAD)


def _keys(submaps: NDArray[np.integer], own: IntArray) -> IntArray:
    """Return a number for each pair of submaps, the same whichever comes first."""
    low, high = np.minimum(submaps, own), np.maximum(submaps, own)
    keys: IntArray = low.astype(np.int64) << 32 | high.astype(np.int64)
    return keys


def _counts(keys: IntArray, ordered: IntArray) -> IntArray:
    """Return how often each key is among those that are ordered."""
    left, right = (np.searchsorted(ordered, keys, side=side) for side in ("left", "right"))
    counts: IntArray = right - left
    return counts


def _with(matches: FinalMatches, kept: Matched) -> FinalMatches:
    """Return the matches in one submap and the closures that stay, where none fits by itself."""
    fitting = matches.node[matches.reason == Reason.FITS]
    kept = kept.take(np.flatnonzero(np.isin(kept.node, fitting, invert=True)))
    if len(kept) == 0:
        return matches
    others = np.isin(matches.node, kept.node, invert=True)
    nothing = np.zeros(len(kept))
    stay = FinalMatches(
        kept.submap.astype(np.int64),
        kept.node.astype(np.int64),
        kept.tf_submap_node,
        kept.information,
        kept.residual,
        nothing,
        nothing,
        np.full(len(kept), Reason.KEPT, dtype=np.int8),
    )
    both = [FinalMatches._make(column[others] for column in matches), stay]
    return FinalMatches._make(map(np.concatenate, zip(*both, strict=True)))
