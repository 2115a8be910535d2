# SPDX-License-Identifier: Apache-2.0
"""Checks of stamps: order, gaps, clocks, and delays of recording."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cartoloop.doctor.contents import Stream
from cartoloop.doctor.findings import Finding
from cartoloop.readers.ros.inventory import TopicSummary
from cartoloop.sensor.time_repair import TimeReport

LONG_GAP_S = 1.0
LATE_S, VERY_LATE_S = 0.1, 0.5
_LOOKED_AT = ("scan", "cloud", "odometry", "imu")


def check_report(report: TimeReport, stamps: Sequence[float], where: str) -> list[Finding]:
    """Return what was wrong with the stamps of a text log.

    Parameters
    ----------
    stamps : of the scans, as recorded [s], to name when it happened.
    """
    found = (check_missing(report, where), check_order(report, stamps, where))
    return [finding for finding in found if finding is not None] + check_resets(report, where)


def check_missing(report: TimeReport, where: str) -> Finding | None:
    """Lines without a stamp."""
    if not report.num_missing:
        return None
    every = report.num_missing == report.num_stamps
    how = "none of the scans has" if every else f"{report.num_missing} scans do not have"
    remedy = f"scans are taken to be {report.period:.3g} s apart" if every else "spread in between"
    return Finding(
        "warning", "stamps_missing", f"{how} a time stamp", remedy, where, report.num_missing
    )


def check_order(report: TimeReport, stamps: Sequence[float], where: str) -> Finding | None:
    """Stamps that run backwards, repeat, or are far off."""
    if not (report.num_backwards or report.num_repeated or report.num_wild):
        return None
    parts = []
    if report.num_backwards:
        parts.append(
            f"{report.num_backwards} run backwards (by up to {report.largest_backwards:.3g} s)"
        )
    if report.num_repeated:
        parts.append(f"{report.num_repeated} repeat the one before")
    if report.num_wild:
        parts.append(f"{report.num_wild} are far off")
    steps = np.diff(np.asarray(stamps, dtype=np.float64))
    wrong = np.flatnonzero(steps <= 0.0)
    return Finding(
        "warning",
        "stamps_out_of_order",
        f"of {report.num_stamps} time stamps {', '.join(parts)}",
        "the order of the recording is kept and times are repaired; let the driver stamp scans",
        where,
        report.num_backwards + report.num_repeated + report.num_wild,
        float(stamps[int(wrong[0]) + 1]) if len(wrong) else None,
    )


def check_resets(report: TimeReport, where: str) -> list[Finding]:
    """A clock that restarts."""
    if not report.resets:
        return []
    return [
        Finding(
            "warning",
            "clock_reset",
            f"the clock restarts {len(report.resets)} times, first in line {report.resets[0] + 1}",
            "times go on from where they were; give parts of different runs one by one",
            where,
            len(report.resets),
        )
    ]


def check_gaps(streams: Sequence[Stream], period: float) -> list[Finding]:
    """Pauses of the sensors that are used; odometry bridges pauses of the scans.

    Parameters
    ----------
    period : usual time between scans [s].
    """
    used = [stream for stream in streams if stream.used and stream.times is not None]
    odometry = next((s.times for s in used if s.role == "odometry"), None)
    found, known = [], set()
    for stream in used:
        times = stream.times
        if times is None or not times.num_gaps or stream.role not in ("scan", "cloud", "odometry"):
            continue
        # Text logs contain odometry with each scan: the same pause is reported once.
        if (key := (times.num_gaps, times.longest_gap_at)) in known:
            continue
        known.add(key)
        is_scan = stream.role != "odometry"
        bridged = is_scan and odometry is not None and odometry.longest_gap < times.longest_gap
        long = times.longest_gap > max(LONG_GAP_S, 5.0 * period)
        pauses = "a pause" if times.num_gaps == 1 else f"{times.num_gaps} pauses, the longest"
        found.append(
            Finding(
                "warning" if long and is_scan and not bridged else "info",
                "gap",
                f"{pauses} of {times.longest_gap:.3g} s",
                "odometry goes on meanwhile"
                if bridged
                else "matching goes on from where the robot was seen last; record without pauses",
                stream.name,
                times.num_gaps,
                times.longest_gap_at,
            )
        )
    return found


def check_delays(topics: Sequence[TopicSummary]) -> list[Finding]:
    """Stamps that differ from the time at which the message was recorded."""
    found = []
    for topic in topics:
        stamps = topic.stamps
        if stamps is None or topic.role not in _LOOKED_AT or abs(stamps.largest_delay) <= LATE_S:
            continue
        very = abs(stamps.largest_delay) > VERY_LATE_S
        constant = abs(stamps.delay) > 0.8 * abs(stamps.largest_delay)
        # A constant difference is a clock offset or a driver's delay, which is harmless if all
        # sensors share it; a varying one means that the recorder could not keep up.
        found.append(
            Finding(
                "warning" if very else "info",
                "recorded_late",
                f"stamps differ from the time of recording by up to {stamps.largest_delay:.3g} s, "
                f"{stamps.delay:.3g} s as a rule",
                "set the clocks of all computers by NTP"
                if constant
                else "stamps are used, not the time of recording; record on a faster machine",
                topic.topic,
                topic.count,
            )
        )
    return found


def check_unused_order(topics: Sequence[TopicSummary]) -> list[Finding]:
    """Stamps out of order in topics that are not used; the reader reports those used."""
    return [
        Finding(
            "info",
            "stamps_out_of_order",
            f"{topic.stamps.num_backwards} stamps run backwards, {topic.stamps.num_repeated} "
            "repeat the one before",
            "the topic is not used",
            topic.topic,
            topic.stamps.num_backwards + topic.stamps.num_repeated,
        )
        for topic in topics
        if topic.stamps is not None
        and not topic.chosen
        and topic.role in _LOOKED_AT
        and topic.stamps.num_backwards + topic.stamps.num_repeated
    ]
