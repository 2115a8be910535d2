# SPDX-License-Identifier: Apache-2.0
"""What the poses and times of a run say against it: gaps, jumps, stretches without matches."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray
from cartoloop.global_slam.sparse_scans import TURN_STEP_M
from cartoloop.quality.pairs import MapContent
from cartoloop.quality.scan_changes import changed_share
from cartoloop.sensor.pose import Pose, relative, wrap_angle, wrap_angles
from cartoloop.sensor.time_repair import repair_times
from cartoloop.submaps.submap import SPARSE_STEP_M

MIN_GAP_S, GAP_INTERVALS = 1.5, 6.0
"""A gap is longer than this, and than this number of usual intervals between scans."""

SPEED_OVER_S = 2.0
"""Time before and after a gap over which the speed is measured [s]."""

MIN_SPEED = 0.1
"""A slower robot stands, for all that its poses show [m/s]."""

MOVED_SHARE, MIN_MISSING_M = 0.6, 1.0
"""A robot that drove before and after a gap drove during it: poses that moved by less than this
share of what the lower of its speeds makes it, and by this length less, do not know [m]."""

BRAKING, MIN_BRAKING_M = 2.0, 0.1
"""No robot indoors brakes or starts harder [m/s^2]: if it stood at one end of a gap only, poses
that moved by so much less than it needs to stop do not know either [m]."""

TURN_RATE = 0.35
"""Poses that turned faster across a gap know what the robot did: it turned on the spot [rad/s]."""

ORDERED_SCANS = 20
"""Scans to each side of a gap whose stamps must increase: otherwise the gap is one of the stamps
alone."""

JUMP_SPEED, MIN_JUMP_M = 5.0, 0.7
"""No robot indoors is faster [m/s]; shorter steps are errors of a match [m]."""

STANDING_M, STANDING_RAD, MIN_INTERVAL_S = 0.1, 0.1, 3.0
"""Between two nodes of a robot that stands [m], [rad], and the time after which a robot that does
not move is given a node; nodes of one that moves are 0.2 m apart at least [s]."""


class Event(NamedTuple):
    """Something that happened from one scan to the next.

    Attributes
    ----------
    scan : index of the later scan.
    seconds : since the scan before [s].
    moved : by the poses [m].
    expected : by what is known otherwise [m]; 0 where nothing is.
    """

    scan: int
    seconds: float
    moved: float
    expected: float


def usual_interval(intervals: FloatArray) -> float:
    """Return the usual time between scans [s]; stamps may run backwards or repeat."""
    forwards = intervals[intervals > 0.0]
    return float(np.median(forwards)) if len(forwards) else 1.0


def gap_rows(stamps: FloatArray, intervals: FloatArray) -> list[int]:
    """Return the scans after which there is a gap, where stamps increase all around.

    Parameters
    ----------
    intervals : between the scans, by their times as they were repaired for mapping [s].
    """
    steps, usual = np.diff(stamps), usual_interval(intervals)
    rows = np.flatnonzero(intervals > max(MIN_GAP_S, GAP_INTERVALS * usual)).tolist()
    return [
        row
        for row in rows
        if not np.any(steps[max(row - ORDERED_SCANS, 0) : row + ORDERED_SCANS] < 0.0)
    ]


def gaps(content: MapContent) -> list[Event]:
    """Return the gaps in time during which the robot drove farther than its poses did."""
    stamps, poses = repair_times(content.stamps)[0], content.local_trajectory
    found: list[Event] = []
    if len(stamps) < 10:
        return found
    intervals = np.diff(stamps)
    usual = usual_interval(intervals)
    steps = path_steps(poses)
    if is_by_distance(steps, intervals):
        return found
    paths = np.concatenate(([0.0], np.cumsum(steps)))
    around = max(3, round(SPEED_OVER_S / max(usual, 1e-3)))
    for before in gap_rows(content.stamps, intervals):
        after, seconds = before + 1, float(intervals[before])
        first, last = max(before - around, 0), min(after + around, len(stamps) - 1)
        speeds = [
            (paths[end] - paths[start]) / (stamps[end] - stamps[start])
            for start, end in ((first, before), (after, last))
            if stamps[end] > stamps[start]
        ]
        if len(speeds) < 2:
            continue
        moved, slower = float(steps[before]), float(min(speeds))
        if slower < MIN_SPEED:
            faster = min(max(speeds), _speed_beside(steps, intervals, before))
            expected = faster**2 / (2.0 * BRAKING)
            knows = expected - moved < MIN_BRAKING_M
        else:
            turned = abs(wrap_angle(float(poses[after, 2] - poses[before, 2])))
            expected = slower * seconds
            knows = (
                turned > TURN_RATE * seconds
                or moved >= MOVED_SHARE * expected
                or expected - moved <= MIN_MISSING_M
            )
        if not knows:
            found.append(Event(after, seconds, moved, expected))
    return found


def is_by_distance(steps: FloatArray, intervals: FloatArray) -> bool:
    """Return whether a scan was recorded after each length of the path, not after each time.

    Then a gap in time says nothing. The steps are long, and vary less than the intervals.
    """
    moves = (steps > TURN_STEP_M) & (intervals > 0.0)
    if not np.any(moves) or float(np.median(steps[moves])) <= SPARSE_STEP_M:
        return False
    (low, high), (soon, late) = (
        np.percentile(each[moves], (25.0, 75.0)) for each in (steps, intervals)
    )
    return bool(late / soon > high / low)


def _speed_beside(steps: FloatArray, intervals: FloatArray, before: int) -> float:
    """Return the faster of the speeds right before and after a gap [m/s]."""
    slowest = [
        float(np.min(steps[rows] / np.maximum(intervals[rows], 1e-3)))
        for rows in (slice(max(before - 2, 0), before), slice(before + 1, before + 3))
        if len(steps[rows])
    ]
    return max(slowest, default=0.0)


MISFIT_SHARE, MISFIT_M, MISFIT_RAD = 0.45, 1.5, 1.6
"""Scans to both sides of a gap do not fit if this share of the returns is elsewhere, though by the
poses the robot was nearly at rest [m], [rad]: it saw the same walls then."""

UNUSUAL_SHARE, UNUSUAL_TIMES, USUAL_NODES = 0.25, 3.0, 4
"""The first share is enough if it is this multiple of the largest from node to node right before
and after the gap, over the third number of nodes."""


def misfits(content: MapContent) -> list[Event]:
    """Return the gaps across which scans do not fit, as after a turn; `expected` is 0."""
    scans, poses = content.node_scan_index, content.graph.node_poses
    intervals = np.diff(repair_times(content.stamps)[0])
    found = []
    for before in gap_rows(content.stamps, intervals):
        node = int(np.searchsorted(scans, before, side="right")) - 1
        if not 0 <= node < len(scans) - 1:
            continue
        step = relative(Pose(*poses[node].tolist()), Pose(*poses[node + 1].tolist()))
        if np.hypot(step.x, step.y) > MISFIT_M or abs(step.theta) > MISFIT_RAD:
            continue
        if changed_share(content, node, node + 1) > _misfit_limit(content, node):
            moved = float(np.hypot(step.x, step.y))
            found.append(Event(before + 1, float(intervals[before]), moved, 0.0))
    return found


def _misfit_limit(content: MapContent, node: int) -> float:
    """Return the share of returns elsewhere that is too much across a gap after a node."""
    around = range(
        max(node - USUAL_NODES, 0), min(node + 1 + USUAL_NODES, len(content.node_points) - 1)
    )
    usual = max((changed_share(content, n, n + 1) for n in around if n != node), default=1.0)
    return min(MISFIT_SHARE, max(UNUSUAL_SHARE, UNUSUAL_TIMES * usual))


def jumps(content: MapContent) -> list[Event]:
    """Return the steps that are faster than robots are."""
    seconds = _seconds(content)
    steps = path_steps(content.local_trajectory)
    return [
        Event(row + 1, float(seconds[row]), float(steps[row]), 0.0)
        for row in np.flatnonzero(_is_fast(steps, seconds)).tolist()
    ]


def tears(content: MapContent) -> list[Event]:
    """Return the steps of the finished map that are faster than robots are, but not by the scans.

    There the graph contradicts itself; `expected` is the step by the scans. Of such steps in
    sequence the largest is returned.
    """
    seconds = _seconds(content)
    steps, by_scans = path_steps(content.trajectory), path_steps(content.local_trajectory)
    rows = np.flatnonzero(_is_fast(steps, seconds) & (steps > by_scans + MIN_JUMP_M))
    runs = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1) if len(rows) else []
    largest = [int(run[np.argmax(steps[run])]) for run in runs]
    return [
        Event(row + 1, float(seconds[row]), float(steps[row]), float(by_scans[row]))
        for row in largest
    ]


def _seconds(content: MapContent) -> FloatArray:
    """Return the times between the scans [s]; 0 where stamps run backwards."""
    seconds: FloatArray = np.maximum(np.diff(repair_times(content.stamps)[0]), 0.0)
    return seconds


def path_steps(poses: FloatArray) -> FloatArray:
    """Return the lengths of the steps between poses [m]."""
    steps: FloatArray = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    return steps


def _is_fast(steps: FloatArray, seconds: FloatArray) -> BoolArray:
    """Return which steps are faster than robots are."""
    # Stamps may run backwards or repeat: such steps are judged by the usual interval.
    usual = usual_interval(seconds)
    is_fast: BoolArray = (steps > MIN_JUMP_M) & (steps > JUMP_SPEED * np.maximum(seconds, usual))
    return is_fast


class Standing(NamedTuple):
    """A time during which the poses stand still.

    Attributes
    ----------
    first, last : nodes.
    seconds : its length [s].
    changed : share of the returns that moved between its nodes, in the mean, but for those on
        people and the like.
    """

    first: int
    last: int
    seconds: float
    changed: float


def standing(content: MapContent) -> list[Standing]:
    """Return the times during which nodes were inserted though the robot stood still."""
    poses = content.graph.node_poses
    stamps = content.stamps[content.node_scan_index]
    seconds = np.diff(stamps)
    steps = path_steps(poses)
    turns = np.abs(wrap_angles(np.diff(poses[:, 2])))
    stands = (seconds >= MIN_INTERVAL_S) & (steps < STANDING_M) & (turns < STANDING_RAD)
    rows = np.flatnonzero(stands)
    found = []
    for run in np.split(rows, np.flatnonzero(np.diff(rows) > 2) + 1):
        if len(run):
            changed = [
                changed_share(content, int(row), int(row) + 1, of_people=False) for row in run
            ]
            found.append(
                Standing(
                    int(run[0]),
                    int(run[-1]) + 1,
                    float(seconds[run].sum()),
                    float(np.mean(changed)),
                )
            )
    return found
