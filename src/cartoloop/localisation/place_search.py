# SPDX-License-Identifier: Apache-2.0
"""When the whole map is searched, which scans are, and where the robot may be meanwhile."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

from cartoloop.localisation.answer import Place
from cartoloop.localisation.decision import NOTHING, Before, Claim, Decision, decide
from cartoloop.localisation.known_map import KnownMap
from cartoloop.localisation.local_motion import LocalScan
from cartoloop.localisation.search_runner import SearchRunner
from cartoloop.localisation.trail import LENGTH_M, Composite, Trail
from cartoloop.sensor.pose import IDENTITY, compose, relative

SEARCH_STEP_M, SEARCH_TURN_RAD, SEARCH_PERIOD_S = 0.5, math.radians(30.0), 5.0
"""The map is searched again after this path, turn or time without a place [m], [rad], [s]."""

LATER_STEP_M = 2.1
"""The same path after `LENGTH_M` without a place [m]: in a building that is not on the map,
searching does not go on at the same cost."""

CHECK_STEP_M = 1.5
"""Path between two searches while a pose is doubted [m]."""

SHORT_PATH_M = 6.0
"""Path whose scans are searched where those of the whole trail fit nowhere [m]: the robot may have
come from where nothing is mapped. Shorter parts of a long path do fit somewhere by chance."""

CHECK_PATH_M = 3.0
"""Path whose scans are searched while a pose is doubted [m]."""


class PlaceSearch:
    """Searches of the whole map along a path.

    Parameters
    ----------
    known : the map.
    runner : of the searches.

    Attributes
    ----------
    decision : what the last search amounted to.
    """

    def __init__(self, known: KnownMap, runner: SearchRunner) -> None:
        self._known, self._runner = known, runner
        self._searched_at: tuple[float, float, float] | None = None
        self._tf_local_searched = IDENTITY
        self.decision = NOTHING
        runner.forget()

    def search(self, scan: LocalScan, trail: Trail, num_refuted: int) -> Claim | None:
        """Search the scans of the trail if it is time to; return a place that is claimed.

        Parameters
        ----------
        num_refuted : claims that the scans refuted soon after.
        """
        step = SEARCH_STEP_M if trail.travelled < LENGTH_M else LATER_STEP_M
        lengths = (LENGTH_M, SHORT_PATH_M) if trail.length > SHORT_PATH_M else (LENGTH_M,)
        self._begin(scan, trail, lengths, step, num_refuted)
        decision = self._take()
        if decision is not None:
            self.decision = decision
        return None if decision is None else self._claim_now(decision, scan)

    def check(self, scan: LocalScan, trail: Trail, *, is_wanted: bool) -> Claim | None:
        """Search the scans of the last metres while a pose is doubted; return a proved place."""
        if is_wanted:
            self._begin(scan, trail, (CHECK_PATH_M,), CHECK_STEP_M)
        decision = self._take()
        if decision is None or decision.claim is None:
            return None
        self.decision = decision
        return self._claim_now(decision, scan)

    def places_now(self, scan: LocalScan) -> tuple[Place, ...]:
        """Return the places of the last search as the robot has moved since."""
        step = relative(self._tf_local_searched, scan.tf_local_tracking)
        return tuple(
            Place(compose(pose, step), probability, score)
            for pose, probability, score in self.decision.places
        )

    def _begin(
        self,
        scan: LocalScan,
        trail: Trail,
        lengths: Sequence[float],
        step: float,
        num_refuted: int = 0,
    ) -> None:
        if self._runner.is_busy or not self._is_due(scan, trail, step):
            return
        paths = [min(trail.length, length) for length in lengths]
        composites = [trail.composite(length) for length in lengths]
        tried = [(c, path) for c, path in zip(composites, paths, strict=True) if c is not None]
        self._searched_at = trail.travelled, trail.turned, scan.time
        places = [place.tf_map_tracking for place in self.places_now(scan)]
        moved = relative(self._tf_local_searched, scan.tf_local_tracking)
        kept = [compose(pose, moved) for pose in self.decision.kept]
        self._runner.begin(
            partial(_decide_any, self._known, tried, Before(num_refuted, places, kept=kept)),
            scan.tf_local_tracking,
        )

    def _take(self) -> Decision | None:
        finished = self._runner.take()
        if finished is None:
            return None
        self._tf_local_searched = finished.tf_local_searched
        return finished.decision

    def _claim_now(self, decision: Decision, scan: LocalScan) -> Claim | None:
        """Return the claim of a search, moved by what the robot has moved since."""
        if decision.claim is None:
            return None
        step = relative(self._tf_local_searched, scan.tf_local_tracking)
        pose = compose(decision.claim.tf_map_tracking, step)
        return decision.claim._replace(tf_map_tracking=pose)

    def _is_due(self, scan: LocalScan, trail: Trail, step: float) -> bool:
        """Return whether the robot has moved, or waited, since the last search."""
        if self._searched_at is None:
            return True
        travelled, turned, time = self._searched_at
        return (
            trail.travelled - travelled >= step
            or trail.turned - turned >= SEARCH_TURN_RAD
            or scan.time - time >= SEARCH_PERIOD_S
        )


def _decide_any(
    known: KnownMap, tried: Sequence[tuple[Composite, float]], before: Before
) -> Decision:
    """Return the first claim, else the first decision with places, given scans and path lengths."""
    decision = NOTHING
    for composite, path in tried:
        latest = decide(known, composite, path, before._replace(is_undecided=bool(decision.places)))
        if latest.claim or not decision.places:
            decision = latest
        if latest.claim:
            break
    return decision
