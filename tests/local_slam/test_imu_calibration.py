# SPDX-License-Identifier: Apache-2.0
"""The bias of a gyroscope about gravity, from rest and from matched scans."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop.local_slam.imu_calibration import ImuCalibration
from cartoloop.sensor.events import Imu
from cartoloop.sensor.imu_track import ImuTrack
from cartoloop.sensor.pose import Pose

BIAS, RATE_HZ = 0.01, 50


def drive(seconds, *, noise, shows, rest=0.0):
    """Return the bias found by scans whose headings show a share of what the gyroscope errs by.

    Parameters
    ----------
    noise : standard deviation of the headings [rad].
    shows : 1.0 if scans measure the heading, 0.0 if they follow the gyroscope.
    rest : time for which the robot stands at first [s].
    """
    rng = np.random.default_rng(5)
    track, calibration = ImuTrack(10.0), ImuCalibration()
    heading = last = 0.0
    for k in range(round((rest + seconds) * RATE_HZ)):
        time = k / RATE_HZ
        turning = 0.0 if time < rest else 0.3 * np.sin(0.2 * time)
        track.note_standing(time < rest)
        track.add(Imu(time, time, (0.0, 0.0, 9.81), (0.0, 0.0, turning + BIAS)))
        now = float(track.at(np.array((time,)))[0, 2])
        excess = (BIAS - track.gyro_bias[2]) / RATE_HZ
        heading, last = heading + now - last - shows * excess, now
        if time >= rest and k % 10 == 0:
            scan = heading + noise * rng.standard_normal()
            calibration.add(time, Pose(0.0, 0.0, scan), track)
    return track.gyro_bias[2]


@pytest.mark.parametrize("noise", [0.001, 0.005])
def test_scans_show_the_bias_of_a_robot_that_never_rested(noise):
    assert drive(60.0, noise=noise, shows=1.0) == pytest.approx(BIAS, abs=0.0015)


def test_noisy_scans_do_not_change_what_rest_has_shown():
    found = drive(300.0, noise=0.02, shows=0.0, rest=2.0)
    assert found == pytest.approx(BIAS, abs=0.001)


def test_scans_that_were_not_matched_measure_no_bias():
    """The bias stays as unknown as before them."""
    track, calibration = ImuTrack(10.0), ImuCalibration()
    heading = 0.0
    for k in range(180 * RATE_HZ):
        time = k / RATE_HZ
        track.note_standing(False)
        track.add(Imu(time, time, (0.0, 0.0, 9.81), (0.0, 0.0, BIAS)))
        if time < 60.0 and k % 10 == 0:
            calibration.skip()
        elif k % 10 == 0:
            calibration.add(time, Pose(0.0, 0.0, heading), track)
    assert track.gyro_bias[2] == pytest.approx(BIAS, abs=0.001)


def test_scans_follow_a_bias_that_drifts():
    """What rest has shown is soon not true any more: scans show it within minutes."""
    track, calibration = ImuTrack(10.0), ImuCalibration()
    for k in range(600 * RATE_HZ):
        time = k / RATE_HZ
        bias = BIAS * min(time / 300.0, 1.0)
        track.note_standing(time < 2.0)
        track.add(Imu(time, time, (0.0, 0.0, 9.81), (0.0, 0.0, bias)))
        if k % 10 == 0:
            calibration.add(time, Pose(0.0, 0.0, 0.0), track)
    assert track.gyro_bias[2] == pytest.approx(BIAS, abs=0.002)
