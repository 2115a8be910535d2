# SPDX-License-Identifier: Apache-2.0
"""From the stamps of several topics to times on one clock, which never run backwards in any."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.readers.ros.container import BagFinding
from cartoloop.readers.ros.index import NO_STAMP, TopicStream
from cartoloop.readers.ros.wire import NANO
from cartoloop.sensor.time_repair import TimeReport, repair_times

CLOCK_TOLERANCE = 1.0
"""Sensors whose stamps are farther apart than this at one moment run on different clocks [s]."""

_FACTOR_OF_GAP = 3.0
_SHORTEST_GAP = {"imu": 0.05}
_MAX_GAPS = 20


@dataclass(frozen=True, slots=True)
class StampStatistics:
    """The stamps of a topic's messages, as recorded.

    Attributes
    ----------
    first, last : stamps [s].
    rate : from the median time between stamps [Hz]; 0 with fewer than two.
    gaps : stamp before, and length, of each pause longer than `gap_limit` [s], longest first.
    gap_limit : three periods, at least 0.1 s (scans, odometry) or 0.05 s (IMU).
    num_zero : number of messages without a stamp.
    num_backwards, num_repeated : stamps earlier than the one before, or equal to it.
    delay : median time from the stamp to the recording [s].
    largest_delay : the largest difference between stamp and recording [s], by amount.
    """

    first: float
    last: float
    rate: float
    gaps: tuple[tuple[float, float], ...]
    gap_limit: float
    num_zero: int
    num_backwards: int
    num_repeated: int
    delay: float
    largest_delay: float


@dataclass(frozen=True, eq=False)
class StreamTimes:
    """The times of a stream's messages.

    Attributes
    ----------
    stamps : float64, shape (n,) [s]; as recorded, NaN where there is none.
    times : float64, shape (n,) [s]; strictly increasing, on the clock of the first stream.
    report : what was wrong with the stamps.
    """

    stamps: FloatArray
    times: FloatArray
    report: TimeReport


def common_times(streams: list[TopicStream]) -> tuple[list[StreamTimes], list[BagFinding]]:
    """Return the times of each stream on the clock of the first, and what had to be repaired.

    A message without a stamp gets the time at which it was recorded. A stream whose stamps are on
    another clock, by the times of recording, is shifted. Where the clock of the first stream
    restarts, the others follow it.
    """
    findings: list[BagFinding] = []
    stamps = []
    for stream in streams:
        own, found = _with_recording_times(stream)
        stamps.append(own)
        findings += found
    records = [_seconds(stream.records) for stream in streams]
    results: list[StreamTimes] = []
    for number, stream in enumerate(streams):
        shifted: FloatArray = stamps[number]
        lag = _lag(stamps[number], records[number], stamps[0], records[0])
        if abs(lag) > CLOCK_TOLERANCE:
            shifted = shifted + lag
            findings.append(_other_clock(stream, streams[0], lag))
        if number > 0:
            shifted = shifted + _restarts(results[0], stamps[0], records[0], records[number])
        times, report = repair_times(shifted)
        recorded = _recorded_stamps(stream)
        results.append(StreamTimes(recorded, times, report))
        findings += _time_findings(stream, recorded, report, is_main=number == 0)
    return results, findings


def _seconds(nanos: object) -> FloatArray:
    return np.array(nanos, dtype=np.int64) / NANO


def _recorded_stamps(stream: TopicStream) -> FloatArray:
    nanos = np.array(stream.stamps, dtype=np.int64)
    return np.where(nanos > 0, nanos / NANO, np.nan)


def _lag(
    stamps: FloatArray, records: FloatArray, main_stamps: FloatArray, main_records: FloatArray
) -> float:
    """Return how far stamps are behind those of the main stream recorded at the same time [s]."""
    order = np.argsort(main_records, kind="stable")
    nearest = np.clip(np.searchsorted(main_records[order], records), 0, len(order) - 1)
    delay_of_main = (main_records - main_stamps)[order][nearest]
    return float(np.median(records - stamps - delay_of_main))


def _with_recording_times(stream: TopicStream) -> tuple[FloatArray, list[BagFinding]]:
    """Return stamps without missing ones, and the faults found."""
    stamps, records = _recorded_stamps(stream), _seconds(stream.records)
    missing = np.isnan(stamps)
    if not missing.any():
        return stamps, []
    offset = 0.0 if missing.all() else float(np.median((records - stamps)[~missing]))
    unreadable = np.array(stream.stamps) == NO_STAMP
    num_zero = int((missing & ~unreadable).sum())
    stamps = np.where(missing, records - offset, stamps)
    if num_zero == 0:
        return stamps, []
    every = "all" if num_zero == len(stamps) else f"{num_zero} of {len(stamps)}"
    return stamps, [
        BagFinding(
            "warning",
            "zero_stamps",
            f"{_label(stream)}: {every} messages have no stamp (0)",
            "the time of recording is taken; let the driver stamp its messages",
            stream.topic,
            num_zero,
        )
    ]  # fmt: skip


def _restarts(
    main: StreamTimes, main_stamps: FloatArray, main_records: FloatArray, records: FloatArray
) -> FloatArray:
    """Return the shift of another stream's stamps where the main clock restarts [s]."""
    shift = np.zeros(len(records))
    for start, stop in pairwise((*main.report.resets, len(main_stamps))):
        by = float(np.median(main.times[start:stop] - main_stamps[start:stop]))
        shift[records >= main_records[start]] = by
    return shift


