# SPDX-License-Identifier: Apache-2.0
"""Drives with a map that they did not make, and where they truly are in it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from pathlib import Path

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.config import Config
from cartoloop.first_pass import calibrate
from cartoloop.mapper import Mapper
from cartoloop.readers import open_log
from cartoloop.result import Result
from cartoloop.sensor.events import LaserScan, Odometry, SensorEvent
from cartoloop.sensor.pose import (
    IDENTITY,
    Pose,
    compose,
    compose_all,
    inverse,
    relative,
    relative_all,
    wrap_angles,
)
from cartoloop.simulation import World, drive, make_world, simulate
from cartoloop.stop_request import StopRequest

LEVER_M = 1.0
"""A heading that differs by a radian counts as this distance for the choice of the nearest [m]."""

MIN_WALLS, MAX_BOX_M = 4, 3.0
"""Furniture of the simulator: at least this number of connected walls, up to this long [m]."""

MOVED_SHARE = 0.2
"""Share of the furniture that is moved."""


@dataclass
class Drive:
    """Events of a robot, and its true poses in a map.

    Attributes
    ----------
    name : of the drive.
    result : the map; made of other scans.
    events : odometry and scans, in turn.
    truth : float64, shape (n, 3), tf_map_tracking of each scan.
    map_errors : float64, by how far the scans that made the map lie from the truth in it [m]; empty
        where that is not known.
    tf_map_world : of a simulated world.
    """

    name: str
    result: Result
    events: list[SensorEvent]
    truth: FloatArray
    map_errors: FloatArray = field(default_factory=lambda: np.zeros(0))
    tf_map_world: Pose = IDENTITY

    @cached_property
    def scan_places(self) -> IntArray:
        """Where in `events` the scans are, shape (n,)."""
        return np.array(
            [i for i, event in enumerate(self.events) if isinstance(event, LaserScan)],
            dtype=np.int64,
        )

    def from_scan(self, first: int) -> Iterator[SensorEvent]:
        """Yield the events from a scan on, and the reading just before it."""
        yield from self.events[max(int(self.scan_places[first]) - 1, 0) :]


@dataclass
class CutRecording:
    """A recording whose first half made the map.

    Attributes
    ----------
    path : of the recording.
    share : of its scans that made the map.
    """

    path: Path
    share: float = 0.5
    config: Config = field(default_factory=Config)

    def drive(self) -> Drive:
        """Map the recording whole and its first part, and return the rest as a drive.

        The truth is a scan's pose relative to the nearest scan of the first part, as the whole run
        has it: what bends the one map against the other does not count.
        """
        log = open_log(self.path)
        events = list(log)
        scans = [i for i, event in enumerate(events) if isinstance(event, LaserScan)]
        cut = scans[int(self.share * len(scans))]
        calibration = calibrate(log, self.config, StopRequest())
        whole, first = (
            mapped(part, Mapper(self.config, calibration=calibration))
            for part in (events, events[:cut])
        )
        num_first = len(first.stamps)
        rest = whole.trajectory[num_first:]
        truth = _in_first_map(whole.trajectory[:num_first], first.trajectory, rest)
        drive = Drive(self.path.name.split(".")[0], first, events[cut:], truth)
        if len(drive.scan_places) != len(truth):  # scans that were skipped have no pose
            drive.events = [e for e in drive.events if not _is_skipped(e, set(whole.stamps))]
        return drive


def _is_skipped(event: SensorEvent, stamps: set[float]) -> bool:
    return isinstance(event, LaserScan) and event.stamp not in stamps


def mapped(events: Sequence[SensorEvent], mapper: Mapper) -> Result:
    """Return the map of events."""
    for event in events:
        mapper.add(event)
    return mapper.finish()


def _in_first_map(whole: FloatArray, first: FloatArray, rest: FloatArray) -> FloatArray:
    """Return poses of the whole run in the map of its first part.

    Parameters
    ----------
    whole, first : float64, shape (k, 3), the same scans in both maps.
    rest : float64, shape (n, 3), of the whole run.
    """
    truth = np.empty(rest.shape)
    for i, pose in enumerate(rest):
        apart = np.hypot(whole[:, 0] - pose[0], whole[:, 1] - pose[1])
        apart += LEVER_M * np.abs(wrap_angles(whole[:, 2] - pose[2]))
        nearest = int(np.argmin(apart))
        step = relative_all(whole[nearest], pose)
        truth[i] = compose_all(first[nearest], step)[0]
    return truth


def simulated_drive(
    name: str,
    seed: int,
    change: Callable[[World, np.random.Generator], World] | None = None,
    duration: float | None = None,
) -> Drive:
    """Map a simulated world, and drive through it again, the other way around.

    Parameters
    ----------
    name, seed : of the world.
    change : returns the world as it is later; by default nothing has changed.
    duration : of both drives [s].
    """
    world = make_world(name, seed)
    first = simulate(world, seed=2 * seed, duration=duration)
    result = _map_of_world(name, seed, duration)
    later = world if change is None else change(world, np.random.default_rng(seed))
    route = np.ascontiguousarray(corners_of(first.true_poses)[::-1])
    back = simulate(
        replace(later, route=route), seed=2 * seed + 1, motion=drive(route, *world.pace)
    )
    mapped_truth = first.true_poses[: len(result.stamps)]
    tf_map_world = aligned(mapped_truth, result.trajectory)
    apart = result.trajectory - compose_all(np.array(tf_map_world), mapped_truth)
    truth = compose_all(np.array(tf_map_world), back.true_poses)
    map_errors = np.hypot(apart[:, 0], apart[:, 1])
    return Drive(f"{name} {seed}", result, list(back.events()), truth, map_errors, tf_map_world)


@cache
def _map_of_world(name: str, seed: int, duration: float | None) -> Result:
    first = simulate(make_world(name, seed), seed=2 * seed, duration=duration)
    return mapped(list(first.events()), Mapper())


def corners_of(poses: FloatArray) -> FloatArray:
    """Return the corners of a path that was driven, shape (n, 2), without the robot's stops."""
    kept = [0]
    for i in range(1, len(poses)):
        if np.hypot(*(poses[i, :2] - poses[kept[-1], :2])) >= 1.0:
            kept.append(i)
    return poses[kept, :2]


