# SPDX-License-Identifier: Apache-2.0
"""Examination of one recording: one pass over its events, matching of a part, all checks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cartoloop.doctor.calibration import Calibration, calibrate
from cartoloop.doctor.choices import Choice, choices_of
from cartoloop.doctor.clouds import CloudWatch, check_clouds
from cartoloop.doctor.contents import (
    Contents,
    Stream,
    contents_of,
    contents_of_bag,
    other_lines,
    times_of,
)
from cartoloop.doctor.findings import Finding, from_message, of_log, worst_first
from cartoloop.doctor.frames import check_frames
from cartoloop.doctor.imu import ImuWatch, check_imu
from cartoloop.doctor.odometry import OdometryWatch, check_odometry
from cartoloop.doctor.scans import ScanWatch, check_scans
from cartoloop.doctor.times import check_delays, check_gaps, check_report, check_unused_order
from cartoloop.errors import InputError
from cartoloop.readers import Log, ReadOptions, open_log
from cartoloop.readers.ros.bag import BagLog
from cartoloop.readers.spool import regular_file
from cartoloop.sensor.event_faults import fault_of
from cartoloop.sensor.events import Imu, LaserScan, Odometry
from cartoloop.sensor.pose import IDENTITY
from cartoloop.sensor.sensor_profile import SensorProfile

ReportProgress = Callable[[str, int, int], None]
"""Callback for progress: the current step, number of scans done, total number (0: unknown)."""

TIME_PROBLEMS = frozenset({"stamps", "gap", "reset"})
"""Problems of text logs that the checks of times report."""

TIME_PROBLEMS_OF_BAGS = frozenset({"gap"})
"""The same for bags, whose inventory reports the others."""

SCANS_PER_REPORT = 64
"""Scans between two calls of the progress callback."""


@dataclass(frozen=True, slots=True)
class Scanner:
    """A scanner that is used, with statistics of its scans and its profile."""

    name: str
    watch: ScanWatch | CloudWatch
    profile: SensorProfile | None


@dataclass(frozen=True, slots=True)
class Examination:
    """The examination of a recording.

    Attributes
    ----------
    path : of the recording.
    can_be_mapped : whether `map` accepts it.
    contents : topics or kinds of lines, transforms.
    duration : [s].
    scanners : those used; the main one first.
    odometry, imu : statistics of their events.
    calibration : of the odometry, estimated on a part, or None.
    choices : how the mapper would use the recording.
    findings : worst first.
    """

    path: Path
    can_be_mapped: bool
    contents: Contents
    duration: float = 0.0
    scanners: tuple[Scanner, ...] = ()
    odometry: OdometryWatch | None = None
    imu: ImuWatch | None = None
    calibration: Calibration | None = None
    choices: tuple[Choice, ...] = ()
    findings: tuple[Finding, ...] = ()


@dataclass(slots=True)
class _Watches:
    scanners: dict[str, ScanWatch | CloudWatch]
    odometry: OdometryWatch
    imu: ImuWatch


def examine(
    path: Path, options: ReadOptions | None = None, report: ReportProgress = lambda *_: None
) -> Examination:
    """Return the examination of a recording: contents, problems, how it would be mapped.

    Unusable contents are not raised as an error, but are findings.
    """
    options = options or ReadOptions()
    try:
        path = regular_file(path)
        log = open_log(path, options)
        watches, findings = _watch(log, report)
    except InputError as error:
        return _unusable(path, options, error)
    contents = _with_times(contents_of(log), log, watches)
    main = next(iter(watches.scanners.values()))
    calibration = None
    if isinstance(main, ScanWatch) and main.num_poor < main.count:
        report("matching a part", 0, 0)
        calibration = calibrate(log, np.asarray(main.times), watches.odometry, main.name)
    model = calibration.model if calibration else None
    profiles: dict[str, SensorProfile] = getattr(log, "profiles", {})
    findings += _findings_of_log(log, contents, main)
    for watch in watches.scanners.values():
        if isinstance(watch, ScanWatch):
            findings += check_scans(watch, profiles.get(watch.name), watches.odometry.path_length)
        else:
            findings += check_clouds(watch)
    is_mirrored = calibration is not None and calibration.is_mirrored
    geometry = main.geometry if isinstance(main, ScanWatch) else None
    mounting = geometry.tf_tracking_sensor if geometry else IDENTITY
    findings += check_odometry(watches.odometry, model, is_mirrored=is_mirrored, mounting=mounting)
    findings += check_imu(watches.imu)
    return Examination(
        path=path,
        can_be_mapped=any(w.num_poor < w.count for w in watches.scanners.values()),
        contents=contents,
        duration=log.duration,
        scanners=tuple(Scanner(n, w, profiles.get(n)) for n, w in watches.scanners.items()),
        odometry=watches.odometry if watches.odometry.count else None,
        imu=watches.imu if watches.imu.count else None,
        calibration=calibration,
        choices=choices_of(log, contents, main, watches.odometry, model),
        findings=worst_first(findings),
    )


def _watch(log: Log, report: ReportProgress) -> tuple[_Watches, list[Finding]]:
    """Read a recording through.

    Raises
    ------
    InputError
        It holds no scan that can be used.
    """
    watches = _Watches({}, OdometryWatch(), ImuWatch())
    found = watches.scanners
    faults: Counter[str] = Counter()
    num_scans = 0
    for event in log:
        if isinstance(event, Odometry):
            watches.odometry.add(event)
        elif isinstance(event, Imu):
            watches.imu.add(event)
        elif fault := fault_of(event):
            faults[fault] += 1
        else:
            name = event.geometry.sensor
            watch = found.get(name)
            if watch is None:
                watch = ScanWatch(name) if isinstance(event, LaserScan) else CloudWatch(name)
                found[name] = watch
            watch.add(event)  # type: ignore[arg-type] # of one sensor all are of one kind
            num_scans += 1
            if num_scans % SCANS_PER_REPORT == 0:
                report("reading", num_scans, log.num_scans)
    if not found:
        raise InputError(
            f"{log.name}: no scan can be used ({', '.join(faults) or 'none is there'})"
        )
    order = list(getattr(log, "profiles", {}))
    names = sorted(found, key=lambda name: order.index(name) if name in order else len(order))
    watches.scanners = {name: found[name] for name in names}
    return watches, [
        Finding("warning", "unusable_events", f"{count} events: {fault}", "skipped", "", count)
        for fault, count in sorted(faults.items())
    ]


def _with_times(contents: Contents, log: Log, watches: _Watches) -> Contents:
    """Return the contents with what is only known after reading: unused lines, and times."""
    for stream in contents.streams:
        if stream.used and stream.role == "odometry":
            watches.odometry.name = stream.name
        elif stream.used and stream.role == "imu":
            watches.imu.name = stream.name
    if isinstance(log, BagLog):
        return contents

    def timed(stream: Stream) -> Stream:
        watch: ScanWatch | CloudWatch | OdometryWatch | None = watches.scanners.get(stream.name)
        if watch is None and stream.role == "odometry":
            watch = watches.odometry
        if watch is None or not stream.used:
            return stream
        return replace(stream, times=times_of(np.asarray(watch.times), np.asarray(watch.stamps)))

    streams = (*map(timed, contents.streams), *other_lines(log.skipped))
    return replace(contents, streams=streams)


def _findings_of_log(log: Log, contents: Contents, main: ScanWatch | CloudWatch) -> list[Finding]:
    """Return problems of the reader, and checks of its summaries."""
    found: list[Finding] = []
    reported = set(TIME_PROBLEMS_OF_BAGS)
    if isinstance(log, BagLog):
        topics = log.inventory.topics
        found += [
            Finding(of_log(f.severity), f.code, f.message, f.remedy, f.topic, f.count, f.stamp)
            for f in log.inventory.findings
            if f.code not in reported
        ]
        reported |= {f.code for f in log.inventory.findings}
        found += check_delays(topics) + check_unused_order(topics)
        found += check_frames(topics, log.inventory.transforms)
    else:
        reported |= TIME_PROBLEMS
        found += check_report(log.time_report, main.stamps, main.name)
    found += check_gaps(contents.streams, log.time_report.period)
    return found + _skipped(log, reported)


def _skipped(log: Log, reported: set[str]) -> list[Finding]:
    """Return skipped lines or messages, and other problems that were not `reported` yet."""
    found = []
    examples = {problem.kind: problem for problem in reversed(log.problems) if problem.kind}
    for reason, count in sorted(log.skipped.items()):
        if reason.endswith(")"):
            continue  # a kind of line that is not used, which is in the contents
        example = examples.get(reason)
        what = f"{count} skipped: {reason}"
        place = f", first {example.message}" if example else ""
        found.append(
            Finding("warning", "skipped", what + place, "check how it was recorded", "", count)
        )
    for problem in log.problems:
        if problem.kind not in reported and problem.kind not in log.skipped:
            code = problem.kind or "note"
            found.append(from_message(of_log(problem.severity), code, problem.message))
    return found


def _unusable(path: Path, options: ReadOptions, error: InputError) -> Examination:
    """Return the examination of a recording that cannot be mapped."""
    text = str(error).removeprefix(f"{path}: ").removeprefix(f"{path.name}: ")
    finding = from_message("error", "cannot_be_mapped", text)
    return Examination(path, False, _contents_anyway(path, options), findings=(finding,))


def _contents_anyway(path: Path, options: ReadOptions) -> Contents:
    """Return the topics of a bag without scans, if it can be read at all."""
    from cartoloop.readers.ros.choice import TopicChoice
    from cartoloop.readers.ros.index import index_recording
    from cartoloop.readers.ros.inventory import take_inventory
    from cartoloop.readers.ros.opening import is_recording, open_containers

    if not is_recording(path):
        return Contents("unknown", ())
    try:
        index = index_recording(next(open_containers(path)), options)
    except InputError:
        return Contents("unknown", ())
    return contents_of_bag(take_inventory(index, TopicChoice(), ()))
