# SPDX-License-Identifier: Apache-2.0
"""What the operator reads beside the map: figures, and the state in plain words."""

from __future__ import annotations

import math
import sys
from collections import deque
from pathlib import Path
from time import perf_counter
from typing import Any, Literal

import numpy as np

from cartoloop.map_output.report import peak_memory_mb
from cartoloop.sensor.pose import FloatArray
from cartoloop.viewer.feed import Update

Phase = Literal["starting", "mapping", "finishing", "finished", "failed"]

SILENT_AFTER_S = 2.0
"""A scanner that says nothing for so long is silent [s]."""

UNCERTAIN_FROM_M = 0.1
"""A direction in which the last node may be off by this (one standard deviation) is open [m]."""

BEHIND_FROM = 100
"""So many searches are due at any time; only more than that is a backlog worth telling."""

_RATE_OVER_S = 3.0

_END_STATES = {
    "finishing": ("finishing", "closing the last loops"),
    "finished": ("finished", "finished"),
    "failed": ("failed", "failed"),
}


def uncertain_direction(information: FloatArray) -> tuple[float, float]:
    """Return the largest standard deviation of a position [m] and its direction [rad].

    Parameters
    ----------
    information : float64 (3, 3), inverse covariance of a pose; the direction is in its axes.
    """
    # what is known of the position whatever the heading: the Schur complement
    across = information[:2, 2:]
    position = information[:2, :2] - across @ across.T / max(float(information[2, 2]), 1e-12)
    values, vectors = np.linalg.eigh(position)
    deviation = 1.0 / math.sqrt(max(float(values[0]), 1e-12))
    return deviation, math.atan2(vectors[1, 0], vectors[0, 0])


class RealTimeFactor:
    """Recorded seconds per second, over the last few seconds."""

    def __init__(self) -> None:
        self._history: deque[tuple[float, float]] = deque()

    def add(self, wall_s: float, recorded_s: float) -> None:
        """Note that at this time so much of the recording was mapped."""
        self._history.append((wall_s, recorded_s))
        while len(self._history) > 2 and wall_s - self._history[1][0] > _RATE_OVER_S:
            self._history.popleft()

    @property
    def value(self) -> float | None:
        """The factor, None as long as nothing is known."""
        if len(self._history) < 2:
            return None
        (wall, recorded), (last_wall, last_recorded) = self._history[0], self._history[-1]
        return (last_recorded - recorded) / max(last_wall - wall, 1e-6)


class Readings:
    """Keeps what is read, and says it.

    Parameters
    ----------
    scans_total, duration_s : of the recording, None where that is not known.
    live : whether scans come from a scanner, which may fall silent, and not from a recording.

    Attributes
    ----------
    phase : how far the run is.
    failure : what ended it, where it failed.
    """

    def __init__(
        self, scans_total: int | None, duration_s: float | None, *, live: bool = False
    ) -> None:
        self.phase: Phase = "starting"
        self.failure = ""
        self.real_time_factor: float | None = None
        self._scans_total = scans_total
        self._duration_s = duration_s
        self._live = live
        self._begun = perf_counter()
        self._wall_s: float | None = None
        self._factor = RealTimeFactor()
        self._last: Update | None = None
        self._uncertain: tuple[float, float] | None = None

    def add(self, update: Update) -> None:
        """Take in the newest update."""
        if self._last is None and self.phase == "starting":
            self.phase = "mapping"
        self._last = update
        self._factor.add(update.time - self._begun, update.recorded_s)
        if update.last_information is not None:
            deviation, direction = uncertain_direction(update.last_information)
            self._uncertain = deviation, direction + update.tf_map_local.theta

    def end(self, phase: Phase, failure: str = "") -> None:
        """Note that the run is over, or about to be: figures of time stand still."""
        self.phase, self.failure = phase, failure
        if phase in ("finished", "failed") and self._wall_s is None:
            self._wall_s = perf_counter() - self._begun

    def content(self, counts: dict[str, int], *, paused: bool) -> dict[str, Any]:
        """Return the READINGS message's content.

        Parameters
        ----------
        counts : sizes of the graph, by key.
        paused : whether the operator has stopped it.
        """
        last = self._last
        state, text = _END_STATES.get(self.phase) or self._state(paused)
        text = f"{text}: {self.failure}" if self.failure else text
        over = self.phase in ("finished", "failed")
        run = last.last_adjustment if last else None
        deviation, direction = self._uncertain or (None, None)
        wall_s = perf_counter() - self._begun if self._wall_s is None else self._wall_s
        factor = self.real_time_factor if over else self._factor.value
        return counts | {
            "state": state,
            "text": text,
            "time_s": last.recorded_s if last else 0.0,
            "stamp": last.stamp if last else None,
            "duration_s": self._duration_s,
            "wall_s": round(wall_s, 1),
            "real_time_factor": None if factor is None else round(factor, 2),
            "scans": last.num_scans if last else 0,
            "scans_total": self._scans_total,
            "backlog": last.backlog if last and not over else 0,
            "memory_mb": round(memory_mb()),
            "peak_memory_mb": round(peak_memory_mb()),
            "adjustment": {
                "runs": last.num_adjustments if last else 0,
                "last_ms": run.ms if run else None,
                "last_iterations": run.iterations if run else None,
            },
            "skipped": last.skipped if last else {},
            "uncertain_m": None if deviation is None or over else round(deviation, 4),
            "uncertain_direction": None if direction is None or over else round(direction, 4),
        }

    def _state(self, paused: bool) -> tuple[str, str]:
        """Return the state, and the same in plain words."""
        last = self._last
        if paused:
            return "paused", "paused"
        if last is None:
            return "starting", "waiting for the first scan"
        silent_s = perf_counter() - last.time
        if self._live and silent_s >= SILENT_AFTER_S:
            return "silent", f"sensor silent for {silent_s:.0f} s"
        if self._uncertain is not None and self._uncertain[0] >= UNCERTAIN_FROM_M:
            return "uncertain", "corridor: length uncertain"
        if last.backlog > BEHIND_FROM:
            return "closing_loops", f"closing loops: {last.backlog} behind"
        return "mapping", "mapping"


def memory_mb() -> float:
    """Return the memory that this process holds [MB]; 0 where the system does not tell."""
    status = Path("/proc/self/statm")
    if sys.platform != "linux" or not status.exists():
        return 0.0
    import resource

    return int(status.read_text(encoding="ascii").split()[1]) * resource.getpagesize() / 1e6
