# SPDX-License-Identifier: Apache-2.0
"""Places of corridors: lengths that are not well known, and steps that scans contradict."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.config import QualityConfig
from cartoloop.quality.corridors import MEASURED_GAIN, SMOOTHED_OVER, Corridors
from cartoloop.quality.odometry_use import (
    has_odometry,
    length_error,
    num_slips,
    without_odometry,
)
from cartoloop.quality.pairs import MapContent, path_lengths
from cartoloop.quality.places import MAX_PLACES, extent, place_around, stamps_of
from cartoloop.quality.verdict import Kind, Place, Severity

UNMEASURED_ERROR = 0.12
"""Expected error of a length that neither odometry nor scans measure, as a share of it."""

VISITED_SHARE = 0.4
"""A corridor is visited twice if this share of its nodes is compared with another visit."""

DISPLACED_GAIN = 5.0
"""A step is contradicted where the scan costs so much less elsewhere."""

MIN_DISPLACED, MIN_DISPLACED_SHARE = 4, 0.08
"""Corridors are doubtful in which this number and share of the nodes examined is contradicted."""

HIDDEN_SLIPS = 0.05
"""Number of slips that is expected where scans do not show them, nor other visits, from which it
counts."""

MEASURE_IT = (
    "compare its length with a tape measure; record with better odometry, or put boxes along the "
    "walls"
)


class NodeVisits(NamedTuple):
    """What other visits show of all nodes of a map.

    Attributes
    ----------
    are_compared : bool (n,), nodes that are compared with another visit.
    are_here : bool (n,), those whose positions along the path are measured to agree.
    displaced : float64 (n, 2), by the scales of the odometry between bare walls [m].
    """

    are_compared: BoolArray
    are_here: BoolArray
    displaced: FloatArray


def corridor_places(
    halls: Corridors,
    odometry: Mapping[str, Any] | None,
    visits: NodeVisits,
    content: MapContent,
    config: QualityConfig,
) -> list[Place]:
    """Return the corridors whose lengths are not well known, or contradicted by scans.

    Parameters
    ----------
    odometry : its calibration, as in the report; None without odometry.
    visits : what they show of all nodes.
    """
    stamps = stamps_of(content, halls.nodes)
    alone = without_odometry(stamps, odometry)
    by_odometry = ~alone
    measured_by = "nothing"
    if _may_have_slipped(halls, by_odometry, num_slips(odometry), visits, content):
        alone, measured_by = np.ones_like(alone), "odometry that was seen to slip elsewhere"
    return [
        *_poor_odometry_places(
            halls,
            by_odometry,
            odometry,
            visits,
            content,
            config,
        ),
        *_unmeasured_places(halls, alone, measured_by, content, config),
        *_displaced_step_places(halls, alone, content),
    ]


def measured_by_odometry(
    halls: Corridors, odometry: Mapping[str, Any] | None, content: MapContent
) -> BoolArray:
    """Return which of all nodes are in corridors whose lengths odometry measures, shape (n,).

    Also in those that only chords along walls show: where ranges are noisy, scans measure little.
    """
    found = np.zeros(content.graph.num_nodes, dtype=np.bool_)
    if has_odometry(odometry):
        halls = halls._replace(is_corridor=halls.is_by_chords)
        for rows in _runs(halls, ~without_odometry(stamps_of(content, halls.nodes), odometry)):
            found[halls.nodes[rows[0]] : halls.nodes[rows[-1]] + 1] = True
    return found


def _may_have_slipped(
    halls: Corridors, chosen: BoolArray, slips: int, visits: NodeVisits, content: MapContent
) -> bool:
    """Return whether wheels may have slipped where no scan shows it, by how often they did.

    Parameters
    ----------
    chosen : which of the examined nodes have odometry, shape (k,).
    slips : number of those that were seen.
    """
    if not slips:
        return False
    hidden = chosen & ~visits.are_here[halls.nodes]
    length = sum(
        _unmeasured_length(halls, rows[hidden[rows]], content) for rows in _runs(halls, chosen)
    )
    path = float(path_lengths(content.graph.node_poses)[-1])
    return slips * length >= HIDDEN_SLIPS * (path - length)


def _poor_odometry_places(
    halls: Corridors,
    chosen: BoolArray,
    odometry: Mapping[str, Any] | None,
    visits: NodeVisits,
    content: MapContent,
    config: QualityConfig,
) -> list[Place]:
    """Return the corridors whose lengths odometry measures, but not well.

    Parameters
    ----------
    chosen : which of the examined nodes have odometry, shape (k,).
    visits : what they show of all nodes.
    """
    if not has_odometry(odometry):
        return []
    places = []
    for rows in _runs(halls, chosen):
        nodes = halls.nodes[rows]
        length = extent(content.graph.node_poses[nodes, :2])
        # Visits are compared, see visit_offsets.
        is_visited = visits.are_compared[nodes].mean() >= VISITED_SHARE
        by_scale = 0.0 if is_visited else extent(visits.displaced[nodes])
        error = math.hypot(length_error(length, odometry), by_scale)
        if error > config.doubtful_length_error:
            reason = (
                f"a corridor of {length:.0f} m in which scans hardly measure the distance: it "
                "rests on the odometry, which is poor or was not calibrated yet, and may be "
                f"{error:.1f} m too long or too short"
            )
            places.append(_place(halls.nodes[rows], content, reason, MEASURE_IT))
    return places[:MAX_PLACES]


def _unmeasured_places(
    halls: Corridors,
    chosen: BoolArray,
    measured_by: str,
    content: MapContent,
    config: QualityConfig,
) -> list[Place]:
    """Return the corridors with lengths that nothing measures, if they are long in all.

    Parameters
    ----------
    chosen : which of the examined nodes have no odometry that can be trusted, shape (k,).
    measured_by : what measures these lengths instead of scans.
    """
    found = [(rows, _unmeasured_length(halls, rows, content)) for rows in _runs(halls, chosen)]
    error = UNMEASURED_ERROR * sum(length for _, length in found)
    if error <= config.doubtful_length_error:
        return []
    return [
        _place(
            halls.nodes[rows],
            content,
            f"a corridor in which {measured_by} measures the distance along {length:.0f} m, but "
            f"not the scans: the map may be {error:.1f} m too long or too short there",
            MEASURE_IT,
        )
        for rows, length in found
        if length > 0.0
    ][:MAX_PLACES]


def _displaced_step_places(halls: Corridors, chosen: BoolArray, content: MapContent) -> list[Place]:
    """Return the corridors along which consecutive scans fit better elsewhere.

    Only without odometry, which is better than scans between walls that are nearly bare.

    Parameters
    ----------
    chosen : which of the examined nodes have no odometry, shape (k,).
    """
    runs = [rows[np.isfinite(halls.gains[rows])] for rows in _runs(halls, chosen)]
    displaced = [rows[halls.gains[rows] > DISPLACED_GAIN] for rows in runs]
    number, compared = (sum(map(len, each)) for each in (displaced, runs))
    if number < max(MIN_DISPLACED, MIN_DISPLACED_SHARE * compared):
        return []
    return [
        _place(
            halls.nodes[rows],
            content,
            f"along corridors {number} of {compared} scans fit to the ones before them better if "
            "the robot moved by another distance",
            "the robot probably moved farther than the map shows: record with odometry that "
            "works; `cartoloop doctor` examines it",
        )
        for rows in displaced
        if len(rows)
    ][:MAX_PLACES]


def _place(nodes: IntArray, content: MapContent, reason: str, advice: str) -> Place:
    """Return the place of a corridor."""
    points = content.graph.node_poses[nodes, :2]
    stamps = stamps_of(content, nodes)
    return place_around(points, stamps, Kind.CORRIDOR, Severity.DOUBTFUL, reason, advice)


def _runs(halls: Corridors, chosen: BoolArray) -> Iterator[IntArray]:
    """Yield the rows of each corridor, of the chosen ones, shape (k,)."""
    rows = np.flatnonzero(halls.is_corridor & chosen)
    for run in np.split(rows, np.flatnonzero(np.diff(rows) > SMOOTHED_OVER) + 1):
        if len(run) > 1:
            yield run


def _unmeasured_length(halls: Corridors, rows: IntArray, content: MapContent) -> float:
    """Return the length of the path along which scans do not measure the steps [m]."""
    paths = path_lengths(content.graph.node_poses)
    ends = np.append(halls.nodes[1:], len(paths) - 1)
    blind = rows[halls.gains[rows] >= MEASURED_GAIN]
    return float(np.sum(paths[ends[blind]] - paths[halls.nodes[blind]]))
