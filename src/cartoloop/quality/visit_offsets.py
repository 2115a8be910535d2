# SPDX-License-Identifier: Apache-2.0
"""By how far visits of a place are displaced along the path: measured, or expected.

Where scans show it, the displacement is measured, see :mod:`cartoloop.quality.along_corridors`.
Elsewhere, along bare walls, it is expected by the scales that were used for the odometry, and
corrected by what was measured nearby.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray
from cartoloop.quality.along_corridors import met_nodes
from cartoloop.quality.clusters import clusters
from cartoloop.quality.encounters import Encounters
from cartoloop.quality.pairs import MapContent
from cartoloop.quality.places import MAX_PLACES, place_around, stamps_of
from cartoloop.quality.verdict import Kind, Place, Severity

NEAR_M = 6.0
"""What is measured corrects what is expected so far from it, along the paths of both visits [m]."""

MAX_OFFSET_M, OF_VISITS = 0.36, 0.9
"""A map is doubtful if visits are displaced by more than this [m], all but a tenth of them: 0.3 m
would be a gross error, and the steps of the shifts are 0.05 m."""

MIN_VISITS = 5
"""Fewer encounters have no such quantile."""


def displacement_by_scale(
    content: MapContent, in_corridor: BoolArray, odometry: Mapping[str, Any] | None
) -> FloatArray:
    """Return by how much each node is displaced, shape (num_nodes, 2) [m].

    While the scale is learnt, distances that rest on the odometry are wrong by as much as it is
    off from what it turns out to be in the end.

    Parameters
    ----------
    content : the map.
    in_corridor : which nodes are in corridors with odometry; elsewhere scans measure.
    odometry : its calibration, as in the report; what was mapped before it began does not count.
    """
    poses = content.graph.node_poses
    displaced = np.zeros((len(poses), 2))
    used, final = (odometry or {}).get("scales"), (odometry or {}).get("translation_scale")
    if not used or not final:
        return displaced
    begins = np.array([float(one["begin"]) for one in used])
    scales = np.array([float(one["translation_scale"]) for one in used])
    rows = np.searchsorted(begins, stamps_of(content, np.arange(len(poses) - 1)), side="right") - 1
    errors = np.where(in_corridor[:-1] & (rows >= 0), scales[rows] / float(final) - 1.0, 0.0)
    steps = np.diff(poses[:, :2], axis=0) * errors[:, np.newaxis]
    steps[[session.first_node - 1 for session in content.sessions[1:]]] = 0.0
    displaced[1:] = np.cumsum(steps, axis=0)
    return displaced


def visit_offsets(
    met: Encounters, shifts: FloatArray, displaced: FloatArray, paths: FloatArray
) -> FloatArray:
    """Return by how much encounters are displaced against what they meet, shape (n, 2) [m].

    Parameters
    ----------
    met : encounters of visits, n of them.
    shifts : by which they fit better, see :func:`cartoloop.quality.along_corridors.shifts_along`.
    displaced : of each node, see :func:`displacement_by_scale`.
    paths : path length of each node [m].
    """
    nodes = met_nodes(met)
    expected = displaced[nodes[:, 0]] - displaced[nodes[:, 1]]
    known = np.flatnonzero(np.isfinite(shifts[:, 0]))
    if len(known) == 0:
        return expected
    at = paths[nodes]
    apart = np.abs(at[:, np.newaxis] - at[known]).sum(axis=2)
    nearest = apart.argmin(axis=1)
    corrections = -shifts[known] - expected[known]
    is_near = apart[np.arange(len(at)), nearest] < NEAR_M
    corrected: FloatArray = expected + np.where(
        is_near[:, np.newaxis], corrections[nearest], np.zeros(2)
    )
    return corrected


OFFSET_REASON = (
    "visits are displaced along the path by {apart:.1f} m, by what doors and corners show, and "
    "between bare walls by the scale of the odometry"
)
OFFSET_ADVICE = (
    "the distance was measured wrongly while the odometry was not calibrated yet: begin where "
    "walls face all directions; drive through the place once more"
)


def offset_places(met: Encounters, offsets: FloatArray, content: MapContent) -> list[Place]:
    """Return where visits are displaced along the path, if more than a tenth of them are."""
    lengths = np.hypot(offsets[:, 0], offsets[:, 1])
    if len(met) < MIN_VISITS or np.quantile(lengths, OF_VISITS) <= MAX_OFFSET_M:
        return []
    rows = np.flatnonzero(lengths > MAX_OFFSET_M)
    nodes = met_nodes(met)[rows]
    points = content.graph.node_poses[nodes[:, 0], :2]
    places = [
        place_around(
            points[members],
            stamps_of(content, np.unique(nodes[members])),
            Kind.CORRIDOR,
            Severity.DOUBTFUL,
            OFFSET_REASON.format(apart=np.median(lengths[rows[members]])),
            OFFSET_ADVICE,
        )
        for members in clusters(points)
    ]
    return sorted(places, key=lambda place: -place.radius)[:MAX_PLACES]
