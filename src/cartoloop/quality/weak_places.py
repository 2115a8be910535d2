# SPDX-License-Identifier: Apache-2.0
"""Places that rest on little: on a few loop closures, or on no other visit."""

from __future__ import annotations

import math

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.config import QualityConfig
from cartoloop.quality.by_session import APART_M
from cartoloop.quality.encounters import Encounters
from cartoloop.quality.pairs import MapContent
from cartoloop.quality.places import MAX_PLACES, of_nodes, place_around, stamps_of
from cartoloop.quality.verdict import Kind, Place, Severity
from cartoloop.quality.weak_closures import WeakBundle
from cartoloop.session import ranges

HEADING_DRIFT = math.radians(0.1)
"""Drift of the heading that is expected of local SLAM [rad / sqrt(m)]: 0.04 to 0.3 degrees were
measured, the last in corridors a hundred metres long."""


def weak_closure_places(found: list[WeakBundle], content: MapContent) -> list[Place]:
    """Return the places that only a few loop closures hold: worth a look, and no more."""
    places = []
    for bundle in found:
        closures = (
            "one loop closure"
            if bundle.num_closures == 1
            else f"{bundle.num_closures} loop closures"
        )
        without = (
            f"the path between its ends would be {bundle.detour:.0f} m long"
            if bundle.detour < APART_M
            else "nothing would connect its ends"
        )
        places.append(
            place_around(
                content.graph.node_poses[bundle.nodes, :2],
                stamps_of(content, bundle.nodes),
                Kind.WEAK_CLOSURE,
                Severity.MINOR,
                f"{closures} alone hold the map together here: without, {without}",
                "drive once more, for some metres, where both visits have been",
            )
        )
    return places[:MAX_PLACES]


def open_ends(
    met: Encounters, paths: FloatArray, content: MapContent, config: QualityConfig
) -> list[Place]:
    """Return the beginning and the end of the path as far as no other visit confirms them.

    The position at the end of a path of length L is uncertain by sigma L^1.5 / sqrt(3), if the
    heading is a random walk of sigma [rad / sqrt(m)].
    """
    confirmed_nodes = is_confirmed(met, len(paths))
    ends = []
    firsts = [session.first_node for session in content.sessions]
    for nodes in ranges(firsts, len(paths)):
        confirmed = nodes.start + np.flatnonzero(confirmed_nodes[nodes])
        first, last = nodes.start, nodes.stop - 1
        if len(confirmed):
            ends += [(first, int(confirmed[0])), (int(confirmed[-1]), last)]
        elif last > first:
            ends.append((first, last))
    found = []
    for start, end in ends:
        length = float(paths[end] - paths[start])
        error = HEADING_DRIFT * length**1.5 / math.sqrt(3.0)
        if error <= config.doubtful_open_error:
            continue
        found.append(
            of_nodes(
                start,
                end,
                content,
                Kind.OPEN,
                Severity.DOUBTFUL,
                f"{length:.0f} m of the path come back nowhere: an error of {error:.0f} m would "
                "not show",
                "let the robot return to places that it has seen, best along the way that it came",
            )
        )
    return found


def is_confirmed(met: Encounters, num_nodes: int) -> BoolArray:
    """Return which nodes are in an encounter that agrees, or met in one, shape (num_nodes,)."""
    return _in_encounters(met, np.flatnonzero(~met.contradicts), num_nodes)


def is_visited(met: Encounters, num_nodes: int) -> BoolArray:
    """Return which nodes are in any encounter, or met in one, shape (num_nodes,)."""
    return _in_encounters(met, np.arange(len(met)), num_nodes)


def _in_encounters(met: Encounters, rows: IntArray, num_nodes: int) -> BoolArray:
    """Return which nodes are in some encounters, or met in one, shape (num_nodes,)."""
    found = np.zeros(num_nodes, dtype=np.bool_)
    for row in rows.tolist():
        own = slice(int(met.first[row]), int(met.end[row]))
        found[met.pairs.node[own]] = True
        found[met.pairs.own_node[own]] = True
    return found
