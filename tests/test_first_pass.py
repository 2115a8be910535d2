# SPDX-License-Identifier: Apache-2.0
"""What the beginning of a recording shows about its odometry, before it is mapped."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import cartoloop
from cartoloop.config import Config, LocalSlamConfig
from cartoloop.errors import Interrupted
from cartoloop.event_intake import EventIntake
from cartoloop.first_pass import calibrate
from cartoloop.local_slam.sensor_calibration import SensorCalibration
from cartoloop.mapper import Mapper
from cartoloop.readers import open_log
from cartoloop.sensor.events import LaserScan, Odometry
from cartoloop.sensor.pose import Pose
from cartoloop.simulation import OdometryModel, drive, simulate
from cartoloop.stop_request import StopRequest
from tests.local_slam.small_world import LIDAR, furnished_room

OFFSET = 0.4


@pytest.fixture(scope="module")
def late(tmp_path_factory):
    """A minute-long recording whose odometry is late."""
    path = tmp_path_factory.mktemp("late") / "late.log"
    world = furnished_room()
    motion = drive(np.vstack([world.route] * 12), 1.0, 1.0)
    odometry = OdometryModel(time_offset=OFFSET)
    simulate(world, LIDAR, odometry, seed=2, motion=motion).write_carmen(path)
    return open_log(path)


def test_a_clock_offset_is_known_after_a_part_of_the_recording(late):
    model = calibrate(late, Config(), StopRequest())

    assert model is not None
    assert model.odometry.time_offset == pytest.approx(OFFSET, abs=0.03)


def test_the_pass_ends_at_its_limit(late, monkeypatch):
    mapped = []
    take = EventIntake.take
    monkeypatch.setattr(EventIntake, "take", lambda self, e: (mapped.append(e), take(self, e))[1])

    monkeypatch.setattr("cartoloop.first_pass.MAX_SHARE", 0.01)
    monkeypatch.setattr("cartoloop.first_pass.LEAST_SCANS", 0)
    monkeypatch.setattr("cartoloop.first_pass.MOST_SCANS", 0)
    model = calibrate(late, Config(), StopRequest())

    num_scans = sum(isinstance(event, LaserScan) for event in mapped)
    assert model is None
    assert num_scans <= 0.01 * late.num_scans + 1


def test_the_pass_goes_on_until_the_robot_has_turned(late, monkeypatch):
    monkeypatch.setattr("cartoloop.first_pass.MAX_SHARE", 0.01)
    monkeypatch.setattr("cartoloop.first_pass.LEAST_SCANS", 0)
    model = calibrate(late, Config(), StopRequest())

    assert model is not None
    assert model.odometry.knows_rotation


def test_the_pass_goes_on_until_the_scale_is_measured(tmp_path, monkeypatch):
    path, world = tmp_path / "squares.log", furnished_room()
    square = world.route[0] + 0.3 * np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    motion = drive(np.vstack([*[square] * 4, *[world.route] * 3]), 1.0, 1.0)
    simulate(world, LIDAR, OdometryModel(), seed=2, motion=motion).write_carmen(path)
    monkeypatch.setattr("cartoloop.first_pass.MAX_SHARE", 0.01)
    monkeypatch.setattr("cartoloop.first_pass.LEAST_SCANS", 0)
    model = calibrate(open_log(path), Config(), StopRequest())

    # After the squares, which show the rotation only.
    assert model is not None
    assert model.odometry.knows_scale


class OtherHand:
    """A recording whose odometry turns to the other side."""

    def __init__(self, log):
        self.num_scans, self._log = log.num_scans, log

    def __iter__(self):
        for event in self._log:
            if isinstance(event, Odometry):
                x, y, theta = event.tf_odom_tracking
                yield replace(event, tf_odom_tracking=Pose(x, -y, -theta))
            else:
                yield event


def test_odometry_of_the_other_hand_is_known_from_the_start(late):
    model = calibrate(OtherHand(late), Config(), StopRequest())

    assert model is not None
    assert model.odometry_is_mirrored
    assert SensorCalibration.from_dict(model.to_dict()) == model
    mapper = Mapper(calibration=model)
    for event, _ in zip(OtherHand(late), range(20), strict=False):
        mapper.add(event)
    mapper.close()
    assert mapper.calibration.odometry_is_mirrored


def test_odometry_that_is_not_used_is_not_learnt(late):
    config = Config(local_slam=LocalSlamConfig(use_odometry=False))
    assert calibrate(late, config, StopRequest()) is None


def test_the_mapper_starts_with_what_was_learnt(late):
    model = calibrate(late, Config(), StopRequest())
    mapper = Mapper(calibration=model)
    for event, _ in zip(late, range(20), strict=False):
        mapper.add(event)
    mapper.close()

    assert mapper.calibration.odometry == model.odometry


def test_a_run_learns_first_and_counts_nothing_twice(late, monkeypatch):
    given = []
    init = Mapper.__init__

    def note(self, *args, **kwargs):
        given.append(kwargs.get("calibration"))
        init(self, *args, **kwargs)

    monkeypatch.setattr(Mapper, "__init__", note)
    result = cartoloop.map_recording(late)

    assert len(given) == 1
    assert given[0] is not None
    assert result.report.input.scans == late.num_scans == len(result.stamps)
    assert result.report.extra["odometry"]["time_offset_s"] == pytest.approx(OFFSET, abs=0.03)


@pytest.mark.parametrize("failure", [RuntimeError, KeyboardInterrupt])
def test_a_failure_is_left_to_the_pass_that_maps(late, monkeypatch, failure):
    def fail(self, event):
        raise failure

    stop = StopRequest()
    monkeypatch.setattr(EventIntake, "take", fail)
    assert calibrate(late, Config(), stop) is None
    assert stop.made == (failure is KeyboardInterrupt)


def test_a_stop_before_the_first_scan_ends_the_run(late):
    stop = StopRequest()
    stop.made = True
    with pytest.raises(Interrupted, match="stopped before the first scan: nothing was saved"):
        cartoloop.map_recording(late, stop=stop)
