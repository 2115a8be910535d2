# SPDX-License-Identifier: Apache-2.0
"""Statistics and checks of odometry, and of its agreement with the scans."""

from __future__ import annotations

import math
from array import array
from dataclasses import dataclass, field

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.doctor.findings import Finding, first_of
from cartoloop.local_slam.odometry_parameters import OdometryParameters
from cartoloop.local_slam.odometry_track import JUMPING_SHARE, MANY_JUMPS
from cartoloop.local_slam.reading_period import ReadingPeriod
from cartoloop.quality.odometry_use import TURNS_ADVICE, TURNS_AGAINST
from cartoloop.quality.odometry_warnings import (
    UNITS_ADVICE,
    off_scale,
    scale_at_limit,
    turned_by,
    turned_text,
)
from cartoloop.sensor.events import Odometry
from cartoloop.sensor.pose import IDENTITY, Pose, relative, wrap_angle

JUMP_M, JUMP_SPEED = 1.0, 5.0
"""Length [m] and speed [m/s] above which a step is a jump of the odometry: no robot is as fast."""

JUMP_RAD, JUMP_RATE = 1.5, 10.0
"""Rotation [rad] and rate [rad/s] above which a step is a jump."""

SHORTEST_STEP_S = 0.02
"""Lower limit of a step's duration [s]: repaired times may be closer than the measurements."""

LATE_S, VERY_LATE_S = 0.03, 0.1
"""Time offsets worth knowing, and worth a warning [s]: at 1 rad/s, 2 and 6 degrees."""

OFF_SCALE, VERY_OFF_SCALE = 0.05, 0.15
"""Errors of the scale worth knowing, and worth a warning."""

VEER, STRONG_VEER = math.radians(0.5), math.radians(3.0)
"""Turns on a metre worth knowing, and worth a warning [rad/m]."""


@dataclass(slots=True)
class OdometryWatch:
    """Statistics of odometry; memory grows by three numbers per reading.

    Attributes
    ----------
    name : of the topic or the lines.
    stamps, times, turns : of each reading: [s], [s], rotation since the first [rad].
    path_length : length of the path without jumps [m].
    turned : total absolute rotation [rad].
    fastest, fastest_turn : [m/s], [rad/s], jumps left out.
    num_jumps, first_jump : impossible steps; stamp of the first.
    num_turn_jumps : those of them that turn too far and are not too long.
    num_bad : poses that are not finite.
    period : how often it is read.
    """

    name: str = "odometry"
    stamps: array[float] = field(default_factory=lambda: array("d"))
    times: array[float] = field(default_factory=lambda: array("d"))
    turns: array[float] = field(default_factory=lambda: array("d"))
    path_length: float = 0.0
    turned: float = 0.0
    fastest: float = 0.0
    fastest_turn: float = 0.0
    num_jumps: int = 0
    num_turn_jumps: int = 0
    first_jump: float | None = None
    num_bad: int = 0
    period: ReadingPeriod = field(default_factory=ReadingPeriod)
    _last: Pose | None = None

    @property
    def count(self) -> int:
        """Number of readings."""
        return len(self.stamps)

    def add(self, odometry: Odometry) -> None:
        """Add a reading."""
        pose = odometry.tf_odom_tracking
        if not all(map(math.isfinite, pose)):
            self.num_bad += 1
            return
        self.period.add(odometry.time, pose)
        turn = self.turns[-1] if self.turns else 0.0
        if self._last is not None:
            step = relative(self._last, pose)
            length, angle = math.hypot(step.x, step.y), abs(step.theta)
            took = max(odometry.time - self.times[-1], SHORTEST_STEP_S)
            is_far = length > JUMP_M and length > JUMP_SPEED * took
            if is_far or (angle > JUMP_RAD and angle > JUMP_RATE * took):
                self.num_jumps += 1
                self.num_turn_jumps += not is_far
                self.first_jump = first_of(self.first_jump, odometry.stamp)
            else:
                self.path_length += length
                self.turned += angle
                self.fastest = max(self.fastest, length / took)
                self.fastest_turn = max(self.fastest_turn, angle / took)
            turn += step.theta
        self._last = pose
        self.stamps.append(odometry.stamp)
        self.times.append(odometry.time)
        self.turns.append(turn)

    def turned_until(self, times: FloatArray) -> FloatArray:
        """Return how far the robot had turned to either side at some times [rad]."""
        turned = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(self.turns)))))
        return np.interp(times, np.asarray(self.times), turned)


