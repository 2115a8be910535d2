# SPDX-License-Identifier: Apache-2.0
"""Gaps in the stamps alone: the clock of the recording jumped while the robot drove on."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from cartoloop.quality.motion import Event
from cartoloop.quality.pairs import MapContent
from cartoloop.quality.places import MAX_PLACES, at_scan
from cartoloop.quality.verdict import Kind, Place, Severity
from cartoloop.sensor.pose import Pose, relative

SAME_TIME_S = 1.0
"""Ends of a gap between scans and of a pause of the odometry that differ by no more are the same
[s]: clocks of scanners are corrected by less."""

STEPS_BESIDE, USUAL_SHARE = 2, 0.5
"""A robot that drove on moved by a usual step across the gap: by this share of the mean of this
number of steps right before and after it, or of its inverse. One that stopped or was carried did
not."""

APART_M, APART_RAD, APART_SHARE = 0.05, 0.1, 0.3
"""Motions of scans and odometry that differ by no more, and no more of the larger, agree [m],
[rad]."""


def clock_jumps(
    gaps: list[Event],
    misfits: Collection[int],
    content: MapContent,
    odometry: Mapping[str, Any] | None,
) -> list[Event]:
    """Return the gaps at which only the clock jumped; `expected` is the step by the odometry.

    Parameters
    ----------
    gaps : in which the robot drove farther than its poses did.
    misfits : scans that do not fit to the one before: a carried robot does not see the same walls.
    odometry : its calibration, as in the report; None without odometry.
    """
    found = []
    for gap in gaps:
        if gap.scan in misfits:
            continue
        for pause in (odometry or {}).get("pauses", ()):
            if _is_same(gap, pause, content) and _drove_on(gap, pause, content):
                found.append(gap._replace(expected=float(pause["odometry_m"])))
                break
    return found


def _is_same(gap: Event, pause: Mapping[str, Any], content: MapContent) -> bool:
    ends = content.stamps[gap.scan - 1 : gap.scan + 1]
    apart = np.abs(ends - (float(pause["begin"]), float(pause["end"])))
    return bool(np.all(apart <= SAME_TIME_S))


def _drove_on(gap: Event, pause: Mapping[str, Any], content: MapContent) -> bool:
    """Return whether scans and odometry agree that the robot moved by a usual step."""
    poses = content.local_trajectory
    first = max(gap.scan - 1 - STEPS_BESIDE, 0)
    steps = np.hypot(*np.diff(poses[first : gap.scan + 1 + STEPS_BESIDE, :2], axis=0).T)
    usual = float(np.mean(np.delete(steps, gap.scan - 1 - first)))
    by_scans = relative(Pose(*poses[gap.scan - 1].tolist()), Pose(*poses[gap.scan].tolist()))
    length, turn = float(pause["odometry_m"]), float(pause["odometry_rad"])
    return (
        all(USUAL_SHARE * usual <= moved <= usual / USUAL_SHARE for moved in (gap.moved, length))
        and _agree(gap.moved, length, APART_M)
        and _agree(by_scans.theta, turn, APART_RAD)
    )


def _agree(one: float, other: float, apart: float) -> bool:
    return abs(one - other) <= apart + APART_SHARE * max(abs(one), abs(other))


def clock_jump_places(found: list[Event], content: MapContent) -> list[Place]:
    """Return the places at which the clock jumped; minor ones, as the map is right there."""
    return [
        at_scan(
            event,
            content,
            Kind.GAP,
            Severity.MINOR,
            f"the clock of the recording jumps by {event.seconds:.1f} s while the robot drove on: "
            f"it moved {event.expected:.2f} m by the odometry, {event.moved:.2f} m by the scans",
            "the map is right, its stamps are not: check what sets the clock of the recorder",
        )
        for event in found
    ][:MAX_PLACES]
