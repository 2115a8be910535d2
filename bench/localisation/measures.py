# SPDX-License-Identifier: Apache-2.0
"""What is measured of a localiser on a drive."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from time import perf_counter, process_time, thread_time

import numpy as np

from bench.localisation.drives import Drive, error
from bench.localisation.particle_filter import LOCATED_SIGMA_M, ParticleFilter
from cartoloop.arrays import FloatArray
from cartoloop.config import Config
from cartoloop.localisation.answer import Answer, State
from cartoloop.localisation.decision import decide
from cartoloop.localisation.known_map import KnownMap
from cartoloop.localisation.localizer import Localizer
from cartoloop.localisation.trail import SCAN_FILTER, Trail
from cartoloop.sensor.events import LaserScan
from cartoloop.sensor.pose import IDENTITY, Pose
from cartoloop.sensor.range_filter import RangeFilter, thin

RIGHT_M, RIGHT_RAD = 0.25, math.radians(5.0)
"""Up to these errors a pose is right [m], [rad]."""

TRACKING_M = 0.5
"""Errors above are not of tracking, but of being in the wrong place [m]."""

OVERLAP_SHARE, OVERLAP_AGREEMENT = 0.8, 0.8
"""A scan overlaps the map if this share of its returns lie where it is known, and agree with it, at
the true pose."""


def points_of(drive: Drive, scan: int) -> FloatArray:
    """Return the returns of a scan, tracking frame [m]."""
    event = drive.events[int(drive.scan_places[scan])]
    assert isinstance(event, LaserScan)
    return RangeFilter(Config().sensor).apply(event).returns


def overlaps(known: KnownMap, drive: Drive, scan: int) -> bool:
    """Return whether the map shows what a scan shows, where it truly is."""
    points = thin(points_of(drive, scan), SCAN_FILTER)
    fit = known.fit(points, IDENTITY, Pose(*drive.truth[scan].tolist()))
    return (
        len(points) >= 20
        and fit.num_counted >= OVERLAP_SHARE * len(points)
        and fit.agreement >= OVERLAP_AGREEMENT * known.usual.agreement
    )


@dataclass
class SingleScans:
    """Answers to single scans from nowhere.

    Attributes
    ----------
    times, processor : of each answer [s].
    overlapping, claimed, right : of each scan.
    """

    times: list[float] = field(default_factory=list)
    processor: list[float] = field(default_factory=list)
    overlapping: list[bool] = field(default_factory=list)
    claimed: list[bool] = field(default_factory=list)
    right: list[bool] = field(default_factory=list)


def single_scans(known: KnownMap, drive: Drive, count: int) -> SingleScans:
    """Search single scans, spread over a drive, in the whole map."""
    found = SingleScans()
    for scan in np.linspace(0, len(drive.truth) - 1, count).astype(int).tolist():
        trail = Trail()
        trail.add(IDENTITY, thin(points_of(drive, scan), SCAN_FILTER), IDENTITY)
        composite = trail.composite(0.0)
        if composite is None:
            continue
        begin, begin_processor = perf_counter(), process_time()
        claim = decide(known, composite, 0.0).claim
        found.times.append(perf_counter() - begin)
        found.processor.append(process_time() - begin_processor)
        found.overlapping.append(overlaps(known, drive, scan))
        found.claimed.append(claim is not None)
        found.right.append(
            claim is not None and _is_right(*error(drive.truth[scan], claim.tf_map_tracking))
        )
    return found


def _is_right(distance: float, angle: float) -> bool:
    return distance <= RIGHT_M and angle <= RIGHT_RAD


@dataclass
class Followed:
    """Answers along a drive.

    Attributes
    ----------
    path : float, driven until the robot was first located rightly [m]; inf: never.
    overlap_path : of that the part where the map shows what the scans show [m].
    whole_overlap : the same of all that was driven, located or not [m].
    errors, angles : of located scans in the right place [m], [rad].
    num_wrong, num_located : located in the wrong place, and located at all.
    states : of all scans.
    processor : time of each scan [s].
    unlocated_path : after which the robot was last located; 0: never [m].
    longest_located_s : the longest time without a break that it was located [s].
    """

    path: float = math.inf
    overlap_path: float = math.inf
    whole_overlap: float = 0.0
    errors: list[float] = field(default_factory=list)
    angles: list[float] = field(default_factory=list)
    num_wrong: int = 0
    num_located: int = 0
    states: Counter[str] = field(default_factory=Counter)
    processor: list[float] = field(default_factory=list)
    unlocated_path: float = 0.0
    longest_located_s: float = 0.0


def follow(
    known: KnownMap,
    drive: Drive,
    first: int = 0,
    max_path: float = math.inf,
    at: Pose | None = None,
    overlapping: FloatArray | None = None,
    localizer: Localizer | None = None,
    *,
    live: bool = False,
) -> Followed:
    """Localise along a drive, from a scan on.

    Parameters
    ----------
    max_path : to drive at most [m].
    at : pose to begin with.
    overlapping : float64, shape (n,), 1 for scans that overlap the map, by scan; None: all do.
    localizer : that is used; by default a new one in the map.
    live : as a robot does: searches run beside the scans, and only the time of the thread that adds
        scans is measured. Scans come faster than from a robot, so that places are found later.
    """
    found, localizer = Followed(), localizer or Localizer(known, at=at, live=live)
    path = overlap = 0.0
    scan, since = first, math.nan
    for answer, spent in _answers(localizer, drive, first, thread_time if live else process_time):
        if scan >= len(drive.truth) or path > max_path:
            break
        if scan > first:
            step = float(np.hypot(*(drive.truth[scan, :2] - drive.truth[scan - 1, :2])))
            path += step
            overlap += step * (1.0 if overlapping is None else float(overlapping[scan]))
        found.processor.append(spent)
        found.states[answer.state] += 1
        found.whole_overlap = overlap
        since = _count(found, answer, drive.truth[scan], path, overlap, since)
        scan += 1
    return found


def _answers(
    localizer: Localizer, drive: Drive, first: int, clock: Callable[[], float] = process_time
) -> Iterator[tuple[Answer, float]]:
    """Yield answers with the time since the one before by a clock [s]."""
    spent = 0.0
    for event in drive.from_scan(first):
        begin = clock()
        answer = localizer.add(event)
        spent += clock() - begin
        if answer is not None:
            yield answer, spent
            spent = 0.0


def _count(
    found: Followed, answer: Answer, truth: FloatArray, path: float, overlap: float, since: float
) -> float:
    """Count an answer; return since when the robot is located [s], NaN if it is not."""
    if answer.tf_map_tracking is None:
        return math.nan
    since = answer.stamp if math.isnan(since) else since
    found.longest_located_s = max(found.longest_located_s, answer.stamp - since)
    distance, angle = error(truth, answer.tf_map_tracking)
    found.num_located += 1
    found.unlocated_path = path
    if _is_right(distance, angle) and math.isinf(found.path):
        found.path, found.overlap_path = path, overlap
    if distance <= TRACKING_M and angle <= 4.0 * RIGHT_RAD:
        found.errors.append(distance)
        found.angles.append(angle)
    else:
        found.num_wrong += 1
    return since


@dataclass
class CarriedAway:
    """What happened after a robot was carried away.

    Attributes
    ----------
    noticed_path, noticed_s : until it was not located in the old place any more [m], [s].
    found_path : until it was located in the new place [m].
    """

    noticed_path: float = math.inf
    noticed_s: float = math.inf
    found_path: float = math.inf


def carried_away(known: KnownMap, drive: Drive, at: int, max_path: float) -> CarriedAway:
    """Localise along a drive in which the robot is carried away after scan `at`."""
    found = CarriedAway()
    localizer = Localizer(known, at=Pose(*drive.truth[0].tolist()))
    path, start = 0.0, math.nan
    for scan, (answer, _) in enumerate(_answers(localizer, drive, 0)):
        if scan >= len(drive.truth) or path > max_path:
            break
        if scan <= at:
            continue
        if scan > at + 1:
            path += float(np.hypot(*(drive.truth[scan, :2] - drive.truth[scan - 1, :2])))
        start = answer.stamp if math.isnan(start) else start
        pose = answer.tf_map_tracking
        is_right = pose is not None and _is_right(*error(drive.truth[scan], pose))
        if (pose is None or is_right) and math.isinf(found.noticed_path):
            found.noticed_path, found.noticed_s = path, answer.stamp - start
        if is_right:
            found.found_path = path
            break
    return found


def follow_by_particles(
    known: KnownMap, drive: Drive, first: int, max_path: float, num_particles: int
) -> Followed:
    """Localise along a drive by a particle filter, from nowhere."""
    found = Followed()
    particles = ParticleFilter(known, num_particles, first)
    filters = RangeFilter(Config().sensor)
    path, scan, odom = 0.0, first, IDENTITY
    for event in drive.from_scan(first):
        if not isinstance(event, LaserScan):
            odom = getattr(event, "tf_odom_tracking", odom)
            continue
        if scan >= len(drive.truth) or path > max_path:
            break
        if scan > first:
            path += float(np.hypot(*(drive.truth[scan, :2] - drive.truth[scan - 1, :2])))
        begin = process_time()
        particles.add(odom, filters.apply(event).returns)
        pose, sigma = particles.estimate
        found.processor.append(process_time() - begin)
        if sigma <= LOCATED_SIGMA_M:
            found.states[State.LOCATED] += 1
            answer = _answer(event.stamp, known.to_map(pose))
            _count(found, answer, drive.truth[scan], path, path, math.nan)
        else:
            found.states[State.SEARCHING] += 1
        scan += 1
    return found


def _answer(stamp: float, pose: Pose) -> Answer:
    return Answer(
        stamp, State.LOCATED, pose, np.eye(3), IDENTITY, math.nan, math.nan, math.nan
    )  # fmt: skip
