# SPDX-License-Identifier: Apache-2.0
"""The step between two scans along a direction that walls leave open.

Along bare walls the map holds a robot where it is: far from the scanner a wall is a row of dots,
and the dots of the next scan lie at the same places in the robot's frame, however far it has moved.
Between its dots a wall is taken for a straight line here. Then bare walls say nothing about the
step, and the little that is not bare says it: the edge of a cupboard, a door post, the end wall.

With odometry, matches along such walls follow it, wherever it leads. There, and only there, the
same comparison shows that wheels slip. It is less exact than wheels that do not, and leaves small
errors to them.

Narrow objects that stand free, which may be people, are not compared. The best of many steps fits
better than the matched one by noise alone; as much is no evidence.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from cartoloop.arrays import FloatArray
from cartoloop.config import WallStepConfig
from cartoloop.local_slam.match_records import WallMemory
from cartoloop.local_slam.missed_motion import MissedMotion
from cartoloop.local_slam.wall_comparison import (
    Comparison,
    EarlierScan,
    compare,
    is_sharp,
)
from cartoloop.sensor.pose import Pose, wrap_angle
from cartoloop.sensor.range_noise import no_noise

FAR_QUANTILE = 0.8
"""The noise at this quantile of the ranges counts: what is not bare is mostly far away."""

_NEIGHBOUR = 1.5
"""Steps that differ by less than this many are neighbours: noise decides between them."""

_FASTER = 2.0
"""Evidence of a velocity counts for velocities up to this many times as high."""

_NOTHING = (0.0, 0.0)
"""No velocity [m/s], and no distance [m]."""


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
        self._last: EarlierScan | None = None
        self._evidence, self._side, self._missed = 0.0, _NOTHING, _NOTHING
        self._is_due = True
        self._moved_at = -math.inf

    @property
    def memory(self) -> WallMemory:
        """What it remembers from scan to scan, besides the scan."""
        return WallMemory(self._evidence, *self._side, *self._missed, self._is_due, self._moved_at)

    @memory.setter
    def memory(self, memory: WallMemory) -> None:
        self._evidence, side_x, side_y, missed_x, missed_y, self._is_due, self._moved_at = memory
        self._side, self._missed = (side_x, side_y), (missed_x, missed_y)

    @property
    def missed_velocity(self) -> tuple[float, float]:
        """What the latest comparison adds to the velocity of the match [m/s], local frame."""
        return self._side

    def add(self, time: float, pose: Pose, tf_tracking_sensor: Pose, returns: FloatArray) -> None:
        """Remember a scan, with its pose in the local frame; `returns` in the tracking frame."""
        if self._last is not None and not self._is_due:
            return
        self._last = EarlierScan(time, pose, tf_tracking_sensor, returns)

    def correct(self, missed: MissedMotion) -> None:
        """Correct the pose of the scan before, which the odometry's rest has held."""
        if self._last is not None:
            pose = missed.corrected(self._last.time, self._last.pose)
            self._last = replace(self._last, pose=pose)

    def better_pose(
        self,
        time: float,
        pose: Pose,
        returns: FloatArray,
        *,
        by_odometry: bool = False,
        stands: bool = False,
        match_ratio: float = 0.0,
        noise: Callable[[], float] = no_noise,
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
        noise : returns the standard deviation of the ranges, if they are noisy [m]: it is seldom
            needed.
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
            or min(len(last.returns), len(returns)) < config.min_num_returns
            or (by_odometry and not self._overlap(last.pose, pose))
            or 0.0 < time - self._moved_at < config.max_standstill
        ):
            return None
        turn = abs(wrap_angle(pose.theta - last.pose.theta))
        turns_too_far = turn > math.radians(config.max_turn_deg)
        if turns_too_far and self._evidence == 0.0:
            return None  # The comparison would only reduce the evidence.
        found, sigma = None, max(config.sigma, noise())
        # Noise determines a match along bare walls, too, and speaks against any step.
        noisy = sigma / config.sigma
        if not by_odometry or match_ratio <= noisy * config.max_match_ratio:
            found = compare(last, time, pose, returns, config, by_odometry=by_odometry, sigma=sigma)
        if found is None:
            if by_odometry:
                self._forget()
            return None
        self._evidence *= config.evidence_memory
        if turns_too_far or not is_sharp(found, config):
            return None
        # People who walk along fit another step, and all that stands the one of the odometry.
        is_contradicted = (by_odometry or stands) and self._is_contradicted(
            found, noisy * config.max_loss_share
        )
        is_contradicted |= by_odometry and self._is_backwards(found, last.pose, pose)
        missed = self._missed_until(found, time - last.time, by_odometry, is_contradicted)
        if missed is None:
            return None
        x, y = missed
        return Pose(pose.x + x, pose.y + y, pose.theta)

    def _is_contradicted(self, found: Comparison, max_loss_share: float) -> bool:
        """Return whether too much fits the matched step that does not fit the other one."""
        fits_closely = found.cost <= self._config.close_fit * found.num_returns
        return not fits_closely and found.loss_share > max_loss_share

    def _is_backwards(self, found: Comparison, last: Pose, pose: Pose) -> bool:
        """Return whether the robot would move against its wheels: even wheels that slip do not."""
        x, y = found.along.tolist()
        moved: float = x * (pose.x - last.x) + y * (pose.y - last.y)
        step = moved + found.apart
        is_opposite = moved * step < 0.0
        return is_opposite and min(abs(moved), abs(step)) > self._config.min_odometry_error

    def _missed_until(
        self, found: Comparison, duration: float, by_odometry: bool, is_contradicted: bool
    ) -> tuple[float, float] | None:
        """Add up the evidence for another step; return what was missed [m] if it is enough.

        With odometry, each comparison begins where the one before ended, and their steps add up.
        Without, it is evidence for other steps of about that velocity, in that direction.
        """
        config, apart = self._config, found.apart
        along_x, along_y = found.along.tolist()
        speed, (before_x, before_y) = apart / duration, self._side
        side_x, side_y = speed * along_x, speed * along_y
        longest = _FASTER * math.hypot(before_x, before_y) * duration + config.max_distance
        is_opposite = side_x * before_x + side_y * before_y < 0.0
        if is_opposite or (not by_odometry and abs(apart) > longest):
            self._forget()
        self._side = side_x, side_y
        if is_contradicted or (by_odometry and abs(apart) < config.min_odometry_error):
            self._forget()
            return None
        noise_factor = config.odometry_noise_factor if by_odometry else config.noise_factor
        evidence = max(found.matched_cost - found.cost - noise_factor * found.noise, 0.0)
        if abs(apart) < _NEIGHBOUR * config.step:
            evidence = max(evidence - config.evidence_of_noise, 0.0)
        self._evidence += evidence
        step, (missed_x, missed_y) = found.correction(config.step), self._missed
        missed = step * along_x, step * along_y
        if by_odometry:
            missed = missed_x + missed[0], missed_y + missed[1]
        is_proven = self._evidence >= (
            config.min_odometry_evidence if by_odometry else config.min_evidence
        )
        self._missed = _NOTHING if is_proven else missed
        return missed if is_proven else None

    def _forget(self) -> None:
        """Drop the evidence so far."""
        self._evidence, self._missed = 0.0, _NOTHING

    def _overlap(self, last: Pose, pose: Pose) -> bool:
        """Return whether two scans overlap enough to contradict wheels."""
        moved = math.hypot(pose.x - last.x, pose.y - last.y)
        return moved <= self._config.max_odometry_step

    def _is_far(self, last: EarlierScan, time: float, pose: Pose, by_odometry: bool) -> bool:
        """Return whether a scan is so far from the last one that a step can be judged."""
        config = self._config
        longest = config.max_odometry_duration if by_odometry else config.max_duration
        return (
            math.hypot(pose.x - last.pose.x, pose.y - last.pose.y) >= config.min_odometry_step
            or abs(wrap_angle(pose.theta - last.pose.theta))
            > 0.5 * math.radians(config.max_turn_deg)
            or not 0.0 <= time - last.time < longest
        )
