# SPDX-License-Identifier: Apache-2.0
"""When a tracked pose is no longer believed: scans agree less with the map than scans usually do.

The covariance of a filter cannot show this: it is as small in a wrong place. What counts is the
share of returns on walls, of those where the map is known, relative to that of the map's own scans.
Sums of what is missing, which never fall below zero, end in doubt and then in being lost
(E. S. Page, Continuous inspection schemes, 1954). There are three of them: a quick one, which finds
a robot that was carried away; a slow one, which finds a map that is of another building or
outdated; and one of the first metres after a claim, which has to prove itself. Where a map is of
another building, scans contradict the last one soon; where furniture was moved, they do too, but
the scans of the whole path still fit, and the proof begins again. A robot that
is followed for long after that is lost later, unless the agreement falls at once: it was not
carried away, so the place has changed.
"""

from __future__ import annotations

import math
from typing import NamedTuple


class Watch(NamedTuple):
    """A sum of what is missing.

    Attributes
    ----------
    expected : agreement relative to the usual one below which a scan raises the sum, and above
        which it lowers it.
    limit : sum from which the robot is lost.
    """

    expected: float
    limit: float


QUICK = Watch(0.62, 0.45)
"""Half of the furniture may be elsewhere."""

SLOW_SHARE, SLOW_LIMIT = 0.85, 1.2
"""Of the agreement that nine of ten scans of the map reach, the share that scans have on average
where things were moved; and the limit of the sum."""

NEW_SHARE, NEW_LIMIT = 1.0, 0.15
"""The same for the first metres after a claim, until it is proved."""

PROOF_M = 15.0
"""Path on which a claim is proved [m]."""

GIVEN_LIMIT = 0.7
"""The limit of the first metres for a pose that a user gave: places may have changed since the map
was made, and a user knows. But the map may be of another building."""

SUSPECT_AGREEMENT = 0.8
"""Mean agreement of the latest scans, relative to the usual one, below which the map is searched
for another place: some places resemble others."""

METRES, SECONDS = 1.0, 3.0
"""Scans over this path or time count once, whichever is sooner [m], [s]."""

MAX_WEIGHT = 0.25
"""A single scan counts no more than this."""

TRUST_M, TRUSTED = 10.0, 3.0
"""After this path on which scans agree, once the claim is proved, a robot is lost from this
multiple of the limits only [m]: whole rooms may have been changed since the map was made."""

SUDDEN = 0.3
"""Decrease of the agreement within two scans that ends this trust: a robot that drives
into a changed place sees more and more of it, one that is carried away another place at once."""

FALLEN, RECOVERED = QUICK._replace(expected=0.8), 0.9
"""After such a decrease the quick sum is the first one, until a scan agrees like the second:
another place may be much alike."""


class Doubt:
    """How much the latest scans contradict the map.

    Parameters
    ----------
    low : the agreement that nine of ten scans of the map reach, relative to the usual one.
    is_given : whether a user gave the pose, and is believed more than a claim.

    Attributes
    ----------
    level : of the doubt; lost from 1 on.
    """

    def __init__(self, low: float = 1.0, *, is_given: bool = False) -> None:
        slow = Watch(SLOW_SHARE * low, SLOW_LIMIT)
        new = Watch(NEW_SHARE * low, GIVEN_LIMIT if is_given else NEW_LIMIT)
        self._watches = [QUICK, slow, new]
        self._sums = [0.0, 0.0, 0.0]
        self._mean = 1.0
        self._latest = (0.0, 0.0)
        self._trust = 0.0
        self._has_fallen = False
        self._unproved = PROOF_M

    @property
    def level(self) -> float:
        """The doubt: the robot is lost from 1 on."""
        num_watches = 2 if self.is_proved else 3
        pairs = zip(self._sums[:num_watches], self._watches[:num_watches], strict=True)
        return max(total / watch.limit for total, watch in pairs) / self._trusted

    @property
    def is_lost(self) -> bool:
        """Whether the pose is not believed any longer."""
        return self.level >= 1.0

    @property
    def is_proved(self) -> bool:
        """Whether the scans have agreed for long enough since the claim."""
        return self._unproved <= 0.0

    @property
    def lacks_proof(self) -> bool:
        """Whether the pose is not believed for lack of proof alone."""
        if self.is_proved or not self.is_lost:
            return False
        pairs = zip(self._sums[:2], self._watches[:2], strict=True)
        return all(total < watch.limit * self._trusted for total, watch in pairs)

    def restart_proof(self) -> None:
        """Take back what was missing for the proof, as the scans of the whole path fit."""
        self._sums[2] = 0.0

    @property
    def is_suspect(self) -> bool:
        """Whether another place should be searched for."""
        return self._mean < SUSPECT_AGREEMENT

    @property
    def _trusted(self) -> float:
        """Multiple of the limits from which the robot is lost."""
        return 1.0 + (TRUSTED - 1.0) * self._trust

    def add(
        self, agreement: float, path: float, duration: float, standing: float = math.nan
    ) -> None:
        """Add a scan.

        Parameters
        ----------
        agreement : of the scan, relative to the usual one; NaN if the map is not known there.
        path, duration : since the scan before [m], [s].
        standing : agreement of what does not move, which proves a claim; NaN: as the agreement.
        """
        if math.isnan(agreement):
            return
        weight = min(max(path / METRES, duration / SECONDS), MAX_WEIGHT)
        agreement = min(agreement, 1.0)
        if max(self._latest) - agreement > SUDDEN:
            self._trust, self._has_fallen = 0.0, True
        elif agreement >= RECOVERED:
            self._has_fallen = False
        self._watches[0] = FALLEN if self._has_fallen else QUICK
        if not self._has_fallen and self.is_proved and agreement >= SUSPECT_AGREEMENT:
            self._trust = min(self._trust + path / TRUST_M, 1.0)
        self._latest = (self._latest[1], agreement)
        self._mean += weight * (agreement - self._mean)
        proving = agreement if math.isnan(standing) else min(standing, 1.0)
        agreements = (agreement, agreement, proving)
        for i, (expected, limit) in enumerate(self._watches):
            total = self._sums[i] + weight * (expected - agreements[i])
            self._sums[i] = min(max(total, 0.0), 2.0 * limit * self._trusted)
        self._unproved -= path

    def reduce(self) -> None:
        """Halve the doubt, as no other place fits better."""
        self._sums = [0.5 * total for total in self._sums]