def aligned(truth: FloatArray, found: FloatArray) -> Pose:
    """Return the transform between two trajectories by least squares, tf_found_truth."""
    a, b = truth[:, :2] - truth[:, :2].mean(axis=0), found[:, :2] - found[:, :2].mean(axis=0)
    cos = float((a * b).sum())
    sin = float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum())
    turn = Pose(0.0, 0.0, float(np.arctan2(sin, cos)))
    centre = compose(turn, _at(truth))
    x, y = (found[:, :2].mean(axis=0) - (centre.x, centre.y)).tolist()
    return Pose(x, y, turn.theta)


def _at(trajectory: FloatArray) -> Pose:
    """Return the middle of a trajectory as a pose."""
    x, y = trajectory[:, :2].mean(axis=0).tolist()
    return Pose(x, y, 0.0)


def with_moved_boxes(world: World, rng: np.random.Generator) -> World:
    """Return a world in which a fifth of what is small is gone, or stands 0.3 m aside."""
    walls = world.walls.copy()
    kept = np.ones(len(walls), dtype=bool)
    for part in _connected(walls):
        ends = walls[part].reshape(-1, 2)
        is_small = len(part) >= MIN_WALLS and np.ptp(ends, axis=0).max() <= MAX_BOX_M
        if not is_small or rng.random() > MOVED_SHARE:
            continue
        if rng.random() < 0.5:
            kept[part] = False
        else:
            turn = rng.uniform(-np.pi, np.pi)
            walls[part] += 0.3 * np.tile((np.cos(turn), np.sin(turn)), 2)
    return replace(world, walls=walls[kept])


def _connected(walls: FloatArray) -> list[IntArray]:
    """Return the walls that share ends with each other, as groups of indices."""
    ends = np.unique(np.round(walls.reshape(-1, 2), 6), axis=0, return_inverse=True)[1].ravel()
    count = int(ends.max()) + 1
    graph = coo_matrix((np.ones(len(walls)), (ends[::2], ends[1::2])), shape=(count, count))
    labels = connected_components(graph, directed=False)[1][ends[::2]]
    return [np.flatnonzero(labels == label) for label in np.unique(labels)]


def carried_away(drive: Drive, at: int, to: int) -> Drive:
    """Return a drive in which the robot is put elsewhere without noticing.

    Parameters
    ----------
    at, to : the last scan before, and the first one after.
    """
    first, second = drive.scan_places[at], drive.scan_places[to]
    gap = drive.events[second].time - drive.events[first].time - 0.2
    later = drive.events[max(int(second) - 1, 0) :]
    events = drive.events[: int(first) + 1]
    odom = _odometry_jump(events, later)
    events = [*events, *(shifted(event, gap, odom) for event in later)]
    truth = np.concatenate((drive.truth[: at + 1], drive.truth[to:]))
    return Drive(f"{drive.name}, carried away", drive.result, events, truth)


def _odometry_jump(before: Sequence[SensorEvent], after: Sequence[SensorEvent]) -> Pose | None:
    """Return what moves later odometry to where earlier odometry ended."""
    last = next((e for e in reversed(before) if not isinstance(e, LaserScan)), None)
    first = next((e for e in after if not isinstance(e, LaserScan)), None)
    old, new = getattr(last, "tf_odom_tracking", None), getattr(first, "tf_odom_tracking", None)
    return None if old is None or new is None else compose(old, inverse(new))


def shifted(event: SensorEvent, by: float, odom: Pose | None) -> SensorEvent:
    """Return an event that is earlier by a time [s], its odometry moved by a transform."""
    moved = replace(event, stamp=event.stamp - by, time=event.time - by)
    if not isinstance(moved, Odometry) or odom is None:
        return moved
    return replace(moved, tf_odom_tracking=compose(odom, moved.tf_odom_tracking))


def error(truth: FloatArray, pose: Pose) -> tuple[float, float]:
    """Return by how much a pose is wrong [m], [rad]."""
    step = relative(Pose(*truth.tolist()), pose)
    return float(np.hypot(step.x, step.y)), abs(step.theta)
