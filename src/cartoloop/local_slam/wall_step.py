# SPDX-License-Identifier: Apache-2.0
"""The step between two scans along a direction that walls leave open, without odometry.

Along bare walls the map holds a robot where it is: far from the scanner a wall is a row of dots, and
the dots of the next scan lie at the same places in the robot's frame, however far it has moved.
Between its dots a wall is taken for a straight line here. Then bare walls say nothing about the
step, and the little that is not bare says it: the edge of a cupboard, a door post, the end wall.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray
from cartoloop.config import WallStepConfig
from cartoloop.sensor.pose import Pose, compose, inverse, relative, transform_points


class _Outline(NamedTuple):
    """A scan as lines between neighbouring beams, in the frame of its scanner.

    Attributes
    ----------
    bearings : float64, (n,), ascending [rad].
    points : float64, (n, 2), ends of the beams [m].
    is_line : bool, (n - 1,), whether two ends are of neighbouring beams.
    """

    bearings: FloatArray
    points: FloatArray
    is_line: BoolArray


class WallStep:
    """Compares each scan of a scanner with the one before.

    Parameters
    ----------
    config : limits of the comparison.
    """

    def __init__(self, config: WallStepConfig) -> None:
        self._config = config
        self._time = -math.inf
        self._pose: Pose | None = None
        self._tf_tracking_sensor: Pose | None = None
        self._outline: _Outline | None = None
        self._evidence, self._side = 0.0, np.zeros(2)

    def add(self, time: float, pose: Pose, tf_tracking_sensor: Pose, returns: FloatArray) -> None:
        """Remember a scan, with its pose in the local frame; `returns` in the tracking frame."""
        self._time, self._pose = time, pose
        self._tf_tracking_sensor = tf_tracking_sensor
        self._outline = _outline_of(returns, tf_tracking_sensor, self._config)

    def better_pose(self, time: float, pose: Pose, returns: FloatArray) -> Pose | None:
        """Return a pose further along the walls that fits the scan before much better, or None.

        Parameters
        ----------
        time : of the scan [s].
        pose : as matched, local frame.
        returns : shape (n, 2), tracking frame [m].
        """
        config, outline = self._config, self._outline
        if self._pose is None or self._tf_tracking_sensor is None or outline is None:
            return None
        if len(outline.points) < config.min_num_returns or len(returns) < config.min_num_returns:
            return None
        ratio, direction = _open_direction(outline)
        if ratio > config.max_ratio:
            return None
        reach = min(config.max_speed * (time - self._time), config.max_step)
        num_steps = math.floor(reach / config.step)
        if not 0 < time - self._time or num_steps < 1:
            return None
        tf_sensor_local = inverse(compose(self._pose, self._tf_tracking_sensor))
        at_match = transform_points(compose(tf_sensor_local, pose), returns)
        along = np.array((math.cos(direction), math.sin(direction)))
        direction -= tf_sensor_local.theta
        last = relative(self._pose, pose)
        turned = direction - self._pose.theta
        matched_step = last.x * math.cos(turned) + last.y * math.sin(turned)
        steps = config.step * np.arange(-num_steps, num_steps + 1)
        shifts = np.append(steps - matched_step, 0.0)
        costs = _costs(outline, at_match, along, shifts, config)
        best = int(np.argmin(costs[:-1]))
        if abs(last.theta) > math.radians(config.max_turn_deg) or not _is_sharp(
            costs[:-1], best, config
        ):
            self._evidence *= config.evidence_memory
            return None
        # evidence for steps to opposite sides cancels, however the direction is signed
        side = shifts[best] * np.array((math.cos(direction), math.sin(direction)))
        if float(side @ self._side) < 0.0:
            self._evidence = 0.0
        self._side = side
        self._evidence *= config.evidence_memory
        self._evidence += float(costs[-1] - costs[best])
        if self._evidence < config.min_evidence:
            return None
        before, here, after = costs[best - 1 : best + 2].tolist()
        bend = before - 2.0 * here + after
        shift = shifts[best] + (0.5 * config.step * (before - after) / bend if bend > 0.0 else 0.0)
        return Pose(
            pose.x + shift * math.cos(direction), pose.y + shift * math.sin(direction), pose.theta
        )


def _open_direction(outline: _Outline) -> tuple[float, float]:
    """Return how far lines determine a scan along the open direction, and that direction [rad].

    That is the ratio of the eigenvalues of the sum of their normals' squares: 0 between bare walls.
    A line counts by its length, up to a metre: short ones are noise.
    """
    ends = np.diff(outline.points, axis=0)[outline.is_line]
    length = np.hypot(ends[:, 0], ends[:, 1])
    weight = np.minimum(length, 1.0) / np.maximum(length, np.finfo(float).tiny) ** 2
    xx = float((weight * ends[:, 1] ** 2).sum())
    yy = float((weight * ends[:, 0] ** 2).sum())
    xy = -float((weight * ends[:, 0] * ends[:, 1]).sum())
    mean, half = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
    ratio = (mean - half) / (mean + half) if mean > 0.0 else 1.0
    return ratio, 0.5 * math.atan2(2.0 * xy, xx - yy) + 0.5 * math.pi


def _is_sharp(costs: FloatArray, best: int, config: WallStepConfig) -> bool:
    """Return whether steps on both sides of the best fit worse: a slope alone is a wrong heading."""
    reach = round(config.max_distance / config.step)
    if not reach <= best < len(costs) - reach:
        return False
    rise = min(costs[best - reach], costs[best + reach]) - costs[best]
    return bool(rise >= config.min_rise)


def _outline_of(returns: FloatArray, tf_tracking_sensor: Pose, config: WallStepConfig) -> _Outline:
    points = transform_points(inverse(tf_tracking_sensor), returns)
    bearings = np.arctan2(points[:, 1], points[:, 0])
    order = np.argsort(bearings, kind="stable")
    bearings, points = bearings[order], points[order]
    is_line = np.diff(bearings) < math.radians(config.max_gap_deg)
    return _Outline(bearings, points, is_line)


def _costs(
    outline: _Outline,
    points: FloatArray,
    along: FloatArray,
    shifts: FloatArray,
    config: WallStepConfig,
) -> FloatArray:
    """Return for each shift half the sum of squared distances to the outline, in sigmas, truncated.

    Points outside of the outline's lines cost as much at every shift.
    """
    x = points[:, 0] + shifts[:, np.newaxis] * along[0]
    y = points[:, 1] + shifts[:, np.newaxis] * along[1]
    line = np.searchsorted(outline.bearings, np.arctan2(y, x), side="right") - 1
    is_inside = (line >= 0) & (line < len(outline.is_line))
    line = np.clip(line, 0, len(outline.is_line) - 1)
    is_inside &= outline.is_line[line]
    ends = np.diff(outline.points, axis=0)
    ends /= np.maximum(np.hypot(ends[:, 0], ends[:, 1]), np.finfo(float).tiny)[:, np.newaxis]
    from_x, from_y = x - outline.points[line, 0], y - outline.points[line, 1]
    distance = from_x * ends[line, 1] - from_y * ends[line, 0]
    limit = 0.5 * (config.max_distance / config.sigma) ** 2
    cost = np.minimum(0.5 * np.square(distance / config.sigma), limit)
    costs: FloatArray = np.where(is_inside, cost, config.outside_cost * limit).sum(axis=1)
    return costs
