# SPDX-License-Identifier: Apache-2.0
"""Maps of tilting, sweeping, multiple and 3D scanners, compared with the truth.

Loop closure is off: the errors are those of local SLAM in a room that stays in view.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from cartoloop.config import Config, GlobalSlamConfig, LocalSlamConfig, SensorConfig
from cartoloop.mapper import Mapper
from cartoloop.sensor.events import Imu, LaserScan, Odometry, PointCloud
from cartoloop.sensor.pose import Pose
from cartoloop.simulation import Lidar, OdometryModel, drive
from cartoloop.simulation.drives import simulate_rig
from cartoloop.simulation.gait import Gait
from cartoloop.simulation.imu import ImuModel
from cartoloop.simulation.motion import delayed
from cartoloop.simulation.rig import MountedLidar
from tests.local_slam.small_world import furnished_room

pytestmark = pytest.mark.slow

WIDE = Lidar(
    num_beams=541, angle_min=math.radians(-135.0), angle_increment=math.radians(0.5), rate=10.0
)
HALF = Lidar(rate=10.0)
STANDING_S = 2.0


def mapped(events, sensor=None, **local_slam):
    config = Config(
        sensor=sensor or SensorConfig(),
        local_slam=LocalSlamConfig(**local_slam),
        global_slam=GlobalSlamConfig(optimize_every_n_nodes=0),
    )
    mapper = Mapper(config)
    for event in events:
        mapper.add(event)
    return mapper.finish()


def error(result, recording):
    """Root mean square distance [m] of the trajectory, after the best alignment with the truth."""
    found, truth = (
        (poses[:, 0] - poses[:, 0].mean()) + 1j * (poses[:, 1] - poses[:, 1].mean())
        for poses in (result.trajectory, recording.true_poses)
    )
    turn = np.angle(np.vdot(found, truth))
    return float(np.sqrt(np.mean(np.abs(found * np.exp(1j * turn) - truth) ** 2)))


def walk(seed=1, speed=1.0, turn_rate=1.0, rounds=2, **kwargs):
    world = furnished_room()
    motion = drive(np.vstack([world.route] * rounds), speed, turn_rate)
    standing = STANDING_S if kwargs.get("gait") else 0.0
    return simulate_rig(world, motion=delayed(motion, standing), seed=seed, **kwargs)


def at_once(events):
    """The events, with scans whose beams seem to be measured at once."""
    geometries = {}
    for event in events:
        if isinstance(event, LaserScan):
            geometry = geometries.setdefault(
                event.geometry, replace(event.geometry, time_increment=0.0)
            )
            yield replace(event, geometry=geometry)
        else:
            yield event


def test_gravity_corrects_most_of_the_error_of_swaying():
    walker = Gait(math.radians(8.0), bounce=0.015, start=STANDING_S)
    scanners = [MountedLidar(WIDE, sweep=0.075)]
    plain = walk(rounds=1, scanners=scanners, gait=Gait(start=STANDING_S), imu=ImuModel())
    level = error(mapped(plain.events()), plain)
    tilted = walk(rounds=1, scanners=scanners, gait=walker, imu=ImuModel())
    assert error(mapped(tilted.events()), tilted) < 1.5 * level
    assert error(mapped(tilted.events(), project_to_horizontal=False), tilted) > 1.5 * level


@pytest.mark.parametrize("source", ["odometry", "imu"])
def test_deskewing_corrects_most_of_the_error_of_turning(source):
    sensors = {source: OdometryModel() if source == "odometry" else ImuModel()}
    plain = walk(1, 0.8, 2.0, rounds=1, scanners=[MountedLidar(WIDE)], **sensors)
    still = error(mapped(plain.events()), plain)
    moving = walk(1, 0.8, 2.0, rounds=1, scanners=[MountedLidar(WIDE, sweep=0.075)], **sensors)
    assert error(mapped(moving.events()), moving) < 1.3 * still
    assert error(mapped(at_once(moving.events())), moving) > 3.0 * still


def test_a_sweep_that_only_the_user_states_is_deskewed():
    moving = walk(1, 0.8, 2.0, rounds=1, scanners=[MountedLidar(WIDE, sweep=0.075)])
    stated = mapped(moving.events())
    given = mapped(at_once(moving.events()), sensor=SensorConfig(sweep_s=0.075))
    assert given.trajectory == pytest.approx(stated.trajectory, abs=1e-6)


def test_scans_alone_are_deskewed_nearly_as_well():
    plain = walk(1, 0.8, 2.0, rounds=1, scanners=[MountedLidar(WIDE)])
    moving = walk(1, 0.8, 2.0, rounds=1, scanners=[MountedLidar(WIDE, sweep=0.075)])
    assert error(mapped(moving.events()), moving) < 1.5 * error(mapped(plain.events()), plain)


FRONT = MountedLidar(replace(HALF, tf_tracking_sensor=Pose(0.3, 0.1, 0.2)), "front", sweep=0.05)
REAR = MountedLidar(
    replace(HALF, rate=7.0, tf_tracking_sensor=Pose(-0.3, -0.1, math.pi)), "rear", delay=0.03
)


def test_two_scanners_make_one_map():
    recording = walk(rounds=1, scanners=[FRONT, REAR])
    result = mapped(recording.events())

    assert error(result, recording) < 0.02
    assert result.report.skipped == {}
    counts = result.report.extra["scanners"]
    assert counts["front"] > counts["rear"] > 100
    assert sum(counts.values()) == len(result.stamps) == result.report.input.scans
    names = [event.geometry.sensor for event in recording.events() if isinstance(event, LaserScan)]
    nodes = [names[index] for index in result.node_scan_index]
    assert 0.5 < nodes.count("rear") / nodes.count("front") < 1.1


def test_two_scanners_can_measure_at_the_same_times():
    twin = replace(REAR, lidar=replace(REAR.lidar, rate=10.0), delay=0.0, sweep=0.05)
    recording = walk(rounds=1, scanners=[FRONT, twin], odometry=OdometryModel())
    result = mapped(recording.events())
    assert result.report.skipped == {}
    assert error(result, recording) < 0.02


RINGS = MountedLidar(
    Lidar(num_beams=360, angle_min=-math.pi, angle_increment=math.radians(1.0), rate=10.0),
    "rings",
    height=0.3,
    sweep=0.09,
    elevations=tuple(np.radians(np.arange(-15.0, 16.0, 5.0))),
)


def test_clouds_are_mapped_and_clear_free_space():
    recording = walk(rounds=1, scanners=[RINGS])
    result = mapped(recording.events())
    assert error(result, recording) < 0.03
    assert sum(isinstance(event, PointCloud) for event in recording.events()) == len(result.stamps)
    grid = result.submap_grids[0]
    assert grid is not None
    assert result.report.skipped == {}


def test_a_cloud_and_a_scan_of_a_swaying_body_make_one_map():
    recording = walk(
        rounds=1,
        scanners=[RINGS, FRONT],
        gait=Gait(math.radians(8.0), 0.015, STANDING_S),
        imu=ImuModel(),
    )
    assert error(mapped(recording.events()), recording) < 0.03


def test_pitched_and_upside_down_scanners_make_one_map():
    scanners = [
        replace(FRONT, pitch=math.radians(10.0)),
        replace(REAR, roll=math.pi, height=0.2),
    ]
    recording = walk(rounds=1, scanners=scanners, odometry=OdometryModel())
    assert error(mapped(recording.events()), recording) < 0.03


def test_a_reset_of_the_odometry_does_no_harm():
    recording = walk(rounds=1, scanners=[FRONT], odometry=OdometryModel())

    def with_reset():
        middle = recording.start_stamp + 0.5 * recording.duration
        for event in recording.events():
            if isinstance(event, Odometry) and event.time > middle:
                moved = event.tf_odom_tracking
                yield replace(event, tf_odom_tracking=moved._replace(x=moved.x - 7.0))
            else:
                yield event

    result = mapped(with_reset())
    assert result.report.extra["odometry"]["jumps"] == 1
    assert error(result, recording) < 0.02


@pytest.mark.parametrize(
    "slips",
    [
        OdometryModel(slips_per_metre=0.5, slip_angle=0.3),
        OdometryModel(skids_per_metre=0.3, skid_length=0.2),
    ],
    ids=["one wheel", "both"],
)
def test_wheels_that_slip_do_little_harm(slips):
    recording = walk(rounds=1, scanners=[FRONT], odometry=slips)
    assert error(mapped(recording.events()), recording) < 0.03


@pytest.mark.parametrize("offset", [-0.2, 0.14, 0.64])
def test_the_offset_of_the_odometrys_clock_is_reported(offset):
    recording = walk(rounds=1, scanners=[FRONT], odometry=OdometryModel(time_offset=offset))
    result = mapped(recording.events())
    assert result.report.extra["odometry"]["time_offset_s"] == pytest.approx(offset, abs=0.02)
    # Until the robot has turned enough, the odometry is wrong.
    assert error(result, recording) < 0.06


def test_the_report_contains_the_imu_estimates():
    recording = walk(
        rounds=1,
        scanners=[FRONT],
        gait=Gait(math.radians(8.0), 0.015, STANDING_S),
        imu=ImuModel(),
    )
    imu = mapped(recording.events()).report.extra["imu"]
    assert imu["readings"] == sum(isinstance(event, Imu) for event in recording.events())
    assert imu["measures_gravity"]
    assert imu["measures_heading"]
    assert imu["rests"] >= 1
    assert math.radians(5.0) < imu["max_tilt_rad"] < math.radians(13.0)
    assert imu["gyro_bias_rad_s"] == pytest.approx(ImuModel().gyro_bias, abs=0.003)


def test_the_same_events_give_the_same_map():
    recording = walk(rounds=1, scanners=[FRONT, REAR], imu=ImuModel())
    first, second = mapped(recording.events()), mapped(recording.events())
    assert np.array_equal(first.trajectory, second.trajectory)


def test_queued_scans_are_mapped_in_the_end():
    recording = walk(rounds=1, scanners=[FRONT], odometry=OdometryModel())
    scans = [event for event in recording.events() if isinstance(event, LaserScan)]
    mapper = Mapper()
    mapper.add(Odometry(scans[0].time, scans[0].time, Pose(0.0, 0.0, 0.0)))
    mapper.add(scans[0])
    assert len(mapper.result().stamps) == 0
    mapper.add(scans[1])
    mapper.add(Odometry(scans[1].time, scans[1].time, Pose(0.0, 0.0, 0.0)))
    assert len(mapper.result().stamps) == 1
    assert len(mapper.finish().stamps) == 2


def test_an_overlong_sweep_does_not_delay_scans():
    recording = walk(rounds=1, scanners=[FRONT], odometry=OdometryModel())
    scans = [event for event in recording.events() if isinstance(event, LaserScan)]
    endless = replace(scans[0].geometry, time_increment=10.0)
    mapper = Mapper()
    for scan in scans[:30]:  # three seconds
        mapper.add(Odometry(scan.time, scan.time, Pose(0.0, 0.0, 0.0)))
        mapper.add(replace(scan, geometry=endless))
    assert len(mapper.result().stamps) >= 19
    assert len(mapper.finish().stamps) == 30
