# SPDX-License-Identifier: Apache-2.0
"""Simulated recordings as files: the log as a robot writes it, and, apart from it, the truth."""

from __future__ import annotations

import gzip
import io
import math
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cartoloop.errors import OutputError
from cartoloop.sensor.pose import Pose, compose, relative_all

if TYPE_CHECKING:
    from cartoloop.simulation.lidar import Lidar
    from cartoloop.simulation.recording import Recording

FloatArray = NDArray[np.float64]

# Relations: neighbours lie this far apart along the way; a loop pair is near again after a detour.
NEIGHBOUR_DISTANCE = (0.3, 3.0)
LOOP_DETOUR = 20.0
LOOP_DISTANCE = 2.0


def write_carmen(recording: Recording, path: Path, range_decimals: int = 3) -> None:
    """Write a CARMEN log of the scans and the odometry.

    Scanners of 180 degrees on the robot's axis become FLASER lines, whose readers infer the
    angles from the number of beams; others become ROBOTLASER1 lines, which state the angles and
    the scanner's place. All poses in the log are odometry.

    Parameters
    ----------
    recording : what to write.
    path : of the log; gzip-compressed if it ends in ``.gz``.
    range_decimals : digits of a range after the point.

    Raises
    ------
    OutputError
        When the file cannot be written.
    """
    _write(path, _carmen_lines(recording, range_decimals))


def write_truth(recording: Recording, path: Path) -> None:
    """Write the true poses as a TUM trajectory: ``stamp tx ty tz qx qy qz qw`` for each scan.

    Raises
    ------
    OutputError
        When the file cannot be written.
    """
    rows = zip(recording.stamps.tolist(), recording.true_poses.tolist(), strict=True)
    _write(
        path,
        (
            f"{stamp:.6f} {x:.9f} {y:.9f} 0 0 0 "
            f"{math.sin(theta / 2):.9f} {math.cos(theta / 2):.9f}\n"
            for stamp, (x, y, theta) in rows
        ),
    )


def write_relations(
    recording: Recording, path: Path, num_relations: int = 1000, seed: int = 0
) -> None:
    """Write true relations, ``stamp1 stamp2 x y z roll pitch yaw``: the pose of 2 as seen from 1.

    Half of them join neighbours, half join scans of one place on different passes, as far as
    there are such.

    Raises
    ------
    OutputError
        When the file cannot be written.
    """
    pairs = relation_pairs(recording.true_poses, num_relations, seed)
    steps = relative_all(recording.true_poses[pairs[:, 0]], recording.true_poses[pairs[:, 1]])
    stamps = recording.stamps[pairs]
    _write(
        path,
        (
            f"{stamp_1:.6f} {stamp_2:.6f} {x:.9f} {y:.9f} 0 0 0 {theta:.9f}\n"
            for (stamp_1, stamp_2), (x, y, theta) in zip(
                stamps.tolist(), steps.tolist(), strict=True
            )
        ),
    )


def relation_pairs(true_poses: FloatArray, num_relations: int, seed: int = 0) -> NDArray[np.int64]:
    """Return the scans that relations join, earlier one first, sorted, int64, shape (m, 2).

    Parameters
    ----------
    true_poses : float64, shape (n, 3), x [m], y [m], theta [rad], map frame.
    num_relations : how many to draw; there are fewer where too few scans are near each other.
    seed : of the sample.
    """
    rng = np.random.default_rng(seed)
    steps = np.hypot(*np.diff(true_poses[:, :2], axis=0).T)
    travelled = np.concatenate(([0.0], np.cumsum(steps)))
    nearest, farthest = NEIGHBOUR_DISTANCE
    neighbours: set[tuple[int, int]] = set()
    loops: set[tuple[int, int]] = set()
    for first in rng.permutation(len(true_poses)).tolist():
        ahead = travelled - travelled[first]
        apart = np.hypot(*(true_poses[:, :2] - true_poses[first, :2]).T)
        for wanted, pairs in (
            ((ahead >= nearest) & (ahead <= farthest), neighbours),
            ((ahead > LOOP_DETOUR) & (apart < LOOP_DISTANCE), loops),
        ):
            candidates = np.flatnonzero(wanted)
            if len(candidates) and len(pairs) < num_relations // 2:
                pairs.add((first, int(rng.choice(candidates))))
        if min(len(neighbours), len(loops)) >= num_relations // 2:
            break
    return np.array(sorted(neighbours | loops), dtype=np.int64).reshape(-1, 2)


