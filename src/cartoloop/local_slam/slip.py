# SPDX-License-Identifier: Apache-2.0
"""Since when wheels slip between bare walls, and what the matches that followed them have missed.

Between bare walls, scans show that wheels slip only once there is something to see. Until then the
matches follow the odometry, whose speed changed when the wheels began to slip.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.sensor.pose import Pose

SLIP_SHARE = 0.3
"""Steps are of the same slip as the last one while their speed differs by less than this share of
what that has missed."""


def since_slip(
    poses: Sequence[tuple[float, Pose]], shown: Pose, missed_velocity: tuple[float, float]
) -> Pose:
    """Return the last pose as it is if the odometry has missed as much since the slip began.

    Parameters
    ----------
    poses : as matched, with times [s], local frame; the last is that of the scan.
    shown : where scans show it to be, by what was missed since they have shown something.
    missed_velocity : by the latest step [m/s], local frame.
    """
    time, matched = poses[-1]
    missed = np.array(missed_velocity)
    speed = float(np.hypot(*missed))
    made_up = np.array((shown.x - matched.x, shown.y - matched.y))
    if len(poses) < 2 or float(made_up @ missed) <= 0.0:
        return shown
    along = missed / speed
    total = (time - slip_began(poses, along, SLIP_SHARE * speed)) * speed
    if total <= float(made_up @ along):
        return shown
    return Pose(matched.x + total * along[0], matched.y + total * along[1], shown.theta)


def slip_began(poses: Sequence[tuple[float, Pose]], along: FloatArray, most: float) -> float:
    """Return since when a robot moves as in its last step [s].

    Parameters
    ----------
    poses : with times [s], two or more.
    along : float64, shape (2,), the direction that counts, a unit vector.
    most : difference of the velocity from that in the last step [m/s].
    """
    begin, last = poses[-1][0], math.nan
    for (start, before), (end, after) in zip(poses[-2::-1], poses[:0:-1], strict=True):
        moved = along[0] * (after.x - before.x) + along[1] * (after.y - before.y)
        velocity = moved / max(end - start, 1e-9)
        last = velocity if math.isnan(last) else last
        if abs(velocity - last) > most:
            break
        begin = start
    return begin


def own_velocity(
    reported: Pose, duration: float, heading: float, missed_velocity: tuple[float, float]
) -> tuple[float, float]:
    """Return the velocity of a robot whose wheels slip [m/s], in its own frame.

    Parameters
    ----------
    reported : step of the odometry.
    duration : of it [s].
    heading : of the robot at its begin [rad], local frame.
    missed_velocity : by that step [m/s], local frame.
    """
    cos, sin = math.cos(heading), math.sin(heading)
    more_x, more_y = missed_velocity
    return (
        reported.x / duration + cos * more_x + sin * more_y,
        reported.y / duration - sin * more_x + cos * more_y,
    )
