# SPDX-License-Identifier: Apache-2.0
"""Two scans compared along a direction that walls leave open: the step that fits best.

Between its dots a wall is taken for a straight line. See :mod:`cartoloop.local_slam.wall_step`.
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
from cartoloop.local_slam.outline import Outline, outline_of
from cartoloop.sensor.free_standing import are_free_standing
from cartoloop.sensor.pose import Pose, compose, inverse

_STRIDE = 3
"""Of the steps that are tried against odometry, every third is tried first: most often none of them
fits better than the matched one, since the wheels do not slip."""


@dataclass(frozen=True)
class EarlierScan:
    """A scan that later ones are compared with.

    Attributes
    ----------
    time : [s].
    pose : local frame.
    tf_tracking_sensor : of its scanner.
    returns : float64, shape (n, 2), tracking frame [m].
    """

    time: float
    pose: Pose
    tf_tracking_sensor: Pose
    returns: FloatArray

    @cached_property
    def outline(self) -> Outline:
        """Its returns but for people, joined to walls."""
        returns = without_people(self.returns, self.tf_tracking_sensor)
        return outline_of(returns, self.tf_tracking_sensor)


def without_people(returns: FloatArray, tf_tracking_sensor: Pose) -> FloatArray:
    """Return the returns that are not on narrow objects that stand free.

    People who walk along would show a robot at rest, others one that moves faster.
    """
    x, y, _ = tf_tracking_sensor
    return returns[~are_free_standing(returns - np.array((x, y)), also_hidden=True)]


class Comparison(NamedTuple):
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
    num_returns : number of returns that were compared.
    """

    apart: float
    costs: tuple[float, ...]
    matched_cost: float
    noise: float
    loss: float
    along: FloatArray
    num_returns: int

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


def compare(
    last: EarlierScan,
    time: float,
    pose: Pose,
    returns: FloatArray,
    config: WallStepConfig,
    *,
    by_odometry: bool,
    sigma: float,
) -> Comparison | None:
    """Compare a scan, but for people, with one before; None where lines determine all directions.

    Against odometry, also None where no step fits so much better than the matched one as odometry
    must fit worse.

    Parameters
    ----------
    time, pose, returns : of the scan; see :class:`EarlierScan`.
    sigma : of the distance of a return from a wall [m].
    """
    outline, max_gap = last.outline, math.radians(config.max_gap_deg)
    ratio, direction = open_direction(*outline, max_gap)
    if ratio > config.max_ratio or time <= last.time:
        return None
    returns = without_people(returns, last.tf_tracking_sensor)
    tf_sensor_local = inverse(compose(last.pose, last.tf_tracking_sensor))
    axis = math.cos(direction), math.sin(direction)
    direction -= tf_sensor_local.theta
    along = math.cos(direction), math.sin(direction)
    moved = along[0] * (pose.x - last.pose.x) + along[1] * (pose.y - last.pose.y)
    reach = min(config.max_speed * (time - last.time), config.max_step) + config.max_distance
    steps = _steps_to_try(math.ceil(reach / config.step), config.step)
    matched_cost, best, noise, loss, costs = best_step(
        *outline,
        max_gap,
        returns,
        compose(tf_sensor_local, pose)[:],
        axis,
        moved,
        steps,
        _STRIDE if by_odometry else 1,
        (1.0 / config.odometry_cost_ratio, config.close_fit),
        round(config.max_distance / config.step),
        _fit(config, sigma, by_odometry=by_odometry),
    )
    if best < 0:
        return None
    apart = float(steps[best]) - moved
    return Comparison(apart, costs, matched_cost, noise, loss, np.array(along), len(returns))


def _fit(config: WallStepConfig, sigma: float, *, by_odometry: bool) -> Fit:
    """Return what distances from the outline cost, see `best_step`.

    What leaves the view of a scanner is no evidence against odometry. Without odometry it keeps
    noise from making steps of any length along walls that show none.
    """
    unseen = math.nan if by_odometry else config.outside_cost
    return sigma, config.max_distance, config.outside_cost, unseen, unseen


@lru_cache(maxsize=256)
def _steps_to_try(count: int, step: float) -> FloatArray:
    """Return steps [m], ascending: all that the robot can make, and a margin to judge them by."""
    return step * np.arange(-count, count + 1, dtype=np.float64)


def is_sharp(found: Comparison, config: WallStepConfig) -> bool:
    """Return whether steps on both sides fit worse: a slope alone is a wrong heading."""
    shorter, *_, longer = found.costs
    # Neither is true of a cost that is NaN, next to the end of the steps.
    return shorter - found.cost >= config.min_rise and longer - found.cost >= config.min_rise
