# SPDX-License-Identifier: Apache-2.0
"""The figures beside a map in which a robot is localised, and its state in words."""

from __future__ import annotations

from time import perf_counter
from typing import Any, Literal

from cartoloop.localisation.answer import Answer, State
from cartoloop.runtime.process_memory import peak_memory_mb
from cartoloop.viewer.locate_feed import LocateUpdate
from cartoloop.viewer.readings import SILENT_AFTER_S, RealTimeFactor, memory_mb

Phase = Literal["starting", "locating", "finished"]


class LocateReadings:
    """Keeps the figures and reports them.

    Parameters
    ----------
    scans_total, duration_s : of the recording, None where that is not known.
    live : whether scans come from a scanner, which may fall silent, and not from a recording.

    Attributes
    ----------
    phase : how far the run is.
    """

    def __init__(
        self, scans_total: int | None, duration_s: float | None, *, live: bool = False
    ) -> None:
        self.phase: Phase = "starting"
        self._scans_total, self._duration_s = scans_total, duration_s
        self._live = live
        self._begun = perf_counter()
        self._wall_s: float | None = None
        self._factor = RealTimeFactor()
        self._last: LocateUpdate | None = None

    def add(self, update: LocateUpdate) -> None:
        """Take in the newest update."""
        if self.phase == "starting":
            self.phase = "locating"
        self._last = update
        self._factor.add(update.time - self._begun, update.answer.stamp - update.first_stamp)

    def end(self) -> None:
        """Note that no more scans come: figures of time stand still."""
        self.phase = "finished"
        self._wall_s = perf_counter() - self._begun

    @property
    def is_over(self) -> bool:
        """Whether no more scans come."""
        return self.phase == "finished"

    def content(self, *, paused: bool) -> dict[str, Any]:
        """Return the READINGS message's content.

        Parameters
        ----------
        paused : whether the operator has stopped the recording.
        """
        last = self._last
        state, text = self._state(paused)
        wall_s = perf_counter() - self._begun if self._wall_s is None else self._wall_s
        time_s = last.answer.stamp - last.first_stamp if last else 0.0
        factor = time_s / max(wall_s, 1e-3) if self.is_over else self._factor.value
        return {
            "state": state,
            "text": text,
            "time_s": time_s,
            "stamp": last.answer.stamp if last else None,
            "duration_s": self._duration_s,
            "wall_s": round(wall_s, 1),
            "real_time_factor": None if factor is None else round(factor, 2),
            "scans": last.num_scans if last else 0,
            "scans_total": self._scans_total,
            "scans_located": last.num_located if last else 0,
            "memory_mb": round(memory_mb()),
            "peak_memory_mb": round(peak_memory_mb()),
            "skipped": last.skipped if last else {},
        }

    def _state(self, paused: bool) -> tuple[str, str]:
        """Return the state, and the same in plain words."""
        last = self._last
        if last is None:
            return (
                self.phase,
                "ended without a scan" if self.is_over else "waiting for the first scan",
            )
        words = in_words(last.answer)
        if self.is_over:
            return self.phase, f"ended: {words}"
        if paused:
            return "paused", f"paused: {words}"
        silent_s = perf_counter() - last.time
        if self._live and silent_s >= SILENT_AFTER_S:
            return "silent", f"sensor silent for {silent_s:.0f} s"
        return last.answer.state.value, words


def in_words(answer: Answer) -> str:
    """Return what is known of the place, in some words."""
    match answer.state:
        case State.LOCATED:
            return "located"
        case State.LOST:
            return "lost: the scans contradict the map"
        case State.AMBIGUOUS:
            count = len(answer.places)
            return "one place fits, not proved" if count == 1 else f"{count} places fit"
    return "searching: no place fits so far"
