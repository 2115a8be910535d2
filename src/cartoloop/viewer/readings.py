# SPDX-License-Identifier: Apache-2.0
"""The figures beside the map, and the state in words."""

from __future__ import annotations

import math
import sys
from collections import deque
from pathlib import Path
from time import perf_counter
from typing import Any, Literal

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.local_slam.degenerate_direction import degenerate_direction
from cartoloop.runtime.process_memory import peak_memory_mb
from cartoloop.sensor.pose import wrap_angle
from cartoloop.viewer.feed import Update

Phase = Literal["starting", "mapping", "finishing", "finished", "stopped", "failed"]

OVER = ("finished", "stopped", "failed")
"""Phases of a map that grows no more."""

STOPPED = "the last pass is missing, loops may be open"
PARTLY_MAPPED = "the map covers a part of the recording"
"""What is said of runs that are not finished: without, and with the last pass."""

SILENT_AFTER_S = 2.0
"""A live scanner counts as silent after this time without a scan [s]."""

DEGENERATE_RATIO = 0.16
"""A direction is degenerate if the information along it is less than this share of that across it:
between bare walls only the noise of the pixels is left, a tenth of it or slightly more."""

BEHIND_FROM = 100
"""Normal number of searches in the queue; only more than this is reported as a backlog."""

_RATE_OVER_S = 3.0
"""Time over which the real-time factor is measured [s]."""

_NEWEST = 0.1
"""Weight of the newest scan in the moving average of the degenerate direction's ratio."""

_END_STATES = {
    "finishing": ("finishing", "finishing"),
    "finished": ("finished", "finished"),
    "stopped": ("stopped", "stopped"),
    "failed": ("failed", "failed"),
}


def largest_deviation(information: FloatArray) -> float:
    """Return the standard deviation of a position in its most uncertain direction [m].

    Parameters
    ----------
    information : float64 (3, 3), inverse covariance of a pose.
    """
    covariance = np.linalg.inv(information)
    return math.sqrt(max(float(np.linalg.eigvalsh(covariance[:2, :2])[1]), 0.0))


class DegenerateDirection:
    """Whether scans have a degenerate direction, as in a corridor; averaged over a few scans.

    Attributes
    ----------
    ratio : information along the degenerate direction to that across it.
    direction : that direction, of the last scan [rad, map].
    """

    def __init__(self) -> None:
        self.ratio = 1.0
        self.direction = 0.0

    def add(self, update: Update) -> None:
        """Take in the last scan's match."""
        if update.match is not None:
            ratio, direction = degenerate_direction(update.match)
            self.ratio += _NEWEST * (ratio - self.ratio)
            self.direction = wrap_angle(direction + update.tf_map_local.theta)

    @property
    def is_open(self) -> bool:
        """Whether the position along the direction is uncertain."""
        return self.ratio < DEGENERATE_RATIO


class RealTimeFactor:
    """Recorded seconds per second, over the last few seconds."""

    def __init__(self) -> None:
        self._history: deque[tuple[float, float]] = deque()

    def add(self, wall_s: float, recorded_s: float) -> None:
        """Note how much of the recording was mapped at a time."""
        self._history.append((wall_s, recorded_s))
        while len(self._history) > 2 and wall_s - self._history[1][0] > _RATE_OVER_S:
            self._history.popleft()

    @property
    def value(self) -> float | None:
        """The factor, None while it is unknown."""
        if len(self._history) < 2:
            return None
        (wall, recorded), (last_wall, last_recorded) = self._history[0], self._history[-1]
        return (last_recorded - recorded) / max(last_wall - wall, 1e-6)


class Readings:
    """Keeps the figures and reports them.

    Parameters
    ----------
    scans_total, duration_s : of the recording, None where that is not known.
    live : whether scans come from a scanner, which may fall silent, and not from a recording.

    Attributes
    ----------
    phase : how far the run is.
    detail : what is being done in the end, or what ended it where it failed.
    """

    def __init__(
        self, scans_total: int | None, duration_s: float | None, *, live: bool = False
    ) -> None:
        self.phase: Phase = "starting"
        self.detail = ""
        self.real_time_factor: float | None = None
        self._scans_total = scans_total
        self._duration_s = duration_s
        self._live = live
        self._begun = perf_counter()
        self._wall_s: float | None = None
        self._factor = RealTimeFactor()
        self._last: Update | None = None
        self._deviation: float | None = None
        self._direction = DegenerateDirection()

    def add(self, update: Update) -> None:
        """Take in the newest update."""
        if self._last is None and self.phase == "starting":
            self.phase = "mapping"
        self._last = update
        self._factor.add(update.time - self._begun, update.recorded_s)
        if update.last_information is not None:
            self._deviation = largest_deviation(update.last_information)
        self._direction.add(update)

    def end(self, phase: Phase, detail: str = "") -> None:
        """Note that the run is over, or about to be: figures of time stand still."""
        self.phase, self.detail = phase, detail
        if phase in OVER and self._wall_s is None:
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
        text = f"{text}: {self.detail}" if self.detail else text
        over = self.phase in OVER
        run = last.last_adjustment if last else None
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
            "uncertain_m": None if self._deviation is None or over else round(self._deviation, 4),
            "uncertain_ratio": None if over else round(self._direction.ratio, 3),
            "uncertain_direction": None if over else round(self._direction.direction, 4),
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
        if self._direction.is_open:
            return "uncertain", "corridor: length uncertain"
        if last.backlog > BEHIND_FROM:
            return "closing_loops", f"closing loops: {last.backlog} behind"
        return "mapping", "mapping"


def memory_mb() -> float:
    """Return the memory that this process holds [MB]; 0 if the system does not report it."""
    status = Path("/proc/self/statm")
    if sys.platform != "linux" or not status.exists():
        return 0.0
    import resource

    return int(status.read_text(encoding="ascii").split()[1]) * resource.getpagesize() / 1e6
