# SPDX-License-Identifier: Apache-2.0
"""From a live source to poses in a finished map, until the source ends or the user stops it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from threading import Event, Thread
from time import monotonic

import numpy as np

from cartoloop.config import LocalSlamConfig
from cartoloop.live.inbox import Inbox
from cartoloop.live.messages import EndMessage
from cartoloop.live.notices import Notices
from cartoloop.live.sequencer import Sequencer
from cartoloop.live.session import SILENT_S
from cartoloop.live.source import Source
from cartoloop.live.warm_up import get_ready, tidy
from cartoloop.localisation.answer import Answer
from cartoloop.localisation.decision import decide
from cartoloop.localisation.known_map import KnownMap
from cartoloop.localisation.localizer import Localizer
from cartoloop.localisation.tracking import Tracker
from cartoloop.localisation.trail import Trail
from cartoloop.sensor.pose import IDENTITY, Pose
from cartoloop.stop_request import StopRequest

_TICK_S = 0.05
"""Longest wait for messages before the deadlines are checked [s]."""

_TIDY_S = 5.0
"""Period at which memory is collected [s]."""

OnAnswer = Callable[[Answer, float], None]
"""Receives an answer, and the time from the arrival of its scan to it [s]."""


@dataclass(frozen=True, slots=True)
class LocateOptions:
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


def get_ready_to_locate(known: KnownMap) -> None:
    """Compile all kernels, and prepare this process for answers without delay."""
    angles = np.linspace(-math.pi, math.pi, 90, endpoint=False)
    points = 3.0 * np.column_stack((np.cos(angles), np.sin(angles)))
    trail = Trail()
    trail.add(IDENTITY, points, IDENTITY)
    composite = trail.composite(1.0)
    if composite is not None:
        decide(known, composite, 0.0)
    centre = known.to_map(Pose(known.grid.origin_x, known.grid.origin_y, 0.0))
    Tracker(known, LocalSlamConfig(), centre, 1e-4 * np.eye(3)).correct(points, IDENTITY)
    get_ready()


def locate_live(
    source: Source,
    localizer: Localizer,
    options: LocateOptions,
    notices: Notices,
    on_answer: OnAnswer,
    stop: StopRequest,
) -> None:
    """Localise a robot by what a source sends, until it ends or the run is stopped.

    Parameters
    ----------
    source : opened here.
    localizer : made for live use.
    notices : receives the problems of messages.
    on_answer : called with each answer; must be quick.

    Raises
    ------
    InputError
        The source cannot be opened, or failed.
    """
    notices.say(f"{source.open()} (Ctrl-C ends)")
    _Session(source, localizer, options, notices, on_answer).run(stop)


class _Session:
    """Runs a source in a background thread, and localises in this one."""

    def __init__(
        self,
        source: Source,
        localizer: Localizer,
        options: LocateOptions,
        notices: Notices,
        on_answer: OnAnswer,
    ) -> None:
        self._source, self._localizer, self._notices = source, localizer, notices
        self._options, self._on_answer = options, on_answer
        self._inbox = Inbox(waits=options.waits)
        self._sequencer = Sequencer(notices, options.max_delay, options.laser_pose)
        self._ending = Event()
        self._failure: Exception | None = None
        self._thread = Thread(target=self._receive, name="source", daemon=True)
        self._last_came = self._next_tidy = monotonic()
        self._is_silent = False

    def run(self, stop: StopRequest) -> None:
        """Answer until the end."""
        self._thread.start()
        try:
            while not stop.made and self._step():
                pass
            self._answer_ready(math.inf)
        except KeyboardInterrupt:
            stop.made = True
        finally:
            self._ending.set()
            self._inbox.close()
            self._thread.join(2.0)
            self._notices.tick(all_of_it=True)
        if self._failure is not None:
            raise self._failure

    def _receive(self) -> None:
        try:
            self._source.run(self._inbox.put, self._notices, self._ending)
        except Exception as failure:  # noqa: BLE001 - raised in the thread that localises
            self._failure = failure

    def _step(self) -> bool:
        """Answer the next messages; return whether there may be more."""
        wait = min(_TICK_S, max(0.0, self._sequencer.next_deadline - self._inbox.now()))
        arrivals = self._inbox.take(wait)
        for arrival in arrivals:
            self._sequencer.add(arrival)
        # Scans may wait for messages that are in the inbox: time does not advance until then.
        behind = bool(arrivals) and self._inbox.num_waiting > 0
        self._answer_ready(arrivals[-1].time if behind else self._inbox.now())
        if any(isinstance(arrival.message, EndMessage) for arrival in arrivals):
            return False
        return self._continues(came=bool(arrivals)) and (
            self._thread.is_alive() or bool(arrivals) or self._inbox.num_waiting > 0
        )

    def _answer_ready(self, now: float) -> None:
        for event, arrival in self._sequencer.ready(now):
            self._localizer.add(
                event,
                lambda answer, arrival=arrival: self._on_answer(  # type: ignore[misc]
                    answer, self._inbox.now() - arrival
                ),
            )

    def _continues(self, *, came: bool) -> bool:
        """Report silence and drops; return whether the source may still send something."""
        now = monotonic()
        if came:
            self._last_came, self._is_silent = now, False
        elif now - self._last_came > SILENT_S and not self._is_silent:
            self._is_silent = True
            self._notices.note(
                "silent", f"nothing has come for {SILENT_S:g} s; waiting (Ctrl-C ends)"
            )
        for kind in list(self._inbox.dropped):
            count = self._inbox.dropped.pop(kind)
            self._notices.skip(f"{kind} dropped: too many came", count=count)
        self._notices.tick()
        if now >= self._next_tidy:
            self._next_tidy = now + _TIDY_S
            tidy()
        end_after = self._options.end_after
        if end_after is not None and now - self._last_came > end_after:
            self._notices.say(f"nothing has come for {end_after:g} s: the source has ended")
            return False
        return True
