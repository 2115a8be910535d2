# SPDX-License-Identifier: Apache-2.0
"""The step between two scans along a direction that walls leave open.

Along bare walls the map holds a robot where it is: far from the scanner a wall is a row of dots,
and the dots of the next scan lie at the same places in the robot's frame, however far it has moved.
Between its dots a wall is taken for a straight line here. Then bare walls say nothing about the
step, and the little that is not bare says it: the edge of a cupboard, a door post, the end wall.

With odometry, matches along such walls follow it, wherever it leads. There, and only there, the
same comparison shows that wheels slip. It is less exact than wheels that do not, and leaves small
errors to them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.config import WallStepConfig
from cartoloop.kernels.outline_shift import Fit, best_step, open_direction
from cartoloop.local_slam.match_records import WallMemory
from cartoloop.local_slam.outline import Outline, outline_of
from cartoloop.sensor.pose import Pose, compose, inverse, wrap_angle

_STRIDE = 3
"""Of the steps that are tried against odometry, every third is tried first: most often none of them
fits better than the matched one, since the wheels do not slip."""

_NEIGHBOUR = 1.5
"""Steps that differ by less than this many are neighbours: noise decides between them."""


@dataclass(frozen=True)
class _LastScan:
    time: float
    pose: Pose
    tf_tracking_sensor: Pose
    returns: FloatArray

    @cached_property
    def outline(self) -> Outline:
        return outline_of(self.returns, self.tf_tracking_sensor)


class _Comparison(NamedTuple):
    """The step along the open direction by which a scan fits one before best.

    Attributes
    ----------
    apart : how much further it is than the matched step [m].
    costs : of the steps by `max_distance` shorter, next to it, it, next to it, by `max_distance`
        longer; NaN where that was not tried.
    matched_cost : of the pose as matched.
    noise : standard deviation of the difference of both costs, if noise alone made it.
    loss : by how much more stretches of returns cost at the step than as matched, in all.
    along : float64, (2,), unit vector of the direction, local frame.
    """

    apart: float
    costs: tuple[float, ...]
    matched_cost: float
    noise: float
    loss: float
    along: FloatArray

    @property
    def cost(self) -> float:
        """Cost of the step."""
        return self.costs[2]

    @property
    def loss_share(self) -> float:
        """What speaks against the step, as a share of what speaks for it."""
        return self.loss / max(self.matched_cost - self.cost + self.loss, 1e-9)

    def correction(self, step: float) -> float:
        """Return `apart` between the steps that were tried, which are `step` apart [m]."""
        _, before, here, after, _ = self.costs
        bend = before - 2.0 * here + after
        between = 0.5 * step * (before - after) / bend if bend > 0.0 else 0.0
        return self.apart + between


class WallStep:
    """Compares each scan of a scanner with one before.

    The last one until the robot has moved by some distance, or some time has passed: pixels hold a
    slow robot, and its step from scan to scan is noise. Odometry is judged once it has.

    Parameters
    ----------
    config : limits of the comparison.
    """

    def __init__(self, config: WallStepConfig) -> None:
        self._config = config
        self._last: _LastScan | None = None
        self._evidence, self._side, self._missed = 0.0, np.zeros(2), np.zeros(2)
        self._is_due = True
        self._moved_at = -math.inf

    @property
    def memory(self) -> WallMemory:
        """What it remembers from scan to scan, besides the scan."""
        return WallMemory(
            self._evidence,
            *self._side.tolist(),
            *self._missed.tolist(),
            self._is_due,
            self._moved_at,
        )

    @memory.setter
    def memory(self, memory: WallMemory) -> None:
        self._evidence, *places, self._is_due, self._moved_at = memory
        self._side, self._missed = np.array(places[:2]), np.array(places[2:])

    def add(self, time: float, pose: Pose, tf_tracking_sensor: Pose, returns: FloatArray) -> None:
        """Remember a scan, with its pose in the local frame; `returns` in the tracking frame."""
        if self._last is not None and not self._is_due:
            return
        self._last = _LastScan(time, pose, tf_tracking_sensor, returns)

    def better_pose(
        self,
        time: float,
        pose: Pose,
        returns: FloatArray,
        *,
        by_odometry: bool = False,
        stands: bool = False,
        match_ratio: float = 0.0,
    ) -> Pose | None:
        """Return a pose further along the walls that fits the scan before much better, or None.

        The evidence of scans that agree adds up, so that a little from each is enough. Once it is,
        the pose makes up for what the steps before have missed as well.

        Parameters
        ----------
        time : of the scan [s].
        pose : as matched, local frame.
        returns : shape (n, 2), tracking frame [m].
        by_odometry : whether the match was predicted by odometry.
        stands : whether the odometry has not moved since the last scan.
        match_ratio : of the curvatures of the match; it follows the odometry where this is small.
        """
        config, last = self._config, self._last
        if not stands:
            self._moved_at = time
        self._is_due = (
            last is None
            or (by_odometry and self._evidence >= config.min_odometry_evidence)
            or self._is_far(last, time, pose, by_odometry)
        )
        if (
            last is None
            or (by_odometry and not self._is_due)
            or not self._is_comparable(last, pose, returns, by_odometry)
            or 0.0 < time - self._moved_at < config.max_standstill
        ):
            return None
        turn = abs(wrap_angle(pose.theta - last.pose.theta))
        turns_too_far = turn > math.radians(config.max_turn_deg)
        if turns_too_far and self._evidence == 0.0:
            return None  # The comparison would only reduce the evidence.
        found = None
        if not by_odometry or match_ratio <= config.max_match_ratio:
            stride = _STRIDE if by_odometry else 1
            found = _compare(last, time, pose, returns, config, stride)
        if found is None:
            if by_odometry:
                self._forget()
            return None
        self._evidence *= config.evidence_memory
        if turns_too_far or not _is_sharp(found, config):
            return None
        missed = self._missed_until(found, len(returns), by_odometry)
        if missed is None:
            return None
        x, y = missed.tolist()
        return Pose(pose.x + x, pose.y + y, pose.theta)

    def _missed_until(
        self, found: _Comparison, num_returns: int, by_odometry: bool
    ) -> FloatArray | None:
        """Add up the evidence for another step; return what was missed [m] if it is enough.

        With odometry, each comparison begins where the one before ended, and their steps add up.
        """
        config, apart = self._config, found.apart
        side = apart * found.along
        if float(side @ self._side) < 0.0:
            self._forget()
        self._side = side
        # People who walk along fit another step, and all that stands the one of the odometry.
        if by_odometry and (
            abs(apart) < config.min_odometry_error
            or (
                found.cost > config.close_fit * num_returns
                and found.loss_share > config.max_loss_share
            )
        ):
            self._forget()
            return None
        evidence = found.matched_cost - found.cost
        if by_odometry:
            # The best of many steps that noise alone makes different is no evidence against wheels.
            evidence = max(evidence - config.noise_factor * found.noise, 0.0)
        if abs(apart) < _NEIGHBOUR * config.step:
            evidence = max(evidence - config.evidence_of_noise, 0.0)
        self._evidence += evidence
        step = found.correction(config.step) * found.along
        missed = self._missed + step if by_odometry else step
        is_proven = self._evidence >= (
            config.min_odometry_evidence if by_odometry else config.min_evidence
        )
        self._missed = np.zeros(2) if is_proven else missed
        return missed if is_proven else None

    def _forget(self) -> None:
        """Drop the evidence so far."""
        self._evidence, self._missed = 0.0, np.zeros(2)

    def _is_comparable(
        self, last: _LastScan, pose: Pose, returns: FloatArray, by_odometry: bool
    ) -> bool:
        """Return whether two scans have enough returns and, against odometry, overlap enough."""
        config = self._config
        if min(len(last.returns), len(returns)) < config.min_num_returns:
            return False
        moved = math.hypot(pose.x - last.pose.x, pose.y - last.pose.y)
        return not by_odometry or moved <= config.max_odometry_step

    def _is_far(self, last: _LastScan, time: float, pose: Pose, by_odometry: bool) -> bool:
        """Return whether a scan is so far from the last one that a step can be judged."""
        config = self._config
        longest = config.max_odometry_duration if by_odometry else config.max_duration
        return (
            math.hypot(pose.x - last.pose.x, pose.y - last.pose.y) >= config.min_odometry_step
            or abs(wrap_angle(pose.theta - last.pose.theta))
            > 0.5 * math.radians(config.max_turn_deg)
            or not 0.0 <= time - last.time < longest
        )


def _compare(
    last: _LastScan,
    time: float,
    pose: Pose,
    returns: FloatArray,
    config: WallStepConfig,
    stride: int,
) -> _Comparison | None:
    """Compare a scan with one before; None where lines determine all directions well.

    With a stride above 1, also None where no step of that grid fits so much better than the matched
    one as odometry must fit worse.
    """
    outline, max_gap = last.outline, math.radians(config.max_gap_deg)
    ratio, direction = open_direction(*outline, max_gap)
    if ratio > config.max_ratio or time <= last.time:
        return None
    tf_sensor_local = inverse(compose(last.pose, last.tf_tracking_sensor))
    axis = math.cos(direction), math.sin(direction)
    direction -= tf_sensor_local.theta
    along = math.cos(direction), math.sin(direction)
    moved = along[0] * (pose.x - last.pose.x) + along[1] * (pose.y - last.pose.y)
    reach = min(config.max_speed * (time - last.time), config.max_step) + config.max_distance
    steps = _steps_to_try(math.ceil(reach / config.step), config.step)
    by_odometry = stride > 1
    matched_cost, best, noise, loss, costs = best_step(
        *outline,
        max_gap,
        returns,
        compose(tf_sensor_local, pose)[:],
        axis,
        moved,
        steps,
        stride,
        (1.0 / config.odometry_cost_ratio, config.close_fit),
        round(config.max_distance / config.step),
        _fit(config, by_odometry=by_odometry),
    )
    if best < 0:
        return None
    apart = float(steps[best]) - moved
    return _Comparison(apart, costs, matched_cost, noise, loss, np.array(along))


def _fit(config: WallStepConfig, *, by_odometry: bool) -> Fit:
    """Return what distances from the outline cost, see `best_step`.

    What leaves the view of a scanner is no evidence against odometry. Without odometry it keeps
    noise from making steps of any length along walls that show none.
    """
    unseen = math.nan if by_odometry else config.outside_cost
    return config.sigma, config.max_distance, config.outside_cost, unseen, unseen


@lru_cache(maxsize=256)
def _steps_to_try(count: int, step: float) -> FloatArray:
    """Return steps [m], ascending: all that the robot can make, and a margin to judge them by."""
    return step * np.arange(-count, count + 1, dtype=np.float64)


def _is_sharp(found: _Comparison, config: WallStepConfig) -> bool:
    """Return whether steps on both sides fit worse: a slope alone is a wrong heading."""
    shorter, *_, longer = found.costs
    # Neither is true of a cost that is NaN, next to the end of the steps.
    return shorter - found.cost >= config.min_rise and longer - found.cost >= config.min_rise
