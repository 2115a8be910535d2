# SPDX-License-Identifier: Apache-2.0
"""Whether the odometry turns to the side to which the scans turn.

A scanner that is mounted upside down, or sends its beams in the other order, shows the mirror image
of its surroundings. Its scans fit to each other as well as any, so that only the odometry shows it.
"""

from __future__ import annotations

import math

from cartoloop.sensor.pose import wrap_angle

MIN_TURN_RAD = 0.3
"""Turn of the scans that is compared at once [rad]: more than clock offsets and noise are worth."""

ENOUGH_RAD = 2.0 * math.pi
"""Sum of the turns of the scans from which something is known [rad]."""

OPPOSITE_RATIO = -0.5
"""Ratio of the turns below which both turn to different sides. It is about 1 for good odometry, 0
for one that stands still."""


class TurnComparison:
    """Compares the turns of matched scans with those that the odometry reports."""

    def __init__(self) -> None:
        self._last: tuple[float, float] | None = None
        self._matched = self._reported = 0.0
        self._product = self._square = self._total = 0.0

    def add(self, matched: float, reported: float | None) -> bool:
        """Add the headings of a scan, as matched and by the odometry, None if unknown [rad].

        Returns whether a turn was compared.
        """
        if reported is None:
            self._last, self._matched, self._reported = None, 0.0, 0.0
            return False
        if self._last is not None:
            self._matched += wrap_angle(matched - self._last[0])
            self._reported += wrap_angle(reported - self._last[1])
        self._last = matched, reported
        if abs(self._matched) < MIN_TURN_RAD:
            return False
        self._product += self._matched * self._reported
        self._square += self._matched**2
        self._total += abs(self._matched)
        self._matched = self._reported = 0.0
        return True

    @property
    def are_opposite(self) -> bool:
        """Whether they are known to turn to different sides."""
        return self._total >= ENOUGH_RAD and self._product < OPPOSITE_RATIO * self._square

    @property
    def ratio(self) -> float | None:
        """Reported turns over matched ones: about 1, or -1 if either is mirrored; None: unknown."""
        return self._product / self._square if self._total >= ENOUGH_RAD else None


class TurnsByScanner:
    """Compares the turns of each scanner's scans with those of the odometry.

    Parameters
    ----------
    were_opposite : whether they turned to different sides in an earlier pass.

    Attributes
    ----------
    are_opposite : whether those of any scanner do; as in the earlier pass until something is known.
    """

    def __init__(self, *, were_opposite: bool = False) -> None:
        self.are_opposite = were_opposite
        self._scanners: dict[str, TurnComparison] = {}

    def add(self, scanner: str, matched: float, reported: float | None) -> None:
        """Add the headings of a scan, see :meth:`TurnComparison.add`."""
        turns = self._scanners.get(scanner)
        if turns is None:
            turns = self._scanners[scanner] = TurnComparison()
        if turns.add(matched, reported) and self.ratio is not None:
            self.are_opposite = any(turns.are_opposite for turns in self._scanners.values())

    @property
    def ratio(self) -> float | None:
        """The smallest ratio, see :attr:`TurnComparison.ratio`; None if none is known."""
        ratios = (turns.ratio for turns in self._scanners.values())
        return min((ratio for ratio in ratios if ratio is not None), default=None)
