# SPDX-License-Identifier: Apache-2.0
"""The loop that hands messages of a source to mapping or localisation, in order and in time."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from threading import Event, Thread
from time import monotonic

from cartoloop.live.growing_file import GrowingFile
from cartoloop.live.inbox import Inbox
from cartoloop.live.messages import EndMessage
from cartoloop.live.notices import Notices
from cartoloop.live.sequencer import Sequencer
from cartoloop.live.source import Source
from cartoloop.sensor.events import SensorEvent
from cartoloop.sensor.pose import Pose

SILENT_S = 2.0
"""A source is reported as silent after this time without a message [s]."""

_TICK_S = 0.05
"""Longest wait for messages before the deadlines are checked [s]."""


@dataclass(frozen=True, slots=True)
class MessageOptions:
    """How messages of a live source are treated.

    Attributes
    ----------
    max_delay : time that a scan waits for late odometry [s].
    end_after : end when no message has arrived for this time [s]; None: never.
    waits : whether the source is held up instead of dropping scans.
    laser_pose : pose of the first scanner on the robot; None: as the source states it.
    """

    max_delay: float = 0.05
    end_after: float | None = None
    waits: bool = False
    laser_pose: Pose | None = None


def inbox_for(source: Source, options: MessageOptions) -> Inbox:
    """Return the queue between a source and mapping.

    A file is held up in any case: what was not read yet stays in it.
    """
    return Inbox(waits=options.waits or isinstance(source, GrowingFile))


class MessageLoop:
    """Runs a source in a background thread, and hands over its messages in this one.

    Parameters
    ----------
    source : opened already.
    inbox, sequencer, notices : queue, order and problems of the messages in between.
    add : receives each message in order, and the time of its arrival by the clock of `inbox` [s].
    idle : called in each cycle of 50 ms or less, also without messages.
    end_after : end after this time without a message [s]; never if None.
    """

    def __init__(
        self,
        source: Source,
        inbox: Inbox,
        sequencer: Sequencer,
        notices: Notices,
        add: Callable[[SensorEvent, float], None],
        *,
        idle: Callable[[], None] | None = None,
        end_after: float | None = None,
    ) -> None:
        self._source, self._inbox = source, inbox
        self._sequencer, self._notices = sequencer, notices
        self._add, self._idle = add, idle
        self._end_after = end_after
        self._ending = Event()
        self._failure: Exception | None = None
        self._thread = Thread(target=self._receive, name="source", daemon=True)
        self._last_came = monotonic()
        self._has_come = self._is_silent = False
        self._reported_dropped: Counter[str] = Counter()

    def run(self, is_stopped: Callable[[], bool]) -> None:
        """Hand over all messages; return at the end of the source, or when stopped.

        Raises
        ------
        Exception
            The failure of the source, or what `add` and `idle` raise.
        """
        self._thread.start()
        try:
            while not is_stopped() and self._step():
                pass
            self._add_ready(math.inf)
        finally:
            self._ending.set()
            self._inbox.close()
            self._thread.join(2.0)
            if num_late := self._inbox.num_late:
                self._notices.skip("scans that came after the end, not used", count=num_late)
            self._notices.tick(all_of_it=True)
        if self._failure is not None:
            raise self._failure

    def _receive(self) -> None:
        try:
            self._source.run(self._inbox.put, self._notices, self._ending)
        except Exception as failure:  # noqa: BLE001 - raised in the thread of `run`
            self._failure = failure

    def _step(self) -> bool:
        """Hand over the next messages; return whether there may be more."""
        wait = min(_TICK_S, max(0.0, self._sequencer.next_deadline - self._inbox.now()))
        arrivals = self._inbox.take(wait)
        for arrival in arrivals:
            self._sequencer.add(arrival)
        # Scans may wait for messages that are in the inbox: time does not advance until then.
        behind = bool(arrivals) and self._inbox.num_waiting > 0
        self._add_ready(arrivals[-1].time if behind else self._inbox.now())
        self._report_silence(came=bool(arrivals))
        self._report_dropped()
        self._notices.tick()
        if self._idle is not None:
            self._idle()
        if any(isinstance(arrival.message, EndMessage) for arrival in arrivals):
            return False
        if self._end_after is not None and monotonic() - self._last_came > self._end_after:
            self._notices.say(f"nothing has come for {self._end_after:g} s: the source has ended")
            return False
        return self._thread.is_alive() or bool(arrivals) or self._inbox.num_waiting > 0

    def _add_ready(self, now: float) -> None:
        for event, arrival in self._sequencer.ready(now):
            self._add(event, arrival)

    def _report_silence(self, *, came: bool) -> None:
        """Report that the source is silent or continues; before the first message it is awaited."""
        silence = monotonic() - self._last_came
        if came:
            if self._is_silent and self._has_come:
                self._notices.note(
                    "the source continues", f"the source continues, after {silence:.1f} s"
                )
            self._has_come, self._is_silent = True, False
            self._last_came = monotonic()
        elif silence > SILENT_S and not self._is_silent:
            self._is_silent = True
            if self._has_come:
                self._notices.note(
                    "silent", f"nothing has come for {SILENT_S:g} s; waiting (Ctrl-C ends)"
                )

    def _report_dropped(self) -> None:
        for kind, number in self._inbox.dropped.items():
            if number > self._reported_dropped[kind]:
                new, self._reported_dropped[kind] = number - self._reported_dropped[kind], number
                self._notices.skip(f"{kind} dropped: too many came", count=new)
