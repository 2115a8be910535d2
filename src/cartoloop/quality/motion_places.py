# SPDX-License-Identifier: Apache-2.0
"""Places of what the poses and times of a run say against it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, TypeGuard

import numpy as np

from cartoloop.config import QualityConfig
from cartoloop.quality.encounters import Encounters
from cartoloop.quality.motion import SMOOTHED_OVER, Corridors, Event, Standing
from cartoloop.quality.pairs import MapContent
from cartoloop.quality.places import MAX_PLACES, at_scan, extent, place_around, stamps_of
from cartoloop.quality.verdict import Kind, Place, Severity


def gap_places(found: list[Event], content: MapContent) -> list[Place]:
    """Return the places of gaps in the recording."""
    return [
        at_scan(
            event,
            content,
            Kind.GAP,
            Severity.DOUBTFUL,
            f"{event.seconds:.1f} s of the recording are missing while the robot drove: it moved "
            f"some {event.expected:.1f} m by its speed, {event.moved:.1f} m by the scans",
            "map the parts before and after it alone; record without interruption, or stand still "
            "while the recording is paused",
        )
        for event in found
    ][:MAX_PLACES]


BRIDGED_M, BRIDGED_SHARE = 5.0, 0.8
"""A gap is bridged if later visits agree with submaps of before over so much path [m], and if they
are this share of all that meet them."""


def misfit_places(found: list[Event], met: Encounters, content: MapContent) -> list[Place]:
    """Return the places of gaps across which scans do not fit; minor ones where others do."""
    places = []
    for event in found:
        is_bridged = _is_bridged(event, met, content)
        places.append(
            at_scan(
                event,
                content,
                Kind.GAP,
                Severity.MINOR if is_bridged else Severity.DOUBTFUL,
                f"{event.seconds:.1f} s of the recording are missing, and the scans before and "
                "after it do not fit to each other: the robot was moved or turned",
                "map the parts before and after it alone; record without interruption, or stand "
                "still while the recording is paused",
            )
        )
    return places[:MAX_PLACES]


def _is_bridged(event: Event, met: Encounters, content: MapContent) -> bool:
    """Return whether visits after an event agree with what was seen before it."""
    node = int(np.searchsorted(content.node_scan_index, event.scan))
    first, own = met.pairs.node[met.first], met.pairs.own_node[met.first]
    bridges = (first >= node) != (own >= node)
    agrees = float(met.length[bridges & ~met.contradicts].sum())
    share = agrees / max(float(met.length[bridges].sum()), 1e-9)
    return agrees >= BRIDGED_M and share >= BRIDGED_SHARE


def jump_places(found: list[Event], met: Encounters, content: MapContent) -> list[Place]:
    """Return the places where the pose jumped; minor ones where visits across them agree.

    A robot that is pushed while its wheels stand jumps, too.
    """
    return [
        at_scan(
            event,
            content,
            Kind.JUMP,
            Severity.MINOR if _is_bridged(event, met, content) else Severity.DOUBTFUL,
            f"the pose jumps by {event.moved:.1f} m from one scan to the next",
            "the odometry may have jumped: try --set local_slam.use_odometry=false; "
            "`cartoloop doctor` examines it",
        )
        for event in found
    ][:MAX_PLACES]


def blind_places(
    found: list[Event], met: Encounters, content: MapContent, config: QualityConfig
) -> list[Place]:
    """Return the places where nothing was matched; minor ones where visits across them agree."""
    return [
        at_scan(
            event,
            content,
            Kind.BLIND,
            Severity.DOUBTFUL
            if event.moved > config.doubtful_blind_length and not _is_bridged(event, met, content)
            else Severity.MINOR,
            f"no scan was matched over {event.moved:.1f} m: they rest on the odometry alone",
            "the surroundings may be farther away than sensor.max_range; drive along a wall, or "
            "through the place once more",
        )
        for event in found
    ][:MAX_PLACES]


STANDS_CHANGED, STANDS_CHANGED_LONG, STANDS_CHANGED_CORRIDOR = 0.35, 0.12, 0.02
STANDS_S, STANDS_LONG_S = 10.0, 20.0
"""Poses that stand still for so long [s] while this share of the returns moves from node to node
are stuck: people make up a tenth. In a corridor less moves: only what stands out from its walls."""


def standing_places(found: list[Standing], halls: Corridors, content: MapContent) -> list[Place]:
    """Return the places where poses stand still though the scans change."""
    places = []
    for stand in found:
        in_corridor = _is_in_corridor(halls, stand.first, stand.last)
        is_long = stand.seconds >= STANDS_LONG_S
        limit = STANDS_CHANGED
        if is_long:
            limit = STANDS_CHANGED_CORRIDOR if in_corridor else STANDS_CHANGED_LONG
        if stand.seconds < STANDS_S or stand.changed < limit:
            continue
        nodes = np.arange(stand.first, stand.last + 1)
        places.append(
            place_around(
                content.graph.node_poses[nodes, :2],
                stamps_of(content, nodes),
                Kind.CORRIDOR,
                Severity.DOUBTFUL,
                f"the pose stands still for {stand.seconds:.0f} s, but "
                f"{100 * stand.changed:.0f}% of the returns change",
                "the robot probably moved and no scan showed by how far: record with odometry that "
                "works; `cartoloop doctor` examines it",
            )
        )
    return places[:MAX_PLACES]


def _is_in_corridor(halls: Corridors, first: int, last: int) -> bool:
    chosen = (halls.nodes >= first - 3) & (halls.nodes <= last + 3)
    return bool(np.any(chosen)) and float(np.mean(halls.is_corridor[chosen])) > 0.5


SCALE_ERROR, SCALE_OF_ROTATION, NO_ODOMETRY_ERROR = 0.002, 1.6, 0.05
"""Expected error of a corridor's length, as a share of it: of good odometry; more for each radian
of its typical error of a step, by which bad odometry is recognised; and without odometry."""

NUM_SIGMAS = 2.0
"""Errors of a length that are to be expected, in standard deviations."""


def length_error(length: float, odometry: Mapping[str, Any] | None) -> float:
    """Return the error to be expected of a length that rests on the odometry alone [m].

    Where scans have measured some of its metres, it follows from their noise: that of the metres of
    this length, and that of the scale, which is the mean of the metres that were measured.

    Parameters
    ----------
    length : [m].
    odometry : its calibration, as in the report; None without odometry.
    """
    if not has_odometry(odometry):
        return NO_ODOMETRY_ERROR * length
    noise, num_metres = odometry.get("metre_noise_m"), odometry.get("measured_metres")
    if noise is not None and num_metres:
        return NUM_SIGMAS * float(noise) * math.sqrt(length + length**2 / int(num_metres))
    # Nothing known of turns means that there were none.
    rotation_error = float(odometry.get("rotation_error_rad") or 0.0)
    return (SCALE_ERROR + SCALE_OF_ROTATION * rotation_error) * length


def has_odometry(odometry: Mapping[str, Any] | None) -> TypeGuard[Mapping[str, Any]]:
    """Return whether odometry was used."""
    return odometry is not None and odometry.get("translation_error_m") is not None


def corridor_places(
    halls: Corridors,
    odometry: Mapping[str, Any] | None,
    content: MapContent,
    config: QualityConfig,
) -> list[Place]:
    """Return the corridors whose lengths are not well known.

    Parameters
    ----------
    odometry : its calibration, as in the report; None without odometry.
    """
    poses, places = content.graph.node_poses[:, :2], []
    rows = np.flatnonzero(halls.is_corridor)
    for run in np.split(rows, np.flatnonzero(np.diff(rows) > SMOOTHED_OVER) + 1):
        nodes = halls.nodes[run]
        if len(nodes) < 2:
            continue
        length = extent(poses[nodes])
        if (error := length_error(length, odometry)) <= config.doubtful_length_error:
            continue
        on_what = "the odometry, which is poor" if has_odometry(odometry) else "nothing else"
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
