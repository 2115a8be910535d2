# SPDX-License-Identifier: Apache-2.0
"""Simulated recordings as CARMEN logs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cartoloop.sensor.pose import Pose, compose
from cartoloop.simulation.text_writer import write_text

if TYPE_CHECKING:
    from cartoloop.simulation.lidar import Lidar
    from cartoloop.simulation.recording import Recording

FloatArray = NDArray[np.float64]


def write_carmen(
    recording: Recording,
    path: Path,
    range_decimals: int = 3,
    with_odometry: bool | None = None,
) -> None:
    """Write a CARMEN log of the scans and, if there is any, of the odometry.

    With odometry, scanners of 180 degrees on the robot's axis become FLASER lines, whose readers
    infer the angles from the number of beams; others become ROBOTLASER1 lines, which state the
    angles and the scanner's place. All poses in the log are odometry. Without odometry, scans
    become RAWLASER1 lines, which hold no poses.

    Parameters
    ----------
    recording : what to write.
    path : of the log; gzip-compressed if it ends in ``.gz``.
    range_decimals : digits of a range after the point.
    with_odometry : whether to write it; by default if the recording has it.

    Raises
    ------
    OutputError
        When the file cannot be written.
    """
    if with_odometry is None:
        with_odometry = recording.has_odometry
    write_text(path, _lines(recording, range_decimals, with_odometry))


def _lines(recording: Recording, range_decimals: int, with_odometry: bool) -> Iterator[bytes]:
    """Yield the lines of the log."""
    lidar = recording.lidar
    mount = lidar.tf_tracking_sensor
    yield b"# message_name [message contents] ipc_timestamp ipc_hostname logger_timestamp\n"
    yield f"# simulated: {recording.name}\n".encode("ascii")
    yield f"PARAM robot_frontlaser_offset {mount.x:.6f}\n".encode("ascii")
    if not with_odometry and (mount.y or mount.theta):
        yield f"PARAM robot_frontlaser_side_offset {mount.y:.6f}\n".encode("ascii")
        yield f"PARAM robot_frontlaser_angular_offset {mount.theta:.6f}\n".encode("ascii")
    yield f"PARAM robot_front_laser_max {lidar.range_max:.6f}\n".encode("ascii")
    on_axis = mount.y == 0.0 and mount.theta == 0.0
    states_angles = not (with_odometry and on_axis and _angles_are_inferred(lidar))
    head = f"FLASER {lidar.num_beams} "
    if states_angles:
        head = (
            f"{'ROBOTLASER1' if with_odometry else 'RAWLASER1'} 0 {lidar.angle_min:.9f} "
            f"{lidar.field_of_view:.9f} {lidar.angle_increment:.9f} {lidar.range_max:.6f} "
            f"{lidar.range_noise:.6f} 0 {lidar.num_beams} "
        )
    start = head.encode("ascii")
    range_text = _range_text(lidar, range_decimals)
    first_stamp = float(recording.stamps[0])
    for first, block in recording.range_blocks():
        own = slice(first, first + len(block))
        for stamp, ranges, odometry in zip(
            recording.stamps[own].tolist(),
            block.tolist(),
            recording.odometry_poses[own].tolist(),
            strict=True,
        ):
            robot = Pose(*odometry)
            if not with_odometry:
                poses = "0"  # no remissions
            elif states_angles:
                poses = f"0 {_pose(compose(robot, mount))} {_pose(robot)} 0 0 0 0 0"
            else:
                poses = f"{_pose(robot)} {_pose(robot)}"
            end = f" {poses} {stamp:.6f} simulator {stamp - first_stamp:.6f}\n"
            yield b"%s%s%s" % (start, b" ".join(map(range_text, ranges)), end.encode("ascii"))


def _range_text(lidar: Lidar, range_decimals: int) -> Callable[[float], bytes]:
    """Return what writes a range [m]; ranges in steps take few values, so each is written once."""
    if lidar.range_quantum > 0.0:
        return _KnownTexts(range_decimals).__getitem__
    return lambda value: f"{value:.{range_decimals}f}".encode("ascii")


class _KnownTexts(dict[float, bytes]):
    """Numbers as text, kept once they have been asked for."""

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
