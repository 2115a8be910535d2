# SPDX-License-Identifier: Apache-2.0
"""From a source to a map, until the source ends or the user stops it."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from threading import Event, Thread
from time import monotonic

import numpy as np

from cartoloop.live.inbox import Inbox
from cartoloop.live.messages import EndMessage
from cartoloop.live.notices import Notices
from cartoloop.live.sequencer import Sequencer
from cartoloop.live.source import Source
from cartoloop.live.warm_up import tidy
from cartoloop.mapper import Mapper
from cartoloop.sensor.pose import Pose

SILENT_S = 2.0
"""A source is reported as silent after this time without a message [s]."""

STATUS_S = 5.0
"""Period of the status lines [s]."""

_TICK_S = 0.05
"""Longest wait for messages before the deadlines are checked [s]."""


@dataclass(frozen=True, slots=True)
class AddedScan:
    """A scan at the moment its pose is known.

    Attributes
    ----------
    stamp : of the scan [s].
    tf_local_tracking, tf_map_tracking : its pose in both frames.
    latency : from its arrival to the pose [s].
    """

    stamp: float
    tf_local_tracking: Pose
    tf_map_tracking: Pose
    latency: float


class LiveSession:
    """Runs a source in a background thread, and maps in this one.

    Parameters
    ----------
    source : opened already.
    mapper : made for live mapping.
    inbox, sequencer, notices : queue, order and problems of the messages in between.
    after_scan : called when a pose is known, before its scan is inserted; must be quick.
    idle : called in each cycle of 50 ms or less, also without messages.
    end_after : end after this time without a message [s]; never if None.

    Attributes
    ----------
    latencies : of the last scans [s].
    """

    def __init__(
        self,
        source: Source,
        mapper: Mapper,
        inbox: Inbox,
        sequencer: Sequencer,
        notices: Notices,
        *,
        after_scan: Callable[[AddedScan], None] | None = None,
        idle: Callable[[], None] | None = None,
        end_after: float | None = None,
    ) -> None:
        self._source = source
        self._mapper = mapper
        self._inbox = inbox
        self._sequencer = sequencer
        self._notices = notices
        self._after_scan = after_scan
        self._idle = idle
        self._end_after = end_after
        self._stop = Event()
        self._failure: Exception | None = None
        self._thread = Thread(target=self._receive, name="source", daemon=True)
        self._last_came = monotonic()
        self._is_silent = False
        self._has_answered = False
        self._next_status = monotonic() + STATUS_S
        self._reported_dropped: Counter[str] = Counter()
        self.latencies: deque[float] = deque(maxlen=1000)

    def run(self, is_stopped: Callable[[], bool]) -> None:
        """Map the messages; return at the end of the source, or when stopped.

        Raises
        ------
        Exception
            The failure of the source or the mapper.
        """
        self._thread.start()
        try:
            while not is_stopped() and self._step():
                pass
            self._add_ready(math.inf)
        finally:
            self._stop.set()
            self._inbox.close()
            self._thread.join(2.0)
            self._notices.tick(all_of_it=True)
        if self._failure is not None:
            raise self._failure

    def _receive(self) -> None:
        try:
            self._source.run(self._inbox.put, self._notices, self._stop)
        except Exception as failure:  # noqa: BLE001 - raised in the mapping thread
            self._failure = failure

    def _step(self) -> bool:
        """Map the next messages; return whether there may be more."""
        wait = min(_TICK_S, max(0.0, self._sequencer.next_deadline - self._inbox.now()))
        arrivals = self._inbox.take(wait)
        for arrival in arrivals:
            self._sequencer.add(arrival)
        # Scans may wait for messages that are in the inbox: time does not advance until then.
        behind = bool(arrivals) and self._inbox.num_waiting > 0
        self._add_ready(arrivals[-1].time if behind else self._inbox.now())
        self._watch(came=bool(arrivals))
        if any(isinstance(arrival.message, EndMessage) for arrival in arrivals):
            return False
        if self._end_after is not None and monotonic() - self._last_came > self._end_after:
            self._notices.say(f"nothing has come for {self._end_after:g} s: the source has ended")
            return False
        return self._thread.is_alive() or bool(arrivals) or self._inbox.num_waiting > 0

    def _add_ready(self, now: float) -> None:
        for event, arrival in self._sequencer.ready(now):
            self._mapper.add(event, partial(self._publish, event.stamp, arrival))

    def _publish(self, stamp: float, arrival: float) -> None:
        """Publish the pose of a scan that is not inserted yet."""
        latency = self._inbox.now() - arrival
        self.latencies.append(latency)
        self._has_answered = True
        if self._after_scan is not None:
            pose, local = self._mapper.pose, self._mapper.local_pose
            self._after_scan(AddedScan(stamp, local, pose, latency))

    def _watch(self, *, came: bool) -> None:
        """Report silence, drops and the status to the user."""
        now = monotonic()
        if came:
            if self._is_silent:
                silence = now - self._last_came
                self._notices.note(
                    "the source continues", f"the source continues, after {silence:.1f} s"
                )
            self._is_silent, self._last_came = False, now
        elif now - self._last_came > SILENT_S and not self._is_silent:
            self._is_silent = True
            if self._mapper.num_scans:
                self._notices.note(
                    "silent", f"nothing has come for {SILENT_S:g} s; waiting (Ctrl-C ends)"
                )
        for kind, number in self._inbox.dropped.items():
            if number > self._reported_dropped[kind]:
                new, self._reported_dropped[kind] = number - self._reported_dropped[kind], number
                self._notices.skip(f"{kind} dropped: too many came", count=new)
        self._notices.tick()
        if self._idle is not None:
            self._idle()
        # Right after a scan was answered, the next one is as far away as it can be.
        if now >= self._next_status and self._has_answered:
            self._next_status = now + STATUS_S
            tidy()
            self._notices.say(self._status())
        self._has_answered = False

    def _status(self) -> str:
        mapper = self._mapper
        p50, p99 = 1e3 * np.quantile(self.latencies or [0.0], (0.5, 0.99))
        slam = mapper.global_slam
        num_dropped = slam.closures.num_dropped
        dropped = f", {num_dropped} dropped" if num_dropped else ""
        return (
            f"{mapper.num_scans} scans, {mapper.num_loop_closures} closures, latency {p50:.1f} ms "
            f"(p99 {p99:.1f}), {slam.search.backlog} searches behind{dropped}"
        )
