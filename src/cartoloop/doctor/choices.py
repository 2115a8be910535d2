# SPDX-License-Identifier: Apache-2.0
"""What the mapper would use of a recording, and why."""

from __future__ import annotations

import math
from dataclasses import dataclass

from cartoloop.config import Config, SensorConfig
from cartoloop.doctor.clouds import CloudWatch
from cartoloop.doctor.contents import Contents
from cartoloop.doctor.odometry import OdometryWatch
from cartoloop.doctor.scans import ScanWatch
from cartoloop.local_slam.odometry_parameters import OdometryParameters
from cartoloop.readers.log import Log
from cartoloop.sensor.sensor_profile import SensorProfile

_ROLES = ("scan", "cloud", "odometry", "imu", "tf", "other")
_NAMES = {"cloud": "scanner", "scan": "scanner", "imu": "IMU", "tf": "transforms"}


@dataclass(frozen=True, slots=True)
class Choice:
    """A decision that depends on the recording.

    Attributes
    ----------
    what : the decision.
    value : the choice.
    why : its reason.
    """

    what: str
    value: str
    why: str


def choices_of(
    log: Log,
    contents: Contents,
    watch: ScanWatch | CloudWatch,
    odometry: OdometryWatch,
    model: OdometryParameters | None,
) -> tuple[Choice, ...]:
    """Return how the mapper would use a recording."""
    used = sorted((s for s in contents.streams if s.used), key=lambda s: _ROLES.index(s.role))
    found = [Choice(_NAMES.get(s.role, s.role), s.name, s.reason) for s in used]
    if odometry.count and not any(s.role == "odometry" for s in used):
        found.append(Choice("odometry", used[0].name, "the poses in these lines"))
    if contents.base_frame:
        found.append(Choice("tracking frame", contents.base_frame, "the trajectory is its path"))
    found.append(_ranges(log.profile))
    found.append(_free_space(log.profile, watch))
    found.append(_times(log))
    found.append(_beam_times(watch))
    if odometry.count:
        found.append(_trust(model))
    return tuple(found)


def _ranges(profile: SensorProfile) -> Choice:
    """Return which ranges are matched and mapped with the default configuration."""
    farthest = min(profile.range_max, SensorConfig().default_max_range)
    value = f"{profile.range_min:.2f} m to {farthest:.2f} m"
    if farthest < profile.range_max:
        return Choice("ranges used", value, "longer ranges clear free space, but are no walls")
    no_return = profile.no_return
    if no_return is not None and math.isfinite(no_return) and no_return > 0:
        return Choice("ranges used", value, f"{no_return:.6g} m is sent for 'no return'")
    return Choice("ranges used", value, "the scanner's limits")


def _free_space(profile: SensorProfile, watch: ScanWatch | CloudWatch) -> Choice:
    length = Config().sensor.missing_data_ray_length
    if isinstance(watch, CloudWatch):
        return Choice("no return", "clears nothing", "clouds hold no beams without a return")
    finite = watch.geometry is not None and watch.geometry.no_return_is_free
    if profile.no_return == 0.0:
        return Choice("no return", "clears nothing", "0 may be an error as well")
    if finite or profile.no_return == math.inf:
        why = "where neighbouring beams agree that they hit nothing nearer"
        return Choice("no return", f"clears {length:g} m of free space", why)
    return Choice("no return", "clears nothing", "space beyond the range limit is unknown")


def _times(log: Log) -> Choice:
    if log.time_report.is_sound:
        return Choice("times", "stamps as recorded", "all in order")
    return Choice("times", "repaired stamps", log.time_report.describe())


def _beam_times(watch: ScanWatch | CloudWatch) -> Choice:
    if watch.sweep > 0.0:
        return Choice(
            "motion in a sweep",
            "each beam at its own time",
            f"a sweep takes {1e3 * watch.sweep:.1f} ms",
        )
    return Choice("motion in a sweep", "all beams at one time", "no time between beams is recorded")


def _trust(model: OdometryParameters | None) -> Choice:
    if model is None:
        return Choice(
            "odometry's model", "found while mapping", "too little data to estimate before"
        )
    if not model.is_known:
        return Choice(
            "odometry's model", "found while mapping", "too little motion in the part tried"
        )
    turn = f" and {math.degrees(model.rotation_error):.2f} deg" if model.knows_rotation else ""
    return Choice(
        "odometry's model",
        f"{model.time_offset:+.2f} s, turns x {model.rotation_scale:.3f}, "
        f"distances x {model.translation_scale:.3f}",
        f"then a step errs by {100 * model.translation_error:.1f} cm{turn}; estimated again while "
        "mapping",
    )
