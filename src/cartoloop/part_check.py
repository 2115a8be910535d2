# SPDX-License-Identifier: Apache-2.0
"""What two parts of a map must pass before they are joined: scans against walls, walls as such."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.config import Config
from cartoloop.global_slam.join_evidence import CheckGeometry, GeometryCheck, Strictness, TwoParts
from cartoloop.global_slam.part_drift import held_at
from cartoloop.map_output.part_walls import Submaps, WallFault, wall_faults
from cartoloop.quality.confirmed import ConfirmedReturns
from cartoloop.quality.joins import check_geometry, count_returns, floor_fault, usual_floor_share


def part_check(config: Config) -> CheckGeometry:
    """Return the examination of two parts with the limits of a configuration."""
    join, confirmed = config.global_slam.constraint_search.join, ConfirmedReturns()

    def check(parts: TwoParts, strictness: Strictness) -> GeometryCheck:
        if strictness == Strictness.COUNTS_ONLY:
            return count_returns(parts, config.quality, confirmed)
        found = check_geometry(parts, config.quality, join, confirmed)
        if found.fault:
            return found
        one, other = (_submaps_of(parts, part) for part in (0, 1))
        faults = wall_faults(
            one,
            other,
            config.local_slam.submaps,
            min(MIN_PIECE_M, join.max_contradicted_wall),
            join.min_hidden_area,
            held_at(parts),
        )
        if fault := wall_fault(faults, join.max_contradicted_wall):
            return found._replace(fault=fault)
        if strictness == Strictness.NO_OTHER_PLACE:
            return found
        usual = 0.0
        if found.floor_share > FLOOR_SHARE:
            usual = usual_floor_share(parts, config.quality, confirmed)
        if strictness == Strictness.OTHER_PLACES:
            fault = strict_fault(found, [], usual, "scans agree on another place, too")
        else:
            fault = strict_fault(found, faults, usual)
        return found._replace(fault=fault)

    return check


def wall_fault(faults: Sequence[WallFault], least: float) -> str:
    """Return why parts cannot be joined by a wall that closes a corridor or room, "" if they can.

    Parameters
    ----------
    faults : pieces of walls that contradict it, the longest first.
    least : length from which they forbid it [m].
    """
    worst = next((fault for fault in faults if fault.closes), None)
    if worst is None or worst.length < least:
        return ""
    return (
        f"a wall of {worst.length:.1f} m at x {worst.x:.1f}, y {worst.y:.1f} contradicts it: the "
        f"other part saw floor there, and {worst.hidden:.0f} m2 behind it"
    )


def _submaps_of(parts: TwoParts, part: int) -> Submaps:
    chosen = parts.submaps_of(part)
    grids = [parts.submaps[submap].grid for submap in chosen.tolist()]
    return Submaps(grids, parts.graph.submap_poses[chosen], _path_of(parts, part))


def _path_of(parts: TwoParts, part: int) -> FloatArray:
    """Return places that the robot drove through, 0.2 m apart at most, shape (k, 2) [m]."""
    nodes = parts.graph.node_poses[parts.nodes_of(part), :2]
    steps = np.diff(nodes, axis=0)
    is_driven = np.hypot(steps[:, 0], steps[:, 1]) < MAX_STEP_M
    begins, steps = nodes[:-1][is_driven], steps[is_driven]
    shares = np.linspace(0.0, 1.0, round(MAX_STEP_M / 0.2), endpoint=False)[1:]
    return np.concatenate((nodes, *(begins + share * steps for share in shares)))


def strict_fault(
    found: GeometryCheck,
    faults: Sequence[WallFault],
    usual_floor_share: float = 0.0,
    doubt: str = "few scans agree",
) -> str:
    """Return why parts cannot be joined whose scans leave a doubt, "" if they can.

    Parameters
    ----------
    faults : pieces of walls that contradict it.
    usual_floor_share : share of returns on floor within the parts.
    doubt : why they are examined so strictly.
    """
    if fault := floor_fault(found, FLOOR_SHARE, usual_floor_share):
        return f"{fault}, and {doubt}"
    length = sum(fault.length for fault in faults)
    if length > max(STRICT_WALLS_M, STRICT_WALLS_SHARE * found.length):
        return (
            f"walls of {length:.1f} m in {len(faults)} pieces contradict it: the other part saw "
            f"floor there, and more behind them; and {doubt}"
        )
    return ""


MAX_STEP_M = 2.0
"""Nodes further apart are not on one path [m]."""

MIN_PIECE_M = 0.3
"""Shorter pieces of wall say nothing [m]."""

FLOOR_SHARE = 0.02
"""Share of returns on floor that is allowed, unless it is usual there, where scans leave a doubt. A
corridor also fits on another one, and on itself turned around: there were 0.026 to 0.09. Where
sessions of one building overlapped, there were up to 0.038. Where these were more than 0.02, as
many were usual within the parts, or hardly any scan agreed on another place."""

STRICT_WALLS_M, STRICT_WALLS_SHARE = 0.6, 0.015
"""Pieces of walls with something behind them that are allowed where few scans agree: together, or
by the path along which the parts overlap [m]. There were 1.9 m on 54 m and 4 m on 110 m where a
corridor lay on another one, and 0.4 m where sessions of one building overlapped a little."""
