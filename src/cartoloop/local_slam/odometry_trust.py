# SPDX-License-Identifier: Apache-2.0
"""Whether the odometry moves as the matched scans do: it may stand still, slip or run away.

Steps between scans are compared over a short window. Only motion that the scans determine counts:
along a corridor, matches follow the prediction or the noise of the pixels, and contradict nothing.
Odometry that moves as far as the scans, but never when they do, predicts worse than nothing:
:class:`PredictionRecord`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from cartoloop.local_slam.odometry_window import (
    MIN_STEPS,
    WINDOW_S,
    Evidence,
    StepWindow,
    size_of,
    step_between,
)
from cartoloop.local_slam.prediction_record import PredictionRecord
from cartoloop.sensor.pose import Pose, relative, wrap_angle
from cartoloop.sensor.wall_normals import CORRIDOR_RATIO

MAX_WINDOW_S = 5.0
"""Longest window [s]: scans that come more slowly overlap too little to contradict wheels."""

FAULT_SHARE, GOOD_SHARE = 0.5, 0.25
"""Difference of the motions as a share of the larger one: from the first on the odometry is faulty,
below the second it is good again. Scales are wrong by up to 0.4 before they are calibrated."""

CALIBRATED_FAULT_SHARE = 0.35
"""The same of odometry that is calibrated."""

FAULT_M, FAULT_RAD = 0.2, 0.3
"""Smaller differences are no fault [m], [rad]: matches of a window err by some centimetres."""

LEVER_M, UNKNOWN_LEVER_M = 0.15, 0.5
"""Error of the scanner's lever arm [m], once it is estimated and before: a turn moves it on a
circle."""

STANDING_SHARE, STANDING_CHANGE_M = 0.25, 0.1
"""Scans that move by less than this share of the odometry stand still, if their ranges have changed
by less than the second [m]; otherwise sparse points may have held them at the pixels of the map."""

MIN_SHARE = 0.1
"""Odometry that moves by less than this share of the scans stands still."""

GOOD_M, GOOD_RAD = 0.05, 0.05
"""Difference that remains where the odometry is good [m], [rad]."""

PROOF_M, PROOF_RAD = 0.3, 0.3
"""Motion of a window that shows that the odometry is good again [m], [rad]; a robot at rest does
not."""

MIN_FOLLOWED_M = 0.02
"""Shorter steps of two predictions agree by chance [m]."""


@dataclass(slots=True)
class OdometryFault:
    """A time in which the odometry was left out.

    Attributes
    ----------
    begin, end : times of scans [s]; `end` is None if it lasts until the last scan.
    kind : "stands still", "moves too far", "moves otherwise" or "moves unsteadily", if it predicts
        the scans worse than constant velocity does.
    matched_m, odometry_m : motion of scans and odometry in the window in which it was noticed [m].
    matched_rad, odometry_rad : the same of the rotation [rad].
    """

    begin: float
    end: float | None
    kind: str
    matched_m: float
    odometry_m: float
    matched_rad: float
    odometry_rad: float


class OdometryTrust:
    """Compares the odometry with matched scans.

    Parameters
    ----------
    earlier_score : largest score of the predictions in an earlier pass over the recording.

    Attributes
    ----------
    is_trusted : whether the odometry moves as the scans do, and predicts them.
    faults : the times at which it did not, in order of their notice.
    """

    def __init__(self, earlier_score: float = 0.0) -> None:
        self.faults: list[OdometryFault] = []
        self._fault: OdometryFault | None = None  # that lasts until now
        self._is_over_by_turn = False  # whether a turn shows that it is over
        self._unsteady: OdometryFault | None = None
        self._record = PredictionRecord(earlier_score)
        self._windows: dict[str, StepWindow] = {}
        self._last: dict[str, tuple[float, Pose]] = {}

    @property
    def is_trusted(self) -> bool:
        """Whether the odometry moves as the scans do, and predicts them."""
        return self._fault is None and self._record.is_useful

    @property
    def has_fault(self) -> bool:
        """Whether it moved otherwise than the scans when that was last seen."""
        return self._fault is not None

    @property
    def is_unsteady(self) -> bool:
        """Whether it moves as far as the scans, but predicts them worse than constant velocity."""
        return self._fault is None and not self._record.is_useful

    @property
    def largest_score(self) -> float:
        """The largest score of the predictions so far, that of an earlier pass included."""
        return self._record.largest

    def add(
        self,
        time: float,
        tf_local_tracking: Pose,
        reported: Pose | None,
        evidence: Evidence | None,
        is_late: Callable[[float, float, Pose], bool],
        is_calibrated: bool,
        scanner: str = "",
        expected: Pose | None = None,
    ) -> int:
        """Add a scan; return how many of the latest steps, with the one to it, prove faulty.

        Parameters
        ----------
        time, tf_local_tracking : of the scan, as matched.
        reported : calibrated motion of the odometry since the last scan, in the frame of that scan;
            None where it is not known.
        evidence : of the match; None if the scan was not matched.
        is_late : returns whether the odometry reports a motion at a slightly other time than that
            between two times; asked before it is called faulty.
        is_calibrated : whether the lever arm is estimated.
        scanner : of the scan; scans of one scanner are compared with each other.
        expected : the same motion at constant velocity; None where the velocity is not known.
        """
        last = self._last.get(scanner)
        self._last[scanner] = (time, tf_local_tracking)
        if last is None:
            return 0
        window = self._windows.get(scanner)
        if window is None:
            window = self._windows[scanner] = StepWindow()
        matched = relative(last[1], tf_local_tracking)
        if reported is None or time <= last[0]:
            window.clear()
        else:
            window.add(step_between(last, time, matched, reported, evidence))
        num_faulty = self._compare(window, time, evidence, is_late, is_calibrated)
        if reported is not None and expected is not None:
            self._judge(last[0], matched, reported, expected, evidence)
        # Unsteady steps are still used for the calibration: another clock offset may explain them.
        return num_faulty

    def _compare(
        self,
        window: StepWindow,
        time: float,
        evidence: Evidence | None,
        is_late: Callable[[float, float, Pose], bool],
        is_calibrated: bool,
    ) -> int:
        """Compare the motions of a window; return how many of its latest steps are faulty."""
        steps = window.steps
        num_faulty = 0 if self._fault is None else 1
        if len(steps) >= MIN_STEPS and WINDOW_S <= time - steps[0].begin <= MAX_WINDOW_S:
            begin, lever = steps[0].begin, LEVER_M if is_calibrated else UNKNOWN_LEVER_M
            matched, odometry = window.matched, window.reported
            if self._fault is not None:
                if _agree(matched, odometry, lever, by_turn=self._is_over_by_turn):
                    self._fault.end = begin
                    self._fault = None
            elif (
                differ(matched, odometry, is_calibrated=is_calibrated)
                and not _is_held(matched, odometry, begin, evidence)
                and not is_late(begin, time, matched)
            ):
                stands = all(
                    size_of(step.reported) <= MIN_SHARE * size_of(step.matched)
                    for step in list(steps)[-2:]
                )
                self._fault = _fault(begin, matched, odometry, _kind(matched, odometry, stands))
                self._is_over_by_turn = stands or _turned_otherwise(matched, odometry)
                self.faults.append(self._fault)
                self._forget_predictions(begin)
                num_faulty = len(steps)
        return num_faulty

    def _forget_predictions(self, begin: float) -> None:
        """Forget the predictions of a fault, which may have been bad for some time before.

        They say nothing about the odometry once the fault is over.
        """
        self._record.forget(begin - MAX_WINDOW_S)
        if self._unsteady is not None and self._record.is_useful:
            self.faults.remove(self._unsteady)
            self._unsteady = None

    def _judge(
        self,
        begin: float,
        matched: Pose,
        reported: Pose,
        expected: Pose,
        evidence: Evidence | None,
    ) -> None:
        """Compare the predictions of a step, where scans determine it and no fault is known."""
        if evidence is None or not evidence.is_determined or self._fault is not None:
            return
        self._record.add(begin, matched, reported, expected)
        if self._record.is_useful:
            if self._unsteady is not None:
                self._unsteady.end = begin
                self._unsteady = None
        elif self._unsteady is None and not math.isnan(self._record.since):
            self._unsteady = _fault(self._record.since, matched, reported, "moves unsteadily")
            self.faults.append(self._unsteady)

    def note_slip(self, begin: float, matched: Pose, odometry: Pose) -> None:
        """Begin a fault: scans have shown along walls, step by step, that the wheels slip.

        Parameters
        ----------
        begin : of the last step [s].
        matched, odometry : that step, by the scans and as it was reported.
        """
        if self._fault is None:
            self._fault = _fault(begin, matched, odometry, _kind(matched, odometry, stands=False))
            self._is_over_by_turn = False
            self.faults.append(self._fault)
            self._forget_predictions(begin)
        # Steps before, in which it was right or was followed, do not show that it is good again.
        for window in self._windows.values():
            window.clear()

    def forgive(self, since: float) -> bool:
        """Forget a fault that began after a time, as the odometry has explained what it did.

        Returns whether the odometry is trusted. The motion since then is not compared.
        """
        if self._fault is not None and self._fault.begin >= since - WINDOW_S:
            self.faults.remove(self._fault)
            self._fault = None
        for window in self._windows.values():
            window.clear()
        return self.is_trusted


def _sizes(matched: Pose, odometry: Pose) -> tuple[float, float, float, float]:
    """Return the difference and the larger of two motions: translation, then rotation."""
    x, y, theta = matched
    other_x, other_y, other_theta = odometry
    return (
        math.hypot(x - other_x, y - other_y),
        max(math.hypot(x, y), math.hypot(other_x, other_y)),
        abs(theta - other_theta),
        max(abs(theta), abs(other_theta)),
    )


def differ(matched: Pose, odometry: Pose, *, is_calibrated: bool) -> bool:
    """Return whether the motions of scans and odometry in a window contradict each other."""
    apart, length, turned_apart, turn = _sizes(matched, odometry)
    lever = LEVER_M if is_calibrated else UNKNOWN_LEVER_M
    share = CALIBRATED_FAULT_SHARE if is_calibrated else FAULT_SHARE
    is_elsewhere = apart > max(FAULT_M + lever * turn, share * length)
    return is_elsewhere or turned_apart > max(FAULT_RAD, FAULT_SHARE * turn)


def _turned_otherwise(matched: Pose, odometry: Pose) -> bool:
    """Return whether the turns of scans and odometry in a window contradict each other."""
    _, _, turned_apart, turn = _sizes(matched, odometry)
    return turned_apart > max(FAULT_RAD, FAULT_SHARE * turn)


def follows(step: Pose, expected: Pose) -> bool:
    """Return whether a step of odometry moves as expected of it; one at rest does not."""
    apart, length, turned_apart, turn = _sizes(expected, step)
    return (
        length >= MIN_FOLLOWED_M
        and apart <= GOOD_SHARE * length
        and turned_apart <= GOOD_RAD + GOOD_SHARE * turn
    )


def _is_held(matched: Pose, odometry: Pose, begin: float, evidence: Evidence | None) -> bool:
    """Return whether scans that seem to move less may be held by the map."""
    length = math.hypot(odometry.x, odometry.y)
    if length < FAULT_M:
        return False
    turned_apart = abs(wrap_angle(matched.theta - odometry.theta))
    if evidence is not None and turned_apart < FAULT_RAD and evidence.wall_ratio() < CORRIDOR_RATIO:
        return True  # Along bare walls a moving robot sees the same as one at rest.
    if math.hypot(matched.x, matched.y) >= STANDING_SHARE * length:
        return False
    return evidence is None or evidence.change_since(begin) > STANDING_CHANGE_M


def _agree(matched: Pose, odometry: Pose, lever: float, *, by_turn: bool) -> bool:
    """Return whether two motions of a window are large enough to be compared, and agree.

    Parameters
    ----------
    by_turn : whether a turn is large enough: it shows nothing of how far the wheels roll.
    """
    apart, length, turned_apart, turn = _sizes(matched, odometry)
    if length < PROOF_M and not (by_turn and turn >= PROOF_RAD):
        return False
    return (
        apart < GOOD_M + lever * turn + GOOD_SHARE * length
        and turned_apart < GOOD_RAD + GOOD_SHARE * turn
    )


def _kind(matched: Pose, odometry: Pose, stands: bool) -> str:
    """Return what odometry does that contradicts the scans."""
    if stands:
        return "stands still"
    more = math.hypot(odometry.x, odometry.y) - math.hypot(matched.x, matched.y)
    if more > 0.5 * math.hypot(matched.x - odometry.x, matched.y - odometry.y):
        return "moves too far"
    return "moves otherwise"


def _fault(begin: float, matched: Pose, odometry: Pose, kind: str) -> OdometryFault:
    lengths = math.hypot(matched.x, matched.y), math.hypot(odometry.x, odometry.y)
    return OdometryFault(begin, None, kind, *lengths, abs(matched.theta), abs(odometry.theta))
