# SPDX-License-Identifier: Apache-2.0
"""What odometry reports across times without scans."""

from __future__ import annotations

import pytest

from cartoloop.local_slam.odometry_pauses import OdometryPauses
from cartoloop.local_slam.odometry_track import OdometryTrack
from cartoloop.sensor.pose import Pose

PERIOD_S, SCAN_PERIOD_S, SPEED = 0.1, 0.2, 0.5


def driven(pauses, clock, *, late=0.0, recorded=lambda time: True):
    """Drive for 20 s; readings are `late` after the scans of the same time, some are lost."""
    track = OdometryTrack()
    for k in range(200):
        time = PERIOD_S * k
        if recorded(time):
            track.add(clock(time) + late, Pose(SPEED * time, 0.0, 0.0))
        if k % 2 == 0 and not 10.0 < time < 10.0 + pauses.scans_lost_s:
            pauses.add(clock(time), track)
    return pauses.found


class Pauses(OdometryPauses):
    scans_lost_s = 0.0


def jumping(time):
    return time + (3600.0 if time > 9.95 else 0.0)


@pytest.mark.parametrize("late", [0.0, 0.03])
def test_a_clock_that_jumps_shows_a_usual_step(late):
    [pause] = driven(Pauses(), jumping, late=late)

    assert pause.begin == pytest.approx(9.8)
    assert pause.end == pytest.approx(3610.0)
    assert pause.odometry_m == pytest.approx(SPEED * SCAN_PERIOD_S, abs=SPEED * PERIOD_S)
    assert pause.odometry_rad == 0.0


def test_a_robot_that_drives_unrecorded_moves_on():
    pauses = Pauses()
    pauses.scans_lost_s = 5.0
    [pause] = driven(pauses, float, recorded=lambda time: not 10.0 < time < 15.0)

    assert pause.odometry_m == pytest.approx(2.5, abs=0.11)


def test_odometry_that_goes_on_does_not_pause():
    pauses = Pauses()
    pauses.scans_lost_s = 5.0

    assert driven(pauses, float) == []
