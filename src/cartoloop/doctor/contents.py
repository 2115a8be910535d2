# SPDX-License-Identifier: Apache-2.0
"""Contents of a recording: topics or kinds of lines, and transforms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.readers.carmen import CARMEN, ODOM_TAG
from cartoloop.readers.line_log import LineLog
from cartoloop.readers.log import Log
from cartoloop.readers.ros.bag import BagLog
from cartoloop.readers.ros.inventory import Inventory, TopicSummary, TransformSummary

GAP_FACTOR = 3.0
"""Periods without a message from which on a pause is a gap: one lost message is none."""

MIN_GAP_S = 0.1
"""Shortest gap [s]: faster sensors jitter by more than their period."""

_SUFFIX = " (not used)"


@dataclass(frozen=True, slots=True)
class Times:
    """Time stamps of the messages of a stream.

    Attributes
    ----------
    first, last : stamps [s].
    rate : from the median time between stamps [Hz]; 0 with fewer than two.
    num_gaps, longest_gap, longest_gap_at : pauses much longer than that; the longest [s], and the
        stamp before it [s].
    """

    first: float
    last: float
    rate: float
    num_gaps: int = 0
    longest_gap: float = 0.0
    longest_gap_at: float | None = None


@dataclass(frozen=True, slots=True)
class Stream:
    """A topic, or a kind of lines.

    Attributes
    ----------
    name : of the topic; the tag of the lines.
    type : of the messages.
    role : ``scan``, ``cloud``, ``odometry``, ``imu``, ``tf`` or ``other``.
    count : how many there are.
    used, reason : whether it is used for mapping, and why (not).
    frames : of its messages, the most frequent first.
    times : their stamps; None if unknown.
    """

    name: str
    type: str
    role: str
    count: int
    used: bool
    reason: str = ""
    frames: tuple[str, ...] = ()
    times: Times | None = None


@dataclass(frozen=True, slots=True)
class Contents:
    """Contents of a recording, as far as known without reading its events.

    Attributes
    ----------
    kind : of recording, for the user.
    streams : all topics or kinds of lines, those that are used first.
    transforms : between frames, by child.
    base_frame : the tracking frame; "" where frames have no names.
    """

    kind: str
    streams: tuple[Stream, ...]
    transforms: tuple[TransformSummary, ...] = ()
    base_frame: str = ""


def times_of(times: FloatArray, stamps: FloatArray | None = None) -> Times | None:
    """Return the summary of time stamps, None if there are none.

    Parameters
    ----------
    times : float64, shape (n,), in order [s].
    stamps : of the same messages, by which they are named; the times if missing.
    """
    names = times if stamps is None else stamps
    if len(times) == 0:
        return None
    steps = np.diff(times)
    forward = steps[steps > 0.0]
    period = float(np.median(forward)) if len(forward) else 0.0
    gaps = np.flatnonzero(steps > max(GAP_FACTOR * period, MIN_GAP_S))
    longest = int(gaps[np.argmax(steps[gaps])]) if len(gaps) else -1
    return Times(
        first=float(names[0]),
        last=float(names[-1]),
        rate=1.0 / period if period > 0.0 else 0.0,
        num_gaps=len(gaps),
        longest_gap=float(steps[longest]) if longest >= 0 else 0.0,
        longest_gap_at=float(names[longest]) if longest >= 0 else None,
    )


def contents_of(log: Log) -> Contents:
    """Return the contents of a recording; for text, without the times of its lines."""
    if isinstance(log, BagLog):
        return contents_of_bag(log.inventory)
    if isinstance(log, LineLog) and log.format_name == CARMEN.name:
        return Contents(CARMEN.name, _carmen_streams(log))
    kind = log.format_name if isinstance(log, LineLog) else "recording"
    scanner = next(iter(log.profiles)) if isinstance(log, LineLog) else "scans"
    streams = [Stream(scanner, "scan line", "scan", log.num_scans, True, "the only scanner")]
    if isinstance(log, LineLog) and log.num_odometry:
        streams.append(
            Stream("odometry", "with the scans", "odometry", log.num_odometry, True, "the only one")
        )
    return Contents(kind, tuple(streams))


def _carmen_streams(log: LineLog) -> tuple[Stream, ...]:
    used, unused = [], []
    if count := log.num_odometry_lines:
        tag = ODOM_TAG.decode()
        used.append(Stream(tag, "odometry line", "odometry", count, True, "wheel odometry"))
    for tag, count in log.scan_counts.items():
        if tag in log.profiles:
            main = tag == next(iter(log.profiles))
            why = "the main scanner" if main else "the scanner that looks back"
            if tag.startswith("RAW"):
                why += "; its lines hold no odometry"
            else:
                why += "; the odometry pose of its lines is used too"
            used.append(Stream(tag, "scan line", "scan", count, True, why))
        else:
            why = "another kind of line holds the same scanner"
            unused.append(Stream(tag, "scan line", "scan", count, False, why))
    order = list(log.profiles)
    used.sort(key=lambda s: order.index(s.name) if s.name in order else len(order))
    return (*used, *unused)


def other_lines(skipped: dict[str, int]) -> tuple[Stream, ...]:
    """Return the kinds of lines that were counted as not used while reading."""
    return tuple(
        Stream(reason.removesuffix(_SUFFIX), "line", "other", count, False, "nothing to map with")
        for reason, count in sorted(skipped.items())
        if reason.endswith(_SUFFIX)
    )


def contents_of_bag(inventory: Inventory) -> Contents:
    """Return the contents of a ROS recording."""
    streams = sorted(
        map(_of_topic, inventory.topics), key=lambda s: (not s.used, s.role == "other")
    )
    return Contents(inventory.kind, tuple(streams), inventory.transforms, inventory.base_frame)


def _of_topic(topic: TopicSummary) -> Stream:
    times = None
    if topic.stamps is not None and topic.role != "tf":
        stamps = topic.stamps
        at, longest = stamps.gaps[0] if stamps.gaps else (None, 0.0)
        times = Times(stamps.first, stamps.last, stamps.rate, len(stamps.gaps), longest, at)
    return Stream(
        topic.topic,
        topic.msgtype,
        topic.role,
        topic.count,
        topic.chosen,
        topic.reason,
        topic.frames,
        times,
    )