def _carmen_lines(recording: Recording, range_decimals: int) -> Iterator[str]:
    """Yield the lines of the log."""
    lidar = recording.lidar
    mount = lidar.tf_tracking_sensor
    yield "# message_name [message contents] ipc_timestamp ipc_hostname logger_timestamp\n"
    yield f"# simulated: {recording.name}\n"
    yield f"PARAM robot_frontlaser_offset {mount.x:.6f}\n"
    yield f"PARAM robot_front_laser_max {lidar.range_max:.6f}\n"
    on_axis = mount.y == 0.0 and mount.theta == 0.0
    states_angles = not (on_axis and _angles_are_inferred(lidar))
    head = f"FLASER {lidar.num_beams} "
    if states_angles:
        head = (
            f"ROBOTLASER1 0 {lidar.angle_min:.9f} {lidar.field_of_view:.9f} "
            f"{lidar.angle_increment:.9f} {lidar.range_max:.6f} {lidar.range_noise:.6f} 0 "
            f"{lidar.num_beams} "
        )
    ranges_format = " ".join([f"%.{range_decimals}f"] * lidar.num_beams)
    first_stamp = float(recording.stamps[0])
    for stamp, ranges, odometry in zip(
        recording.stamps.tolist(), recording.ranges, recording.odometry_poses.tolist(), strict=True
    ):
        robot = Pose(*odometry)
        if states_angles:
            poses = f"0 {_pose(compose(robot, mount))} {_pose(robot)} 0 0 0 0 0"
        else:
            poses = f"{_pose(robot)} {_pose(robot)}"
        times = f"{stamp:.6f} simulator {stamp - first_stamp:.6f}"
        yield f"{head}{ranges_format % tuple(ranges.tolist())} {poses} {times}\n"


def _angles_are_inferred(lidar: Lidar) -> bool:
    """Return whether readers of FLASER lines infer these angles from the number of beams."""
    step_deg = {180: 1.0, 181: 1.0, 360: 0.5, 361: 0.5}.get(lidar.num_beams, math.inf)
    same_step = abs(lidar.angle_increment - math.radians(step_deg)) < 1e-9
    return same_step and abs(lidar.angle_min + math.pi / 2) < 1e-9


def _pose(pose: Pose) -> str:
    return f"{pose.x:.6f} {pose.y:.6f} {pose.theta:.6f}"


def _write(path: Path, lines: Iterable[str]) -> None:
    """Write lines beside `path`, then put the finished file in its place: whole or not at all."""
    unfinished = path.with_name(f"{path.name}.part")
    try:
        with ExitStack() as files:
            raw = files.enter_context(unfinished.open("wb"))
            target: io.BufferedIOBase = raw
            if path.suffix == ".gz":
                # Neither time nor name in the header: same recording, same bytes.
                target = files.enter_context(
                    gzip.GzipFile(filename="", mode="wb", fileobj=raw, mtime=0, compresslevel=6)
                )
            for line in lines:
                target.write(line.encode("ascii"))
        unfinished.replace(path)
    except BaseException as error:
        with suppress(OSError):
            unfinished.unlink(missing_ok=True)
        if isinstance(error, OSError):
            reason = error.strerror or error
            raise OutputError(f"cannot write {path}: {reason}; choose another place") from error
        raise
