# SPDX-License-Identifier: Apache-2.0
"""What is wrong with odometry, by its calibration and by when it was left out: lines for people."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from cartoloop.local_slam.odometry_scale import MAX_SCALE, MIN_SCALE
from cartoloop.local_slam.odometry_track import JUMPING_SHARE, MANY_JUMPS
from cartoloop.quality.odometry_use import TURNS_ADVICE, TURNS_AGAINST, has_odometry, turns_against

MOST_JUMPS = 0.5
"""Odometry with a larger share of jumps is in other units: others are reset now and then."""

NEAR_LIMIT = 0.01
"""A scale is at its limit if it is as near to it, as a share."""

TURNED_RAD, SETTLED_NOISE_M, SETTLED_METRES = math.radians(5.0), 0.2, 10
"""A larger yaw of the odometry is worth a warning [rad], once the metres that scans measured
scatter by less than this [m] and are this number: mountings are wrong by a degree or so."""

LONG_DELAY_S = 0.3
"""Offset of the odometry's clock that may be why it was left out, at least before it was known
[s]."""

UNITS_ADVICE = "its units are probably wrong: metres and radians are expected"


def odometry_warnings(odometry: Mapping[str, Any] | None) -> list[str]:
    """Return lines about odometry that was left out, or does not fit to what is declared.

    Parameters
    ----------
    odometry : its calibration, as in the report; None without odometry.
    """
    if odometry is None:
        return []
    lines = (_jumping(odometry), fault_warning(odometry), _units(odometry), _turned(odometry))
    return [line for line in lines if line is not None]


def side_warning(odometry: Mapping[str, Any] | None) -> str | None:
    """Return a line about odometry that turns to the other side than the scans, or None."""
    return f"{TURNS_AGAINST}; {TURNS_ADVICE}" if turns_against(odometry) else None


def fault_warning(odometry: Mapping[str, Any]) -> str | None:
    """Return a line about the times when the odometry was left out; None if there are none."""
    faults = odometry.get("faults", [])
    if not faults:
        return None
    first = faults[0]
    until = "the end" if first["end"] is None else f"{first['end']:.1f} s"
    when = f"from {first['begin']:.1f} s to {until}"
    if len(faults) > 1:
        when = f"{len(faults)} times, first {when}"
    return f"the odometry was left out {when}: it {_what(first)}; {_fault_advice(odometry)}"


def _what(fault: Mapping[str, Any]) -> str:
    """Return what the odometry did otherwise than the scans."""
    if fault["kind"] == "moves unsteadily":
        # Its motion may be that of the scans, in the step at which that is noticed.
        return f"{fault['kind']}, and predicts the scans worse than constant velocity does"
    return (
        f"{fault['kind']} ({fault['odometry_m']:.2f} m and {fault['odometry_rad']:.2f} rad) where "
        f"the scans move {fault['matched_m']:.2f} m and {fault['matched_rad']:.2f} rad"
    )


def _fault_advice(odometry: Mapping[str, Any]) -> str:
    """Return what to check, by what was found in the end."""
    if scale_at_limit(odometry):
        return "check its units"
    offset = float(odometry.get("time_offset_s") or 0.0)
    if abs(offset) >= LONG_DELAY_S and odometry.get("rotation_error_rad") is not None:
        side = "newer" if offset > 0.0 else "older"
        return (
            f"it is {abs(offset):.2f} s {side} than the scan of the same stamp, as estimated "
            "since: stamp both when they are measured"
        )
    if turned_by(odometry) is not None:
        return "check the scanner's yaw, wheels and driver"
    return "check wheels and driver"


def _jumping(odometry: Mapping[str, Any]) -> str | None:
    """Return a line about odometry that is left out for all its jumps, or None."""
    jumps, readings = int(odometry.get("jumps", 0)), int(odometry.get("readings", 0))
    if jumps < MANY_JUMPS or not readings or jumps < JUMPING_SHARE * readings:
        return None
    advice = "is it in millimetres?" if jumps >= MOST_JUMPS * readings else "check its units"
    steps = max(readings - 1, jumps)
    return (
        f"the odometry was left out: {jumps} of its {steps} steps are longer than a robot moves, "
        f"or turn faster; {advice}"
    )


def scale_at_limit(odometry: Mapping[str, Any]) -> str | None:
    """Return which motion fits the scans by no usual scale, distances or turns; None if both do."""
    if not has_odometry(odometry):
        return None
    for name, what in (("translation_scale", "distances"), ("rotation_scale", "turns")):
        scale = float(odometry.get(name) or 1.0)
        if scale >= MAX_SCALE * (1.0 - NEAR_LIMIT) or scale <= MIN_SCALE * (1.0 + NEAR_LIMIT):
            return what
    return None


def off_scale(what: str) -> str:
    """Return a line about a scale at its limit."""
    return f"no factor from {MIN_SCALE} to {MAX_SCALE} makes the {what} of the odometry true"


def _units(odometry: Mapping[str, Any]) -> str | None:
    what = scale_at_limit(odometry)
    return None if what is None else f"{off_scale(what)}; {UNITS_ADVICE}"


def turned_by(odometry: Mapping[str, Any]) -> float | None:
    """Return the direction of the odometry in the frame that the scanner's pose declares [rad].

    None where it is as declared, up to :data:`TURNED_RAD`, or not known well.
    """
    yaw, noise = float(odometry.get("yaw_rad") or 0.0), odometry.get("metre_noise_m")
    is_settled = (
        noise is not None
        and float(noise) < SETTLED_NOISE_M
        and int(odometry.get("measured_metres") or 0) >= SETTLED_METRES
        and odometry.get("rotation_error_rad") is not None
        and scale_at_limit(odometry) is None
        and not turns_against(odometry)
    )
    return yaw if is_settled and abs(yaw) >= TURNED_RAD else None


def turned_text(yaw: float) -> str:
    """Return a line about a direction of the odometry [rad]."""
    side = "left" if yaw > 0.0 else "right"
    return (
        f"the robot drives {math.degrees(abs(yaw)):.0f} deg to the {side} of the x axis of its "
        "frame, as the scanner's pose defines it"
    )


def _turned(odometry: Mapping[str, Any]) -> str | None:
    yaw = turned_by(odometry)
    if yaw is None:
        return None
    change = "smaller" if yaw > 0.0 else "larger"
    return (
        f"{turned_text(yaw)}; estimated and made good, but poses are turned by as much: if the "
        f"scanner's yaw is wrong, it must be {abs(yaw):.2f} rad {change} (--laser-pose X,Y,YAW, or "
        "its pose in the recording)"
    )
