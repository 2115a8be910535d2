# SPDX-License-Identifier: Apache-2.0
"""Where scans fit that fit nowhere near their predictions: at another heading, in agreement.

A robot that is turned by hand, or whose odometry reports a wrong turn, stands where it stood, but
no scan fits at the heading that is expected. One scan may fit at a wrong heading by chance. The
next one then fits at another: only what two in turn say is believed.
"""

from __future__ import annotations

import math

from cartoloop.sensor.pose import Pose, compose, inverse, wrap_angle

HEADINGS_RAD = (2.0 * math.pi / 3.0, -2.0 * math.pi / 3.0)
"""Centres of the searches, from the predicted heading: with the window of lost scans they and the
search there cover all headings [rad]."""

MIN_LOST_SCANS = 2
"""Number of scans in turn that fit nowhere, from which other headings are searched."""

MAX_STEP_M = 0.1
"""A robot that moves by more from scan to scan drives [m], and its wheels show the heading."""

AGREE_M, AGREE_RAD = 0.3, math.radians(10.0)
"""Difference of the poses that two scans show up to which they agree [m], [rad]."""


class LostHeading:
    """Where the latest lost scan fits at another heading.

    Attributes
    ----------
    tf_found_predicted : from where the robot was predicted to where it was found, in the local
        frame; None if the latest scan is not lost, or fits at no other heading.
    """

    def __init__(self) -> None:
        self.tf_found_predicted: Pose | None = None

    def add(self, predicted: Pose, found: Pose | None) -> bool:
        """Add a lost scan; return whether the one before shows the same.

        Parameters
        ----------
        predicted, found : tf_local_tracking, predicted and as it fits at another heading; None if
            it fits at none.
        """
        before, self.tf_found_predicted = self.tf_found_predicted, None
        if found is None:
            return False
        self.tf_found_predicted = compose(found, inverse(predicted))
        if before is None:
            return False
        expected = compose(before, predicted)
        return (
            math.hypot(found.x - expected.x, found.y - expected.y) <= AGREE_M
            and abs(wrap_angle(found.theta - expected.theta)) <= AGREE_RAD
        )
