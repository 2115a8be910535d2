# SPDX-License-Identifier: Apache-2.0
"""The verdict on a map: data only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any


class Severity(StrEnum):
    """How bad a place is; the verdict on a map is that of its worst place."""

    MINOR = "minor"
    """Worth a look; the map as a whole is right."""
    DOUBTFUL = "doubtful"
    """The map may be wrong here by more than 0.3 m."""
    WRONG = "wrong"
    """Parts of the map contradict each other here."""


class Kind(StrEnum):
    """What makes a place doubtful."""

    CONTRADICTION = "contradiction"
    """Scans of one visit have returns where another visit saw floor: walls stand twice."""
    BREAK = "break"
    """Consecutive scans do not fit to each other."""
    SCATTERED = "scattered"
    """Scans hardly show the same walls from one to the next."""
    MIRRORED = "mirrored"
    """The odometry turns to the other side than the scans: the map may be a mirror image."""
    GAP = "gap"
    """The recording has a gap during which the robot moved, and nothing measured by how far."""
    JUMP = "jump"
    """The matched pose jumped farther than a robot moves."""
    BLIND = "blind"
    """Nothing was matched for some metres: the poses rest on the odometry alone, or on nothing."""
    CORRIDOR = "corridor"
    """A length that the scans hardly measure: it rests on the odometry alone, or on nothing."""
    OPEN = "open"
    """A part of the path that no other visit confirms."""
    REJECTED = "rejected"
    """Many loop closures that the others contradict."""
    WEAK_CLOSURE = "weak_closure"
    """A few loop closures that alone hold a part of the map where it is."""


VERDICTS = {Severity.MINOR: "good", Severity.DOUBTFUL: "doubtful", Severity.WRONG: "wrong"}


@dataclass(frozen=True, slots=True)
class Place:
    """A place of a map that may be wrong.

    Attributes
    ----------
    x, y : its centre [m, map frame].
    radius : of the circle around it [m].
    from_stamp, to_stamp : first and last scan that shows it, as recorded [s].
    kind, severity : what it is, and how bad.
    reason : one sentence for people, with figures.
    advice : what to try.
    """

    x: float
    y: float
    radius: float
    from_stamp: float
    to_stamp: float
    kind: Kind
    severity: Severity
    reason: str
    advice: str


@dataclass(frozen=True, slots=True)
class Quality:
    """What is known of a map's errors, without the truth and without trust in its closures.

    Attributes
    ----------
    verdict : good, doubtful or wrong; unknown where nothing was examined.
    places : the worst first.
    figures : what was measured, by name.
    """

    verdict: str = "unknown"
    places: tuple[Place, ...] = ()
    figures: Mapping[str, float] = field(default_factory=dict)

    @property
    def is_good(self) -> bool:
        """Whether nothing speaks against the map."""
        return self.verdict in {"good", "unknown"}

    def summary(self) -> str:
        """Return the verdict and its worst places, one line."""
        worst = [place for place in self.places if place.severity != Severity.MINOR]
        if not worst:
            return self.verdict
        shown = "; ".join(_at(place) for place in worst[:MAX_PLACES_SHOWN])
        more = len(worst) - MAX_PLACES_SHOWN
        return f"{self.verdict} at {shown}" + (f"; and {more} more places" if more > 0 else "")

    @classmethod
    def from_dict(cls, saved: Mapping[str, Any]) -> Quality:
        """Return what `dataclasses.asdict` made a dictionary of.

        Raises
        ------
        KeyError, TypeError, ValueError
            It is no such dictionary.
        """
        places = tuple(
            Place(**{**place, "kind": Kind(place["kind"]), "severity": Severity(place["severity"])})
            for place in saved["places"]
        )
        return cls(str(saved["verdict"]), places, dict(saved["figures"]))


MAX_PLACES_SHOWN = 2
"""Places in the summary; all are in ``report.json``."""


def _at(place: Place) -> str:
    """Return where a place is and why, for the summary."""
    return f"x {place.x:.1f}, y {place.y:.1f} (stamp {place.from_stamp:.2f}): {place.reason}"
