# SPDX-License-Identifier: Apache-2.0
"""When a tracked pose is no longer believed: scans agree less with the map than scans usually do.

The covariance of a filter cannot show this: it is as small in a wrong place. What counts is the
share of returns on walls, of those where the map is known, relative to that of the map's own scans.
A sum of what is missing, which never falls below zero, ends in doubt and then in being lost
(E. S. Page, Continuous inspection schemes, 1954). A robot that has been followed for long is lost
later, unless the agreement falls at once: it was not carried away, so the place has changed.
"""

from __future__ import annotations

import math

EXPECTED_AGREEMENT = 0.62
"""Agreement relative to the usual one below which a scan raises the doubt, and above which it
lowers it: half of the furniture may be elsewhere."""

LOST = 0.45
"""Doubt from which the robot is lost."""

SUSPECT_AGREEMENT = 0.8
"""Mean agreement of the latest scans, relative to the usual one, below which the map is searched
for another place: some places resemble others."""

METRES, SECONDS = 1.0, 3.0
"""Scans over this path or time count once, whichever is sooner [m], [s]."""

MAX_WEIGHT = 0.25
"""A single scan counts no more than this."""

TRUST_M, TRUSTED = 10.0, 3.0
"""After this path on which scans agree, a robot that is followed without a break is lost from this
multiple of the doubt only [m]: whole rooms may have been changed since the map was made."""

SUDDEN = 0.3
"""Decrease of the agreement from one scan to the next that ends this trust: a robot that drives
into a changed place sees more and more of it, one that is carried away another place at once."""


class Doubt:
    """How much the latest scans contradict the map.

    Attributes
    ----------
    level : of the doubt.
    """

    def __init__(self) -> None:
        self.level = 0.0
        self._mean = 1.0
        self._last = 1.0
        self._trust = 0.0

    @property
    def is_lost(self) -> bool:
        """Whether the pose is not believed any longer."""
        return self.level >= self._limit

    @property
    def is_suspect(self) -> bool:
        """Whether another place should be searched for."""
        return self._mean < SUSPECT_AGREEMENT

    @property
    def _limit(self) -> float:
        """Doubt from which the robot is lost, given the trust that it has earned, from 0 to 1."""
        return LOST * (1.0 + (TRUSTED - 1.0) * self._trust)

    def add(self, agreement: float, path: float, duration: float) -> None:
        """Add a scan.

        Parameters
        ----------
        agreement : of the scan, relative to the usual one; NaN if the map is not known there.
        path, duration : since the scan before [m], [s].
        """
        if math.isnan(agreement):
            return
        weight = min(max(path / METRES, duration / SECONDS), MAX_WEIGHT)
        if self._last - agreement > SUDDEN:
            self._trust = 0.0
        elif agreement >= SUSPECT_AGREEMENT:
            self._trust = min(self._trust + path / TRUST_M, 1.0)
        self._last = agreement
        self._mean += weight * (min(agreement, 1.0) - self._mean)
        missing = EXPECTED_AGREEMENT - min(agreement, 1.0)
        self.level = min(max(self.level + weight * missing, 0.0), 2.0 * self._limit)

    def reduce(self) -> None:
        """Halve the doubt, as no other place fits better."""
        self.level *= 0.5
