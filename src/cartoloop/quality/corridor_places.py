# SPDX-License-Identifier: Apache-2.0
"""Places of corridors: lengths that are not well known, and steps that scans contradict."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from cartoloop.arrays import IntArray
from cartoloop.config import QualityConfig
from cartoloop.quality.corridors import MEASURED_GAIN, SMOOTHED_OVER, Corridors
from cartoloop.quality.odometry_use import NO_ODOMETRY_ERROR, length_error, without_odometry
from cartoloop.quality.pairs import MapContent, path_lengths
from cartoloop.quality.places import MAX_PLACES, extent, place_around, stamps_of
from cartoloop.quality.verdict import Kind, Place, Severity

DISPLACED_GAIN = 5.0
"""A step is contradicted where the scan costs so much less elsewhere."""

MIN_DISPLACED, MIN_DISPLACED_SHARE = 4, 0.08
"""A corridor is doubtful in which this number and share of the nodes examined is contradicted."""


def corridor_places(
    halls: Corridors,
    odometry: Mapping[str, Any] | None,
    content: MapContent,
    config: QualityConfig,
) -> list[Place]:
    """Return the corridors whose lengths are not well known.

    With odometry, as far as it was used, it measures them; elsewhere, only scans do.

    Parameters
    ----------
    odometry : its calibration, as in the report; None without odometry.
    """
    poses, places = content.graph.node_poses[:, :2], []
    has_none = without_odometry(stamps_of(content, halls.nodes), odometry)
    for rows in _runs(halls):
        nodes, alone = halls.nodes[rows], has_none[rows]
        length = extent(poses[nodes])
        unmeasured = _unmeasured_length(halls, rows[alone], content)
        error = NO_ODOMETRY_ERROR * unmeasured
        if not alone.all():
            error += length_error(extent(poses[nodes[~alone]]), odometry)
        if error <= config.doubtful_length_error:
            continue
        on_what = "the odometry, which is poor"
        if alone.any():
            on_what = f"nothing else along {unmeasured:.0f} m"
        places.append(
            place_around(
                poses[nodes],
                stamps_of(content, nodes),
                Kind.CORRIDOR,
                Severity.DOUBTFUL,
                f"a corridor of {length:.0f} m in which scans hardly measure the distance: it "
                f"rests on {on_what}, and may be {error:.1f} m too long or too short",
                "compare its length with a tape measure; record with better odometry, or put "
                "boxes along the walls",
            )
        )
    return places[:MAX_PLACES]


def displaced_step_places(
    halls: Corridors, odometry: Mapping[str, Any] | None, content: MapContent
) -> list[Place]:
    """Return the corridors along which consecutive scans fit better elsewhere.

    Only without odometry, which is better than scans between walls that are nearly bare.
    """
    poses, places = content.graph.node_poses[:, :2], []
    has_none = without_odometry(stamps_of(content, halls.nodes), odometry)
    for rows in _runs(halls):
        compared = rows[np.isfinite(halls.gains[rows]) & has_none[rows]]
        displaced = compared[halls.gains[compared] > DISPLACED_GAIN]
        if len(displaced) < max(MIN_DISPLACED, MIN_DISPLACED_SHARE * len(compared)):
            continue
        nodes = halls.nodes[displaced]
        places.append(
            place_around(
                poses[nodes],
                stamps_of(content, nodes),
                Kind.CORRIDOR,
                Severity.DOUBTFUL,
                f"along a corridor {len(displaced)} of {len(compared)} scans fit to the ones "
                "before them better if the robot moved by another distance",
                "the robot probably moved farther than the map shows: record with odometry that "
                "works; `cartoloop doctor` examines it",
            )
        )
    return places[:MAX_PLACES]


def _runs(halls: Corridors) -> Iterator[IntArray]:
    """Yield the rows of each corridor."""
    rows = np.flatnonzero(halls.is_corridor)
    for run in np.split(rows, np.flatnonzero(np.diff(rows) > SMOOTHED_OVER) + 1):
        if len(run) > 1:
            yield run


def _unmeasured_length(halls: Corridors, rows: IntArray, content: MapContent) -> float:
    """Return the length of the path along which scans do not measure the steps [m]."""
    paths = path_lengths(content.graph.node_poses)
    ends = np.append(halls.nodes[1:], len(paths) - 1)
    blind = rows[halls.gains[rows] >= MEASURED_GAIN]
    return float(np.sum(paths[ends[blind]] - paths[halls.nodes[blind]]))
