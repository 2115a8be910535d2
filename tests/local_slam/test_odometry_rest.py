# SPDX-License-Identifier: Apache-2.0
import math

import pytest

from cartoloop.local_slam.odometry_rest import BEFORE_S, NUM_GAINS, OdometryRest, is_at_rest
from cartoloop.sensor.pose import Pose


def after_driving(speeds, period=0.2):
    rest = OdometryRest()
    for number, speed in enumerate(speeds):
        step = Pose(speed * period, 0.5 * speed * period, 0.01)
        rest.move(number * period, (number + 1) * period, step)
    return rest, len(speeds) * period


def test_the_speed_before_a_rest_is_that_of_its_last_second():
    rest, now = after_driving([5.0] * 10 + [0.4] * round(BEFORE_S / 0.2 + 1))
    rest.begin(now + 0.2)
    assert rest.since == pytest.approx(now + 0.2)
    assert rest.velocity_before == pytest.approx((0.4, 0.2))


def test_a_rest_lasts_from_its_first_scan_to_the_next_motion():
    rest, now = after_driving([0.4] * 5)
    rest.begin(now + 0.2)
    rest.begin(now + 0.4)
    assert rest.since == pytest.approx(now + 0.2)
    rest.move(now + 0.4, now + 0.6, Pose(0.1, 0.0, 0.0))
    assert rest.since == math.inf


def test_a_robot_that_never_drove_has_no_speed():
    rest = OdometryRest()
    rest.begin(1.0)
    assert rest.velocity_before == (0.0, 0.0)


def test_gains_are_averaged_over_the_latest_scans_of_a_rest():
    rest, now = after_driving([0.4] * 5)
    rest.begin(now)
    assert rest.mean_gain(0.3) == pytest.approx(0.3)
    assert rest.mean_gain(0.1) == pytest.approx(0.2)
    assert [rest.mean_gain(0.0) for _ in range(NUM_GAINS)][-1] == 0.0
    rest.move(now, now + 0.2, Pose(0.1, 0.0, 0.0))
    rest.begin(now + 0.4)
    assert rest.mean_gain(0.2) == pytest.approx(0.2)


def test_noise_of_the_heading_is_no_motion():
    assert is_at_rest(Pose(0.0, 0.0, 0.003))
    assert not is_at_rest(Pose(0.001, 0.0, 0.0))
    assert not is_at_rest(Pose(0.0, 0.0, 0.02))