def check_odometry(
    watch: OdometryWatch,
    model: OdometryParameters | None,
    *,
    is_mirrored: bool = False,
    mounting: Pose = IDENTITY,
) -> list[Finding]:
    """Return what is wrong with the odometry.

    Parameters
    ----------
    model : as calibrated against the scans; None if it was not.
    is_mirrored : whether it turns to the other side than the scans.
    mounting : pose of the main scanner on the robot.
    """
    if watch.count == 0 and not watch.num_bad:
        return [
            Finding(
                "info",
                "no_odometry",
                "there is no odometry",
                "scans are matched without; if the robot has any, record it: turns and corridors "
                "come out better",
            )
        ]
    found = [check_finite(watch), check_jumps(watch), check_moves(watch), check_period(watch)]
    if is_mirrored:
        found.append(check_side(watch))
    elif model is not None:
        found += [
            check_agreement(watch, model),
            check_offset(watch, model),
            check_units(watch, model) or check_scale(watch, model),
            check_yaw(watch, model, mounting),
            check_veer(watch, model),
        ]
    return [finding for finding in found if finding is not None]


def check_finite(watch: OdometryWatch) -> Finding | None:
    """Poses that are no numbers."""
    if not watch.num_bad:
        return None
    return Finding(
        "warning",
        "odometry_not_finite",
        f"{watch.num_bad} odometry poses are NaN or infinite",
        "they are skipped; check the odometry's driver",
        watch.name,
        watch.num_bad,
    )


def check_jumps(watch: OdometryWatch) -> Finding | None:
    """Steps that no robot makes: the odometry was reset."""
    if not watch.num_jumps:
        return None
    remedy = "record the raw wheel odometry, not a pose that something corrects"
    if watch.num_jumps >= MANY_JUMPS and watch.num_jumps >= JUMPING_SHARE * watch.count:
        is_turning = watch.num_turn_jumps > watch.num_jumps / 2
        remedy = "is its heading in degrees?" if is_turning else "is it in millimetres?"
        remedy += " metres and radians are expected; otherwise, something corrects the pose"
    return Finding(
        "warning",
        "odometry_jumps",
        f"the odometry jumps at {watch.num_jumps} of {watch.count - 1} steps",
        remedy,
        watch.name,
        watch.num_jumps,
        watch.first_jump,
    )


def check_moves(watch: OdometryWatch) -> Finding | None:
    """A pose that never changes."""
    if watch.path_length > 0.0 or watch.turned > 0.0 or watch.count < 10:
        return None
    return Finding(
        "warning",
        "odometry_still",
        "the odometry never moves",
        "if the robot did, check the odometry's driver; --odom-topic none leaves it out",
        watch.name,
        watch.count,
    )


def check_period(watch: OdometryWatch) -> Finding | None:
    """Readings that are sent again until the next one."""
    if not watch.period.are_held:
        return None
    return Finding(
        "info",
        "odometry_held",
        f"the odometry is read each {watch.period.usual_s:.2g} s, and repeated in between",
        "the robot is taken to move in between; faster readings give better maps in corridors",
        watch.name,
        watch.count,
    )


