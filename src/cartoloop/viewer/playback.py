# SPDX-License-Identifier: Apache-2.0
"""Pause, play and speed of a recording that is being mapped."""

from __future__ import annotations

from collections.abc import Callable
from threading import Condition
from time import perf_counter

MIN_SPEED, MAX_SPEED = 0.1, 1000.0

_LOOK_UP_S = 0.1
"""Longest sleep of the mapping thread between two checks whether it should stop [s]."""


class Playback:
    """The pace of the recording: pages set it, the mapping thread waits.

    Parameters
    ----------
    speed : 1 is real time; None as fast as possible.
    """

    def __init__(self, speed: float | None = None) -> None:
        self._changed = Condition()
        self._speed = speed
        self._paused = False
        self._begun: tuple[float, float] | None = None  # wall time, recorded time [s]
        self._paused_s = 0.0

    @property
    def speed(self) -> float | None:
        """How fast, 1 being real time; None as fast as possible."""
        return self._speed

    @property
    def paused(self) -> bool:
        """Whether mapping is paused."""
        return self._paused

    @property
    def paused_s(self) -> float:
        """Total time of all pauses [s]."""
        return self._paused_s

    def pause(self) -> None:
        """Pause mapping after the present scan."""
        self._set(paused=True, speed=self._speed)

    def play(self) -> None:
        """Continue mapping."""
        self._set(paused=False, speed=self._speed)

    def set_speed(self, speed: float | None) -> None:
        """Choose how fast, from now on: within MIN_SPEED and MAX_SPEED, or None."""
        self._set(paused=self._paused, speed=speed)

    def wait_for(
        self, recorded: float, is_stopped: Callable[[], bool], meanwhile: Callable[[], None]
    ) -> None:
        """Return when it is time for an event; to be called in the mapping thread.

        Parameters
        ----------
        recorded : time of the event [s].
        is_stopped : returns whether the run was stopped, so that waiting ends.
        meanwhile : called repeatedly while waiting.
        """
        if self._speed is None and not self._paused:
            self._begun = None
            return
        while not is_stopped():
            meanwhile()
            with self._changed:
                left = self._left(recorded)
                if left <= 0.0:
                    return
                start, was_paused = perf_counter(), self._paused
                self._changed.wait(min(left, _LOOK_UP_S))
                if was_paused:
                    self._paused_s += perf_counter() - start

    def _set(self, *, paused: bool, speed: float | None) -> None:
        with self._changed:
            self._paused, self._speed, self._begun = paused, speed, None
            self._changed.notify_all()

    def _left(self, recorded: float) -> float:
        """Return how long to wait [s], for all that is known now."""
        if self._paused:
            return _LOOK_UP_S
        if self._speed is None:
            return 0.0
        now = perf_counter()
        if self._begun is None:
            self._begun = now, recorded
        wall, first = self._begun
        left = (recorded - first) / self._speed - (now - wall)
        if left < -1.0:  # mapping cannot keep up: missed time is not made up for
            self._begun = now, recorded
        return left
