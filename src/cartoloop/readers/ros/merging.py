# SPDX-License-Identifier: Apache-2.0
"""Messages of several topics in the order of their times, with bounded memory."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

import numpy as np

from cartoloop.readers.copies import COPIED_SCAN, CopyFinder
from cartoloop.readers.log import ProblemLog
from cartoloop.readers.ros import raw_messages as ros
from cartoloop.readers.ros.container import Container
from cartoloop.readers.ros.index import NO_STAMP, TopicStream, is_copy, new_poses
from cartoloop.readers.ros.stream_times import StreamTimes, merged_order
from cartoloop.readers.ros.wire import DecodeError

MAX_WAITING = 50_000
"""Messages that may wait to be put in the order of time."""

MAX_WAITING_BYTES = 256 << 20
"""Bytes that may wait: some ten seconds of point clouds."""

_PRIORITY = {"imu": 0, "odometry": 1, "scan": 2, "cloud": 2}

TimedBytes = tuple[bytes, float, float]
"""Bytes, stamp and time of a message [s]."""


class MergedMessages:
    """The messages of the streams that are used; to be iterated over any number of times.

    Parameters
    ----------
    container : what they are in.
    streams : as found in the first pass.
    times : of each stream.
    """

    def __init__(
        self, container: Container, streams: list[TopicStream], times: list[StreamTimes]
    ) -> None:
        self._container = container
        self._streams = streams
        self._times = times
        self._order = merged_order(times, [_PRIORITY[stream.role] for stream in streams])

    def in_order(self, problems: ProblemLog) -> Iterator[tuple[int, TimedBytes]]:
        """Yield the index of a stream and its next message, in the order of time.

        A message waits until those before it have been read. Where too many wait, the missing
        ones are given up: they are skipped and counted in `problems` when they come.
        """
        waiting: list[deque[TimedBytes]] = [deque() for _ in self._streams]
        given_up = [0] * len(self._streams)
        num_waiting = num_bytes = place = 0
        order = self._order.tolist()
        for owner, message in self._as_recorded(problems):
            if given_up[owner]:
                given_up[owner] -= 1
                is_scan = self._streams[owner].role in ("scan", "cloud")
                problems.skip("recorded too late to be put in order", is_scan=is_scan)
                continue
            waiting[owner].append(message)
            num_waiting += 1
            num_bytes += len(message[0])
            full = num_waiting > MAX_WAITING or num_bytes > MAX_WAITING_BYTES
            while num_waiting and place < len(order):
                turn = order[place]
                if waiting[turn]:
                    first = waiting[turn].popleft()
                    num_waiting -= 1
                    num_bytes -= len(first[0])
                    place += 1
                    yield turn, first
                elif full:
                    given_up[turn] += 1
                    place += 1
                else:
                    break
        # The recording may break off earlier than in the first pass.
        for turn in order[place:]:
            if waiting[turn]:
                yield turn, waiting[turn].popleft()

    def _as_recorded(self, problems: ProblemLog) -> Iterator[tuple[int, TimedBytes]]:
        """Yield the messages in the order of the recording; each pose on ``/tf`` is one.

        Copies are left out, as in the first pass; those of scans are counted in `problems`.
        """
        times = [stream.times.tolist() for stream in self._times]
        stamps = [np.where(np.isnan(s.stamps), s.times, s.stamps).tolist() for s in self._times]
        counts = [0] * len(self._streams)
        owner_of: dict[int, int] = {}
        edges: dict[int, _EdgePoses] = {}
        copies = [CopyFinder() for _ in self._streams]
        for owner, stream in enumerate(self._streams):
            owner_of.update(dict.fromkeys(stream.keys, owner))
            if stream.edge is not None:
                edges[owner] = _EdgePoses(stream)
        for key, _, raw in self._container.messages(owner_of.keys()):
            owner = owner_of.get(key, -1)
            if owner < 0:
                continue  # a damaged file gives one number to two topics
            stream = self._streams[owner]
            if owner not in edges and is_copy(raw, stream, copies[owner]):
                if stream.role in ("scan", "cloud"):
                    problems.skip(COPIED_SCAN)
                continue
            for message in edges[owner].encoded(raw) if owner in edges else (raw,):
                number = counts[owner]
                if number < len(times[owner]):
                    counts[owner] += 1
                    yield owner, (message, stamps[owner][number], times[owner][number])


class _EdgePoses:
    """The poses of one frame in another out of ``/tf`` messages, as in the first pass."""

    def __init__(self, stream: TopicStream) -> None:
        self._is_ros1 = stream.is_ros1
        self._edge = stream.edge or ("", "")
        self._last_stamp = NO_STAMP

    def encoded(self, raw: bytes) -> list[bytes]:
        """Return the poses of a message, each as seven float64."""
        try:
            sent = ros.decode_transforms(raw, self._is_ros1)
        except DecodeError:
            return []  # counted in the first pass
        found = list(new_poses(sent, self._edge, self._last_stamp))
        if found:
            self._last_stamp = found[-1].stamp
        return [np.array(pose.values).tobytes() for pose in found]
