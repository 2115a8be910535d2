# SPDX-License-Identifier: Apache-2.0
"""Updates from the thread that localises to the view, one at a time, and given poses back to it.

As in `feed.py`, there is room for one update: while it has not been taken, an answer costs some
comparisons. What must not be missed, states and path, is gathered here.
"""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter
from typing import NamedTuple

from cartoloop.arrays import FloatArray
from cartoloop.localisation.answer import Answer, State
from cartoloop.localisation.localizer import Localizer
from cartoloop.sensor.pose import Pose
from cartoloop.viewer.locate_history import PathHistory, StateHistory


class AskedPose(NamedTuple):
    """A pose that a user has given.

    Attributes
    ----------
    number : of the request, from 1.
    tf_map_tracking : the pose.
    """

    number: int
    tf_map_tracking: Pose


class TriedPose(NamedTuple):
    """What became of a pose that a user has given.

    Attributes
    ----------
    number : of the request.
    fits : whether a scan fits there, so that the robot is located there.
    """

    number: int
    fits: bool


@dataclass(frozen=True, slots=True)
class LocateUpdate:
    """The latest answer, and what has changed since the update before.

    Attributes
    ----------
    answer : to the last scan.
    returns : of that scan [m], float64 (n, 2), tracking frame.
    num_scans, num_located : answered so far.
    first_stamp : of the first scan [s].
    states : begin [s] and state of the latest changes.
    first_point, path, thinned : points of the path from there on; all of them if older ones were
        left out.
    tried : the last given pose that was tried, None without any.
    skipped : number of skipped scans and events, by reason.
    time : when this was [s, perf_counter].
    """

    answer: Answer
    returns: FloatArray
    num_scans: int
    num_located: int
    first_stamp: float
    states: tuple[tuple[float, State], ...]
    first_point: int
    path: FloatArray
    thinned: bool
    tried: TriedPose | None
    skipped: dict[str, int]
    time: float


class LocateFeed:
    """Gathers updates in the thread that localises; another thread takes them, and gives poses.

    Parameters
    ----------
    localizer : whose answers are shown.
    """

    def __init__(self, localizer: Localizer) -> None:
        self._localizer = localizer
        self._states, self._path = StateHistory(), PathHistory()
        self._ready: LocateUpdate | None = None
        self._answer: Answer | None = None
        self._is_shown = True
        self._first_stamp = 0.0
        self._num_points = self._revision = 0
        self._asked: AskedPose | None = None
        self._trying: AskedPose | None = None
        self._tried: TriedPose | None = None

    def ask(self, asked: AskedPose) -> None:
        """Have a pose tried at the next scan, instead of one that still waits; in any thread."""
        self._asked = asked

    def take(self) -> LocateUpdate | None:
        """Return the update that is ready, if any; to be called in the view's thread."""
        update = self._ready
        if update is not None:
            self._ready = None
        return update

    def after_answer(self, answer: Answer) -> None:
        """Note an answer, and hand over a given pose; in the thread that localises."""
        if self._answer is None:
            self._first_stamp = answer.stamp
        self._answer, self._is_shown = answer, False
        self._states.add(answer.stamp, answer.state)
        self._path.add(answer.tf_map_tracking)
        fits = self._localizer.given_pose_fits
        if self._trying is not None and fits is not None:
            self._tried, self._trying = TriedPose(self._trying.number, fits), None
        if (asked := self._asked) is not None:
            self._asked, self._trying = None, asked
            self._localizer.set_pose(asked.tf_map_tracking)
        self.offer()

    def offer(self) -> None:
        """Lay down an update if there is news and the one before was taken."""
        if self._ready is None and not self._is_shown:
            self._ready = self.update()

    def update(self) -> LocateUpdate | None:
        """Return what has changed since the update before; None without an answer."""
        answer = self._answer
        if answer is None:
            return None
        thinned = self._revision != self._path.revision
        first = 0 if thinned else self._num_points
        self._revision, self._num_points, self._is_shown = (
            self._path.revision,
            len(self._path),
            True,
        )
        return LocateUpdate(
            answer,
            self._localizer.returns,
            self._localizer.num_scans,
            self._localizer.num_located,
            self._first_stamp,
            tuple(self._states.runs),
            first,
            self._path.rows(first),
            thinned,
            self._tried,
            dict(self._localizer.skipped),
            perf_counter(),
        )
