# SPDX-License-Identifier: Apache-2.0
"""Simulated recordings as text of CARMEN logs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator

from cartoloop.sensor.events import LaserScan, Odometry, SensorEvent
from cartoloop.sensor.pose import IDENTITY, Pose, compose
from cartoloop.simulation.lidar import Lidar


def lines(
    name: str,
    lidar: Lidar,
    events: Iterable[SensorEvent],
    with_odometry: bool,
    range_decimals: int = 3,
) -> Iterator[bytes]:
    """Yield the lines of a CARMEN log.

    With odometry, scanners of 180 degrees on the robot's axis become FLASER lines, whose readers
    infer the angles from the number of beams; others become ROBOTLASER1 lines, which state the
    angles and the mounting. All poses in the log are odometry; readings without a scan become
    ODOM lines. Without odometry, scans become RAWLASER1 lines, which hold no poses.

    Parameters
    ----------
    name : of the recording.
    lidar : the scanner.
    events : its scans in order of time, the odometry pose of each before it, and other readings.
    with_odometry : whether the events contain odometry.
    range_decimals : decimals of a range in metres.
    """
    mount = lidar.tf_tracking_sensor
    has_angles = not (
        with_odometry and mount.y == 0.0 and mount.theta == 0.0 and _angles_are_inferred(lidar)
    )
    yield from _header(name, lidar, with_odometry)
    start = f"FLASER {lidar.num_beams} "
    if has_angles:
        start = (
            f"{'ROBOTLASER1' if with_odometry else 'RAWLASER1'} 0 {lidar.angle_min:.9f} "
            f"{lidar.field_of_view:.9f} {lidar.angle_increment:.9f} {lidar.range_max:.6f} "
            f"{lidar.range_noise:.6f} 0 {lidar.num_beams} "
        )
    range_text = _range_text(lidar, range_decimals)
    robot, first_stamp = IDENTITY, None
    alone: Odometry | None = None  # the last reading, as long as no scan has it
    for event in events:
        if isinstance(event, Odometry):
            if alone is not None:
                yield _odometry_line(alone, first_stamp)
            robot, alone = event.tf_odom_tracking, event
        elif isinstance(event, LaserScan):
            first_stamp = event.stamp if first_stamp is None else first_stamp
            alone = None
            if not with_odometry:
                poses = "0"  # no remissions
            elif has_angles:
                poses = f"0 {_pose(compose(robot, mount))} {_pose(robot)} 0 0 0 0 0"
            else:
                poses = f"{_pose(robot)} {_pose(robot)}"
            yield b"%s%s %s\n" % (
                start.encode("ascii"),
                b" ".join(map(range_text, event.ranges.tolist())),
                f"{poses} {event.stamp:.6f} simulator {event.stamp - first_stamp:.6f}".encode(),
            )
    if alone is not None:
        yield _odometry_line(alone, first_stamp)


def _odometry_line(reading: Odometry, first_stamp: float | None) -> bytes:
    """Return a reading that no scan has, its speeds 0: they are not known."""
    since = 0.0 if first_stamp is None else reading.stamp - first_stamp
    text = (
        f"ODOM {_pose(reading.tf_odom_tracking)} 0 0 0 {reading.stamp:.6f} simulator {since:.6f}\n"
    )
    return text.encode("ascii")


def _header(name: str, lidar: Lidar, with_odometry: bool) -> Iterator[bytes]:
    """Yield comments and parameters."""
    mount = lidar.tf_tracking_sensor
    yield b"# message_name [message contents] ipc_timestamp ipc_hostname logger_timestamp\n"
    yield f"# simulated: {name}\n".encode("ascii")
    yield f"PARAM robot_frontlaser_offset {mount.x:.6f}\n".encode("ascii")
    if not with_odometry and (mount.y or mount.theta):
        yield f"PARAM robot_frontlaser_side_offset {mount.y:.6f}\n".encode("ascii")
        yield f"PARAM robot_frontlaser_angular_offset {mount.theta:.6f}\n".encode("ascii")
    yield f"PARAM robot_front_laser_max {lidar.range_max:.6f}\n".encode("ascii")


def _range_text(lidar: Lidar, range_decimals: int) -> Callable[[float], bytes]:
    """Return the formatter of a range [m]; quantized ranges have few values, which are cached."""
    if lidar.range_quantum > 0.0:
        return _KnownTexts(range_decimals).__getitem__
    return lambda value: f"{value:.{range_decimals}f}".encode("ascii")


class _KnownTexts(dict[float, bytes]):
    """A cache of numbers as text."""

    def __init__(self, decimals: int) -> None:
        super().__init__()
        self._decimals = decimals

    def __missing__(self, value: float) -> bytes:
        text = self[value] = f"{value:.{self._decimals}f}".encode("ascii")
        return text


def _angles_are_inferred(lidar: Lidar) -> bool:
    """Return whether readers of FLASER lines infer these angles from the number of beams."""
    step_deg = {180: 1.0, 181: 1.0, 360: 0.5, 361: 0.5}.get(lidar.num_beams, math.inf)
    same_step = abs(lidar.angle_increment - math.radians(step_deg)) < 1e-9
    return same_step and abs(lidar.angle_min + math.pi / 2) < 1e-9


def _pose(pose: Pose) -> str:
    return f"{pose.x:.6f} {pose.y:.6f} {pose.theta:.6f}"
