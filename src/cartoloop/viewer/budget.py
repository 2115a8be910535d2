# SPDX-License-Identifier: Apache-2.0
"""How often pages are updated, so that the view takes little of the processor from mapping."""

from __future__ import annotations

from time import perf_counter, process_time, thread_time
from typing import NamedTuple

MAX_SHARE = 0.03
"""Largest share of a processor for the view; above it growing submaps are drawn less often, and
then all else is updated less often."""

MAX_REST_S = 1.0
"""Longest time between two drawings of the growing submaps [s]."""

UPDATE_PERIOD_S, LONGEST_PERIOD_S = 0.1, 0.25
"""Update period: normal, and under load [s]."""

FLAT_OUT_PERIODS_S, FLAT_OUT_REST_S = (0.25, 0.5), 2.0
"""Update periods, and time between two drawings of the growing submaps, while a recording is mapped
as fast as possible [s]: a submap is then finished within a second, too fast to watch it grow."""

_NEWEST = 0.2
"""Weight of the newest round in the moving average of the cost of a round."""


class Clocks(NamedTuple):
    """Readings of the clocks.

    Attributes
    ----------
    wall : wall time [s].
    process : processor time of the whole process [s].
    own : processor time of the view's thread [s].
    """

    wall: float
    process: float
    own: float

    @classmethod
    def now(cls) -> Clocks:
        """Return the time; to be called in the view's thread."""
        return cls(perf_counter(), process_time(), thread_time())


class Budget:
    """Decides when growing submaps may be drawn, and when to look for changes again.

    A recording that is mapped as fast as possible (flat out) uses all the processor time that it
    gets, which may be little on a busy machine: intervals are then measured in that time.
    """

    def __init__(self) -> None:
        self._drawn = Clocks(-FLAT_OUT_REST_S, -FLAT_OUT_REST_S, 0.0)
        self._begun: Clocks | None = None
        self._cost = 0.0
        self._period = UPDATE_PERIOD_S

    def begin(self, now: Clocks, *, flat_out: bool) -> None:
        """Begin a round; account for the cost of the one before, including what was sent."""
        shortest, longest = FLAT_OUT_PERIODS_S if flat_out else (UPDATE_PERIOD_S, LONGEST_PERIOD_S)
        cost = 0.0 if self._begun is None else now.own - self._begun.own
        self._cost += _NEWEST * (cost - self._cost)
        self._period = min(max(self._cost / MAX_SHARE, shortest), longest)
        self._begun = now

    def may_draw(self, now: Clocks, *, flat_out: bool) -> bool:
        """Return whether growing submaps may be drawn."""
        if flat_out:
            return now.process - self._drawn.process >= FLAT_OUT_REST_S
        since = now.wall - self._drawn.wall
        return since >= MAX_REST_S or now.own - self._drawn.own < MAX_SHARE * since

    def draw(self, now: Clocks) -> None:
        """Note that growing submaps are drawn now."""
        self._drawn = now

    def pause_s(self, now: Clocks) -> float:
        """Return how long to wait until the next round [s]."""
        begun = self._begun or now
        return max(begun.wall + self._period - now.wall, 0.0)