def check_agreement(watch: OdometryWatch, model: OdometryParameters) -> Finding | None:
    """Motion that the scans do not confirm."""
    if model.is_known or watch.path_length < 3.0:
        return None
    return Finding(
        "warning",
        "odometry_disagrees",
        "the motion of the odometry does not agree with the scans",
        "the scans are believed; check frames, units and stamps, or give --odom-topic none",
        watch.name,
        watch.count,
    )


def check_side(watch: OdometryWatch) -> Finding:
    """Turns to the other side than those of the scans."""
    return Finding(
        "warning", "odometry_mirrored", TURNS_AGAINST, TURNS_ADVICE, watch.name, watch.count
    )


def check_offset(watch: OdometryWatch, model: OdometryParameters) -> Finding | None:
    """A constant offset between the clocks of odometry and scans."""
    if not model.is_known or abs(model.time_offset) < LATE_S:
        return None
    late = model.time_offset > 0.0
    return Finding(
        "warning" if abs(model.time_offset) >= VERY_LATE_S else "info",
        "odometry_offset",
        f"odometry is {abs(model.time_offset):.2f} s {'newer' if late else 'older'} than the scan "
        "of the same stamp",
        "estimated and made good while mapping; stamp both when they are measured",
        watch.name,
        watch.count,
    )


def check_units(watch: OdometryWatch, model: OdometryParameters) -> Finding | None:
    """Distances or turns that no usual scale makes those of the scans."""
    what = scale_at_limit(model.summary())
    if what is None:
        return None
    return Finding(
        "warning", "odometry_units", off_scale(what), UNITS_ADVICE, watch.name, watch.count
    )


def check_yaw(watch: OdometryWatch, model: OdometryParameters, mounting: Pose) -> Finding | None:
    """A direction that is not ahead by the scanner's pose."""
    yaw = turned_by(model.summary())
    if yaw is None:
        return None
    pose = f"{mounting.x:.3g},{mounting.y:.3g},{wrap_angle(mounting.theta - yaw):.2f}"
    return Finding(
        "warning",
        "odometry_yaw",
        turned_text(yaw),
        f"estimated and made good while mapping; if the scanner's yaw is wrong, give "
        f"--laser-pose={pose}, or correct its pose in the recording",
        watch.name,
        watch.count,
    )


def check_scale(watch: OdometryWatch, model: OdometryParameters) -> Finding | None:
    """Distances or turns that are reported too long or too short."""
    if not model.is_known:
        return None
    off = {"turns": model.rotation_scale - 1.0, "distances": model.translation_scale - 1.0}
    worst = max(map(abs, off.values()))
    if worst < OFF_SCALE:
        return None
    shown = ", ".join(
        f"{what} {100 * abs(by):.0f}% too {'short' if by > 0.0 else 'long'}"
        for what, by in off.items()
        if abs(by) >= OFF_SCALE
    )
    return Finding(
        "warning" if worst >= VERY_OFF_SCALE else "info",
        "odometry_scale",
        f"the odometry reports {shown}",
        "estimated and made good while mapping; calibrate wheel radius and track width",
        watch.name,
        watch.count,
    )


def check_veer(watch: OdometryWatch, model: OdometryParameters) -> Finding | None:
    """Turns on each metre driven that are not reported."""
    constant, sine = model.veer.constant, math.hypot(model.veer.cos, model.veer.sin)
    if max(abs(constant), sine) < VEER:
        return None
    parts = []
    if abs(constant) >= VEER:
        side = "left" if constant > 0.0 else "right"
        parts.append(f"{math.degrees(abs(constant)):.1f} deg to the {side}")
    if sine >= VEER:
        parts.append(f"up to {math.degrees(sine):.1f} deg to a side that depends on its heading")
    return Finding(
        "warning" if max(abs(constant), sine) >= STRONG_VEER else "info",
        "odometry_veer",
        f"on each metre the robot turns {' and '.join(parts)}, which the odometry does not report",
        "estimated and made good while mapping; calibrate the radii of the wheels",
        watch.name,
        watch.count,
    )