def _label(stream: TopicStream) -> str:
    return stream.topic if stream.edge is None else f"{stream.topic} ({' -> '.join(stream.edge)})"


def _other_clock(stream: TopicStream, main: TopicStream, lag: float) -> BagFinding:
    return BagFinding(
        "warning",
        "other_clock",
        f"{_label(stream)}: its stamps are on another clock, {abs(lag):.6g} s "
        f"{'behind' if lag > 0 else 'ahead of'} {_label(main)}",
        "shifted by the times of recording, good to some 0.1 s; let all drivers use one clock",
        stream.topic,
        len(stream.stamps),
    )


def _time_findings(
    stream: TopicStream, stamps: FloatArray, report: TimeReport, *, is_main: bool
) -> list[BagFinding]:
    found = []
    name = _label(stream)
    if report.num_backwards or report.num_repeated or report.num_wild:
        found.append(
            BagFinding(
                "warning",
                "stamps_out_of_order",
                f"{name}: {report.describe()}",
                "repaired, in the order of recording",
                stream.topic,
                report.num_repaired,
            )
        )
    if not is_main:
        return found
    for index, length in zip(report.gaps, report.gap_lengths, strict=True):
        stamp = float(stamps[index])
        what = f"{name}: nothing for {length:.6g} s before stamp {stamp:.6f}"
        found.append(BagFinding("warning", "gap", what, "", stream.topic, 1, stamp))
    for index in report.resets:
        stamp = float(stamps[index])
        what = f"{name}: the clock restarts at stamp {stamp:.6f}"
        found.append(
            BagFinding("warning", "clock_reset", what, "times continue", stream.topic, 1, stamp)
        )
    return found


def stamp_statistics(stream: TopicStream) -> StampStatistics | None:
    """Return the statistics of a stream's stamps as recorded; None without messages."""
    if not stream.stamps:
        return None
    stamps, records = _recorded_stamps(stream), _seconds(stream.records)
    num_zero = int((np.array(stream.stamps) == 0).sum())
    sound = np.isfinite(stamps)
    if not sound.any():
        stamps, sound = records, np.ones(len(records), dtype=np.bool_)
    delays = (records - stamps)[sound]
    stamps = stamps[sound]
    steps = np.diff(stamps)
    forward = steps[steps > 0.0]
    period = float(np.median(forward)) if len(forward) else 0.0
    limit = max(_FACTOR_OF_GAP * period, _SHORTEST_GAP.get(stream.role, 0.1))
    places = np.flatnonzero(steps > limit)
    longest = places[np.argsort(-steps[places], kind="stable")][:_MAX_GAPS]
    return StampStatistics(
        first=float(stamps[0]),
        last=float(stamps[-1]),
        rate=1.0 / period if period > 0.0 else 0.0,
        gaps=tuple((float(stamps[i]), float(steps[i])) for i in longest),
        gap_limit=limit,
        num_zero=num_zero,
        num_backwards=int((steps < 0.0).sum()),
        num_repeated=int((steps == 0.0).sum()),
        delay=float(np.median(delays)),
        largest_delay=float(delays[np.argmax(np.abs(delays))]),
    )


def merged_order(streams: list[StreamTimes], priorities: list[int]) -> IntArray:
    """Return whose message comes next, for all messages of all streams in the order of time.

    Parameters
    ----------
    priorities : who comes first of those at one time, the smallest.
    """
    times = np.concatenate([s.times for s in streams])
    owners = np.repeat(np.arange(len(streams)), [len(s.times) for s in streams])
    rank = np.array(priorities)[owners]
    order: IntArray = owners[np.lexsort((owners, rank, times))]
    return order
