# SPDX-License-Identifier: Apache-2.0
"""Places of what the poses and times of a run say against it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray
from cartoloop.config import QualityConfig
from cartoloop.quality.along_corridors import are_here, examined, nodes_between
from cartoloop.quality.corridors import MEASURED_GAIN, Corridors, gain_elsewhere
from cartoloop.quality.encounters import Encounters
from cartoloop.quality.motion import (
    MIN_JUMP_M,
    MOVED_SHARE,
    Event,
    Standing,
    path_steps,
)
from cartoloop.quality.odometry_use import has_odometry, length_error, without_odometry
from cartoloop.quality.pairs import MapContent
from cartoloop.quality.places import MAX_PLACES, at_scan, place_around, stamps_of
from cartoloop.quality.scan_changes import usual_change
from cartoloop.quality.verdict import Kind, Place, Severity
from cartoloop.sensor.pose import relative_all

BRIDGED_M, BRIDGED_SHARE, BRIDGE_AWAY_M = 5.0, 0.8, 5.0
"""A gap is bridged if later visits agree with submaps of before over so much path [m], if they are
this share of all that meet them, and if they are so far from it [m]."""


MAX_UNSURE_M, MEASURED_SHARE, CONFIRMED_SHARE = 4.0, 0.5, 0.4
"""A gap is made up for if the finished map moves the robot across it as far as its speed has it,
later visits agree with what was seen before, and the second share of those examined was measured to
agree along the path. How far it drove is known to a share; where that is more than the first [m], a
place that looks alike may be as far away. Of the path before the gap, or of that after it, these
visits must make the last share: what only looks alike agrees nearby, and not with what follows."""

PARTS_ALONE = (
    "map the parts before and after it alone, and merge the maps; record without interruption, or "
    "stand still while the recording is paused"
)
"""What to do about a gap in the recording."""


def gap_places(
    found: list[Event], met: Encounters, shifts: FloatArray, content: MapContent
) -> list[Place]:
    """Return the places of gaps in the recording; minor ones where visits made up for them.

    Parameters
    ----------
    met : the encounters.
    shifts : by which they fit better along the path, see :mod:`cartoloop.quality.along_corridors`.
    """
    return [
        at_scan(
            event,
            content,
            Kind.GAP,
            Severity.MINOR if _is_made_up_for(event, met, shifts, content) else Severity.DOUBTFUL,
            f"{event.seconds:.1f} s of the recording are missing while the robot drove: it moved "
            f"some {event.expected:.1f} m by its speed, {event.moved:.1f} m by the scans",
            PARTS_ALONE,
        )
        for event in found
    ][:MAX_PLACES]


def _is_made_up_for(event: Event, met: Encounters, shifts: FloatArray, content: MapContent) -> bool:
    """Return whether closures have put right what is missing in a gap."""
    nodes = content.graph.node_poses[_nodes_around(event, content), :2]
    moved = float(np.hypot(*(nodes[1] - nodes[0])))
    if (
        (1.0 - MOVED_SHARE) * event.expected > MAX_UNSURE_M
        or moved < MOVED_SHARE * event.expected
        or not is_bridged(event, met, content)
    ):
        return False
    bridges = _bridges(event, met, content)
    rows = examined(len(met))
    rows = rows[bridges[rows]]
    if len(rows) == 0 or float(np.mean(are_here(shifts[rows]))) < MEASURED_SHARE:
        return False
    agree = np.flatnonzero(bridges & ~met.contradicts)
    is_confirmed = nodes_between(met, agree, content.graph.num_nodes)
    parts = np.split(is_confirmed, [_nodes_around(event, content)[1]])
    return max(float(np.mean(part)) for part in parts if len(part)) >= CONFIRMED_SHARE


def _nodes_around(event: Event, content: MapContent) -> list[int]:
    """Return the nodes before and after an event.

    Of a gap that closures have put right, scans in between may be placed by the node on the other
    side.
    """
    after = int(np.searchsorted(content.node_scan_index, event.scan))
    last = len(content.node_scan_index) - 1
    return [min(max(after - 1, 0), last), min(after, last)]


def misfit_places(found: list[Event], met: Encounters, content: MapContent) -> list[Place]:
    """Return the places of gaps across which scans do not fit; minor ones where others do."""
    places = []
    for event in found:
        severity = Severity.MINOR if is_bridged(event, met, content) else Severity.DOUBTFUL
        places.append(
            at_scan(
                event,
                content,
                Kind.GAP,
                severity,
                f"{event.seconds:.1f} s of the recording are missing, and the scans before and "
                "after it do not fit to each other: the robot was moved or turned",
                PARTS_ALONE,
            )
        )
    return places[:MAX_PLACES]


def is_bridged(event: Event, met: Encounters, content: MapContent) -> bool:
    """Return whether visits after an event agree with what was seen before it."""
    bridges = _bridges(event, met, content)
    agrees = float(met.length[bridges & ~met.contradicts].sum())
    share = agrees / max(float(met.length[bridges].sum()), 1e-9)
    return agrees >= BRIDGED_M and share >= BRIDGED_SHARE


def _bridges(event: Event, met: Encounters, content: MapContent) -> BoolArray:
    """Return which encounters compare what was seen before and after an event."""
    node = _nodes_around(event, content)[1]
    first, own = met.pairs.node[met.first], met.pairs.own_node[met.first]
    # At the event itself scans agree with what is seen through it, however wrong it is.
    place = content.trajectory[event.scan, :2]
    away = np.hypot(*(content.graph.node_poses[first, :2] - place).T) > BRIDGE_AWAY_M
    bridges: BoolArray = ((first >= node) != (own >= node)) & away
    return bridges


def jump_places(found: list[Event], met: Encounters, content: MapContent) -> list[Place]:
    """Return the places where the pose jumped; minor ones where visits across them agree.

    A robot that is pushed while its wheels stand jumps, too.
    """
    return [
        at_scan(
            event,
            content,
            Kind.JUMP,
            Severity.MINOR if is_bridged(event, met, content) else Severity.DOUBTFUL,
            f"the pose jumps by {event.moved:.1f} m from one scan to the next",
            "the odometry may have jumped: try --set local_slam.use_odometry=false; "
            "`cartoloop doctor` examines it",
        )
        for event in found
    ][:MAX_PLACES]


def without_gaps(found: list[Event], others: list[Event], content: MapContent) -> list[Event]:
    """Return the events but those between the same two nodes as some gaps: these are gaps, too."""
    gaps = {_nodes_around(event, content)[1] for event in others}
    return [event for event in found if _nodes_around(event, content)[1] not in gaps]


TAKEN_BACK_M = 2.0
"""Path to either side of a tear within which the finished map may go on as the scans do [m]."""

FEW_TEARS, TEAR_EVERY_M = 2, 100.0
"""This number of tears that are taken back, or one on so much path [m], is small: false closures
are found in any building. Where they are many, there are others that tear nothing, and displace
more."""


def tear_places(found: list[Event], content: MapContent) -> list[Place]:
    """Return the places where the graph tears the path apart, the largest.

    Minor ones where a few scans alone are elsewhere, as by a loop closure of one node that is
    false: what is before and after it lies to each other as the scans have it.
    """
    found = sorted(found, key=lambda event: -event.moved)
    are_taken_back = [_is_taken_back(event, content) for event in found]
    length = float(path_steps(content.local_trajectory).sum())
    are_few = sum(are_taken_back) <= max(FEW_TEARS, length / TEAR_EVERY_M)
    return [
        at_scan(
            event,
            content,
            Kind.JUMP,
            Severity.MINOR if are_few and is_taken_back else Severity.DOUBTFUL,
            f"the path is torn: {event.moved:.1f} m from one scan to the next, "
            f"{event.expected:.1f} m by the scans",
            "pins or loop closures contradict each other: `cartoloop edit` undoes a pin or drops "
            "a closure",
        )
        for event, is_taken_back in zip(found, are_taken_back, strict=True)
    ][:MAX_PLACES]


def _is_taken_back(event: Event, content: MapContent) -> bool:
    """Return whether scans shortly before and after a tear lie as they were matched."""
    poses, by_scans = content.trajectory, content.local_trajectory
    paths = np.concatenate(([0.0], np.cumsum(path_steps(by_scans))))
    away = paths - paths[event.scan]
    near = np.flatnonzero(np.abs(away) <= TAKEN_BACK_M)
    after = near[near >= event.scan]
    for before in near[near < event.scan].tolist():
        apart = relative_all(poses[before], poses[after])
        apart -= relative_all(by_scans[before], by_scans[after])
        if np.any(np.hypot(apart[:, 0], apart[:, 1]) <= MIN_JUMP_M):
            return True
    return False


BRIDGED_BLIND_ERROR_M = 0.15
"""Expected error of a length without a match [m] from which it is doubtful though visits across it
agree: they hold its ends, not what lies beyond, and the error of the heading comes on top."""


def blind_places(
    found: list[Event],
    met: Encounters,
    odometry: Mapping[str, Any] | None,
    content: MapContent,
    config: QualityConfig,
) -> list[Place]:
    """Return the places where scans show little or nothing.

    Minor ones where visits across them agree and the odometry measures well. Without odometry
    visits hold the ends only: the robot may have turned anywhere between them.

    Parameters
    ----------
    odometry : its calibration, as in the report; None without odometry.
    """
    places = []
    for event in found:
        error, rest_on = math.inf, "constant velocity, without odometry"
        if has_odometry(odometry) and not _is_without_odometry(event, odometry, content):
            error, rest_on = length_error(event.moved, odometry), "the odometry"
        is_held = error <= BRIDGED_BLIND_ERROR_M and is_bridged(event, met, content)
        is_short = event.moved <= config.doubtful_blind_length
        places.append(
            at_scan(
                event,
                content,
                Kind.BLIND,
                Severity.MINOR if is_short or is_held else Severity.DOUBTFUL,
                f"scans show little or nothing over {event.moved:.1f} m: they rest on {rest_on}",
                "the surroundings may be farther away than sensor.max_range; drive along a wall, "
                "or through the place once more",
            )
        )
    return places[:MAX_PLACES]


def _is_without_odometry(
    event: Event, odometry: Mapping[str, Any] | None, content: MapContent
) -> bool:
    """Return whether the odometry was left out at either end of a stretch."""
    end = float(content.stamps[event.scan])
    return bool(np.any(without_odometry(np.array((end - event.seconds, end)), odometry)))


STANDS_CHANGED, STANDS_CHANGED_LONG, STANDS_CHANGED_CORRIDOR = 0.35, 0.12, 0.04
STANDS_S, STANDS_LONG_S = 10.0, 20.0
"""Poses that stand still for so long [s] while this share of the returns moves from node to node
are stuck: people make up a tenth. In a corridor less moves, only what stands out from its walls; of
some hundred returns there, three that graze an edge move where the robot stands, too."""

STANDS_BY_ODOMETRY = 2.0
"""Factor of these shares where odometry shows that it stands: more people than usual do."""


def standing_places(
    found: list[Standing],
    halls: Corridors,
    odometry: Mapping[str, Any] | None,
    content: MapContent,
) -> list[Place]:
    """Return the places where poses stand still though the scans change.

    Or though the robot may have moved, for all that the scans of bare walls and odometry show.

    Parameters
    ----------
    odometry : its calibration, as in the report; None without odometry.
    """
    places = []
    has_none = without_odometry(stamps_of(content, np.arange(content.graph.num_nodes)), odometry)
    usual = cache(lambda: usual_change(content))
    for stand in found:
        if stand.seconds < STANDS_S:
            continue
        in_corridor = _is_in_corridor(halls, stand.first, stand.last)
        limit = _usual_limit(stand, in_corridor=in_corridor)
        if not np.any(has_none[stand.first : stand.last + 1]):
            limit *= STANDS_BY_ODOMETRY
        # What usually changes takes long to measure, and few get so far.
        if stand.changed >= limit and stand.changed >= limit + usual():
            what = f"{100 * stand.changed:.0f}% of the returns change"
        elif (
            in_corridor
            and has_none[stand.last]
            and gain_elsewhere(content, stand.first) >= MEASURED_GAIN
        ):
            what = "the walls there look alike from elsewhere, and no odometry shows that it does"
        else:
            continue
        nodes = np.arange(stand.first, stand.last + 1)
        places.append(
            place_around(
                content.graph.node_poses[nodes, :2],
                stamps_of(content, nodes),
                Kind.CORRIDOR,
                Severity.DOUBTFUL,
                f"the pose stands still for {stand.seconds:.0f} s, but {what}",
                "the robot probably moved and no scan showed by how far: record with odometry that "
                "works; `cartoloop doctor` examines it",
            )
        )
    return places[:MAX_PLACES]


def _usual_limit(stand: Standing, *, in_corridor: bool) -> float:
    """Return the share of the returns that move around a robot which stands."""
    if stand.seconds < STANDS_LONG_S:
        return STANDS_CHANGED
    return STANDS_CHANGED_CORRIDOR if in_corridor else STANDS_CHANGED_LONG


def _is_in_corridor(halls: Corridors, first: int, last: int) -> bool:
    chosen = (halls.nodes >= first - 3) & (halls.nodes <= last + 3)
    return bool(np.any(chosen)) and float(np.mean(halls.is_corridor[chosen])) > 0.5
