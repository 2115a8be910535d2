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

OWN_SHARE, OWN_STEPS = 0.6, 2
"""A slip began if one of the steps before, the second number of them, was faster by at least the
first share of what is missed now. There are two, since it may begin within a step."""


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
    total = (time - slip_began(poses, along, speed)) * speed
    if total <= float(made_up @ along):
        return shown
    return Pose(matched.x + total * along[0], matched.y + total * along[1], shown.theta)


def slip_began(poses: Sequence[tuple[float, Pose]], along: FloatArray, missed: float) -> float:
    """Return since when wheels slip as in the last step [s]; its own time if that is not known.

    Before, matches showed the robot's own speed. Where it did not change by what is missed now, the
    robot was slow, and nothing shows for how long the wheels have slipped.

    Parameters
    ----------
    poses : with times [s], two or more.
    along : float64, shape (2,), the direction that counts, a unit vector.
    missed : speed that the odometry misses in that direction [m/s], positive.
    """
    times = np.array([time for time, _ in poses])
    places = np.array([(pose.x, pose.y) for _, pose in poses]) @ along
    velocities = np.diff(places) / np.maximum(np.diff(times), 1e-9)
    more = velocities - velocities[-1]
    differs = np.flatnonzero(np.abs(more) > SLIP_SHARE * missed)
    begin = int(differs[-1]) + 1 if len(differs) else 0
    is_known = (more[max(begin - OWN_STEPS, 0) : begin] >= OWN_SHARE * missed).any()
    return float(times[begin if is_known else -1])


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
