# SPDX-License-Identifier: Apache-2.0
"""Local SLAM on short simulated drives: errors against true poses, nodes, and blind scans."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

import numpy as np
import pytest

from cartoloop.config import Config, LocalSlamConfig
from cartoloop.errors import InputError
from cartoloop.local_slam.odometry_parameters import OdometryParameters
from cartoloop.local_slam.sensor_calibration import SensorCalibration
from cartoloop.sensor.events import Imu, LaserScan, Odometry
from cartoloop.sensor.pose import IDENTITY, Pose
from cartoloop.simulation import (
    Difficulties,
    FloorPlan,
    Lidar,
    OdometryFault,
    OdometryModel,
    World,
    drive,
    make_lidar,
    make_world,
    simulate,
)
from tests.local_slam.small_world import LIDAR, errors, furnished_room, local_slam, record, run

MIN_POINTS = LocalSlamConfig().insertion.min_num_points


@pytest.fixture(scope="module")
def recording():
    return record()


@pytest.fixture(scope="module")
def mapped(recording):
    return run(recording.events())


def with_scans_changed(recording, change, first=0.0, last=math.inf):
    """The events, with `change` applied to ranges between two times after the start."""
    for event in recording.events():
        elapsed = event.time - recording.stamps[0]
        if isinstance(event, LaserScan) and first <= elapsed <= last:
            yield replace(event, ranges=change(event.ranges.copy()))
        else:
            yield event


def all_set_to(value):
    return lambda ranges: np.full_like(ranges, value)


def test_poses_with_odometry_have_errors_of_centimetres(recording, mapped):
    distance, angle = errors(mapped[0], recording.true_poses)
    assert len(distance) == len(recording.stamps)
    assert distance.max() < 0.05
    assert math.degrees(angle.max()) < 1.0


@pytest.mark.parametrize(("field_deg", "rate"), [(180.0, 5.0), (360.0, 10.0)])
def test_pixels_do_not_hold_a_slow_robot(field_deg, rate):
    world, field = furnished_room(), math.radians(field_deg)
    lidar = Lidar(num_beams=180, angle_min=-field / 2, angle_increment=field / 180, rate=rate)
    slow = drive(world.route, speed=0.2)
    recording = simulate(world, lidar, seed=5, duration=15.0, motion=slow)

    poses, _, _ = run(recording.events())

    assert errors(poses, recording.true_poses)[0].max() < 0.1


@pytest.mark.parametrize("odometry", ["none", "frozen"])
def test_pixels_hold_no_slow_robot_without_odometry(odometry):
    """Pixels of the first scan held it for a metre, until the next one was due."""
    world = make_world("office", 800)
    world = replace(world, pace=world.pace._replace(speed=0.2))
    faults = Difficulties(odometry_faults=(OdometryFault.FROZEN,) * (odometry == "frozen"))
    lidar = make_lidar("sick-180")
    recording = simulate(world, lidar, seed=800, duration=12.0, difficulties=faults)

    poses, _, _ = run(recording.events(with_odometry=odometry == "frozen"))

    assert errors(poses, recording.true_poses)[0].max() < 0.05


def test_poses_without_odometry_have_errors_of_centimetres(recording):
    poses, _, _ = run(recording.events(with_odometry=False))
    distance, angle = errors(poses, recording.true_poses)
    assert distance.max() < 0.05
    assert math.degrees(angle.max()) < 1.0


def test_late_and_miscalibrated_odometry_is_corrected():
    bad = OdometryModel(rotation_scale=1.15, translation_scale=0.93, time_offset=0.15)
    recording = record(bad)
    poses, _, slam = run(recording.events())
    distance, angle = errors(poses, recording.true_poses)
    assert distance.max() < 0.08
    assert math.degrees(angle.max()) < 1.5
    assert slam.extrapolator.odometry.model.rotation_scale == pytest.approx(1 / 1.15, rel=0.05)


def test_distances_wrong_by_a_factor_are_learnt():
    """Matches follow odometry along a corridor: only two scans by themselves contradict it."""
    twice = OdometryModel(translation_scale=2.0)
    recording = simulate(make_world("corridor", 1), odometry=twice, seed=1, duration=30.0)
    poses, _, slam = run(recording.events())
    odometry = slam.extrapolator.odometry
    assert odometry.model.translation_scale == pytest.approx(0.5, rel=0.01)
    assert odometry.is_trusted
    distance, _ = errors(poses, recording.true_poses)
    assert distance.max() < 0.2


def test_a_recorded_scan_waits_for_its_odometry(recording):
    """Beyond its readings odometry is a guess, whose error would stay in the path."""
    slam = local_slam(Config(), SensorCalibration(OdometryParameters(time_offset=-0.1), {}))
    scan = next(event for event in recording.events() if isinstance(event, LaserScan))
    time = scan.time + scan.sweep[1]
    slam.add_odometry(Odometry(time, time, IDENTITY))
    assert not slam.is_ready(scan, time + 0.2)
    slam.add_odometry(Odometry(time + 0.2, time + 0.2, IDENTITY))
    assert slam.is_ready(scan, time + 0.2)


def test_a_scan_does_not_wait_long_for_odometry_that_ended(recording):
    slam = local_slam(Config())
    scan = next(event for event in recording.events() if isinstance(event, LaserScan))
    slam.add_odometry(Odometry(scan.time - 5.0, scan.time - 5.0, IDENTITY))
    assert not slam.is_ready(scan, scan.time + 0.4)
    assert slam.is_ready(scan, scan.time + scan.sweep[1] + 0.6)


def test_odometry_read_once_a_second_shows_the_way_along_walls():
    """The walls show nothing of the way along them; what was read last is sent with each scan."""
    plan = FloorPlan()
    for y in (0.0, 2.2):
        plan.wall((0.0, y), (80.0, y))
    world = World("bare walls", plan.segments(), np.array([(15.0, 1.0), (65.0, 1.2)]))
    recording = simulate(world, replace(LIDAR, range_max=10.0), seed=3, duration=60.0)
    slam, queue, poses = local_slam(Config()), deque(), []
    for event in held_odometry(recording, 1.0):
        if isinstance(event, Odometry):
            slam.add_odometry(event)
        else:
            queue.append(event)
        while queue and slam.is_ready(queue[0], event.time):
            poses.append(slam.add_scan(queue.popleft()).tf_local_tracking)
    later = slice(len(poses) // 3, len(poses))  # the period has become known
    distance, _ = errors(np.array(poses)[later], recording.true_poses[later])
    assert distance.max() < 0.5  # the odometry measures 1% too much


def held_odometry(recording, period):
    """Yield the events of a recording; what the odometry has read is sent again for a period."""
    read, last = -math.inf, None
    for event in recording.events():
        if isinstance(event, Odometry):
            if event.time - read >= period:
                read, last = event.time, event.tf_odom_tracking
            yield replace(event, tf_odom_tracking=last)
        else:
            yield event


def test_disabled_odometry_equals_absent_odometry(recording):
    config = Config(local_slam={"use_odometry": False})
    switched_off, _, _ = run(recording.events(), config)
    absent, _, _ = run(recording.events(with_odometry=False))
    assert np.array_equal(switched_off, absent)


def test_the_same_events_give_the_same_bits(recording, mapped):
    again, _, _ = run(recording.events())
    assert np.array_equal(again, mapped[0])


def test_nodes_are_numbered_and_hold_their_scans(recording, mapped):
    _, results, _ = mapped
    nodes = [(scan, result.node) for scan, result in enumerate(results) if result.node]
    assert [node.index for _, node in nodes] == list(range(len(nodes)))
    assert 20 < len(nodes) <= len(results)
    for scan, node in nodes:
        assert node.tf_local_tracking == results[scan].tf_local_tracking
        assert node.time == recording.stamps[scan]
        assert 1 <= len(node.submaps) <= 2
        assert len(node.points) >= MIN_POINTS
        assert np.linalg.eigvalsh(node.information).min() > 0.0


def test_submaps_begin_and_end_with_nodes(recording):
    config = Config(local_slam={"submaps": {"num_range_data": 10}})
    _, results, slam = run(recording.events(), config)
    nodes = [result.node for result in results if result.node]
    finished = [node.finished.index for node in nodes if node.finished]
    seen = sorted({submap.index for node in nodes for submap in node.submaps})
    assert seen == list(range(len(seen)))
    assert finished == seen[: len(finished)]
    assert len(finished) == len(nodes) // 10 - 1
    assert [submap.index for submap in slam.active_submaps] == seen[len(finished) :]


def test_occupied_cells_are_on_the_true_walls(recording, mapped):
    """Cells of high probability are within about a pixel of the walls."""
    _, _, slam = mapped
    start = recording.true_poses[0]
    submap = slam.active_submaps[0]
    rows, cols = np.nonzero(submap.grid.cells > 0.8)
    r = submap.grid.resolution
    x = submap.tf_local_submap.x + submap.grid.origin_x + r * cols
    y = submap.tf_local_submap.y + submap.grid.origin_y + r * rows
    cos, sin = math.cos(start[2]), math.sin(start[2])
    x, y = start[0] + cos * x - sin * y, start[1] + sin * x + cos * y
    outer = np.min(np.abs([x - 0.06, x - 8.94, y - 0.06, y - 6.94]), axis=0) < 1.5 * r
    cupboard = (np.abs(y - 3.25) < 0.9) & (x < 0.75)
    box = (np.abs(x - 7.25) < 0.9) & (y > 6.15)
    pillars = (np.hypot(x - 4.5, y - 3.5) < 0.4) | (np.hypot(x - 2.0, y - 5.8) < 0.5)
    assert len(x) > 200
    assert (outer | cupboard | box | pillars).mean() > 0.99


@pytest.mark.parametrize("value", [81.91, math.inf, math.nan, 0.0, -1.0])
def test_scans_without_returns_are_bridged_by_odometry(recording, value):
    events = with_scans_changed(recording, all_set_to(value), 8.0, 9.0)
    poses, results, _ = run(events)
    blind = [k for k, result in enumerate(results) if not result.was_matched]
    assert blind[0] == 0  # the first scan cannot be matched
    assert len(blind) == 1 + 6
    assert all(results[k].node is None for k in blind[1:])
    distance, _ = errors(poses, recording.true_poses)
    assert distance.max() < 0.2


def two_rooms(gap):
    """Two rooms of 8 x 6 m, open to each other, so far apart, and a route through both."""
    plan = FloorPlan()
    for x, back in ((0.0, 0.0), (8.0 + gap, 16.0 + gap)):
        plan.wall((x, 0.0), (x + 8.0, 0.0))
        plan.wall((x, 6.0), (x + 8.0, 6.0))
        plan.wall((back, 0.0), (back, 6.0))
        plan.box((x + 1.0, 0.0), (x + 2.5, 0.8))
        plan.pillar((x + 5.5, 4.8), 0.3)
    route = [(1.5, 2.5), (7.0, 3.0), (10.0 + gap, 3.0), (14.5 + gap, 2.5)]
    return World("two rooms", plan.segments(), np.array(route))


@pytest.mark.parametrize(("gap", "is_blind"), [(24.0, True), (2.0, False)])
def test_after_a_blind_stretch_a_new_submap_begins(gap, is_blind):
    """What was seen before and after it is related by odometry alone."""
    lidar = Lidar(range_max=6.0, no_return=6.5)
    _, results, slam = run(simulate(two_rooms(gap), lidar, seed=4).events())
    nodes = [result.node for result in results if result.node is not None]
    here = [node for node in nodes if node.tf_local_tracking.x < 8.0 + 0.5 * gap - 1.5]
    first, *there = nodes[len(here) :]
    old = {submap.index for node in here for submap in node.submaps}
    new = {submap.index for node in there for submap in node.submaps}
    assert old.isdisjoint(new) == is_blind
    if is_blind:
        assert [submap.index for submap in first.submaps] == [max(old), min(new)]
        # The odometry is less sure of the pose than matches are.
        certain = np.median([node.information[2, 2] for node in there])
        assert first.information[2, 2] < 0.2 * certain
        assert slam.active_submaps[-1].index == max(new)


def test_mapping_starts_with_the_first_returns(recording):
    poses, results, _ = run(with_scans_changed(recording, all_set_to(math.nan), 0.0, 1.0))
    assert [result.node is not None for result in results[:7]] == [False] * 6 + [True]
    distance, _ = errors(poses[6:], recording.true_poses[6:])
    assert distance.max() < 0.06


def test_a_recording_without_returns_has_poses_but_no_nodes(recording):
    poses, results, slam = run(with_scans_changed(recording, all_set_to(math.inf)))
    assert len(poses) == len(recording.stamps)
    assert not any(result.node or result.was_matched for result in results)
    assert slam.active_submaps == ()


def test_scans_with_too_few_returns_are_not_matched(recording):
    def blinded(ranges):
        ranges[MIN_POINTS - 1 :] = math.nan
        return ranges

    _, results, _ = run(with_scans_changed(recording, blinded, 8.0, 9.0))
    assert sum(not result.was_matched for result in results) == 1 + 6


def test_random_missing_beams_do_no_harm(recording):
    rng = np.random.default_rng(8)

    def thinned(ranges):
        ranges[rng.random(len(ranges)) < 0.3] = math.nan
        return ranges

    poses, _, _ = run(with_scans_changed(recording, thinned))
    distance, _ = errors(poses, recording.true_poses)
    assert distance.max() < 0.06


def test_a_jump_of_the_odometry_does_no_harm(recording):
    def jumping():
        for event in recording.events():
            if isinstance(event, Odometry) and event.time - recording.stamps[0] > 10.0:
                x, y, theta = event.tf_odom_tracking
                moved = event.tf_odom_tracking._replace(x=x + 3.0, y=y - 2.0, theta=theta)
                yield replace(event, tf_odom_tracking=moved)
            else:
                yield event

    poses, _, _ = run(jumping())
    distance, _ = errors(poses, recording.true_poses)
    assert distance.max() < 0.2


@pytest.mark.parametrize(("with_odometry", "end"), [(True, 10.5), (False, 9.5)])
def test_what_happens_while_scans_are_lost_is_found_out(recording, with_odometry, end):
    """Wheels slip meanwhile; without them, nothing measures the motion."""
    begin = recording.stamps[0]

    def lossy():
        for event in recording.events(with_odometry=with_odometry):
            elapsed = event.time - begin
            if isinstance(event, Odometry):
                x, y, theta = event.tf_odom_tracking
                slip = 1.2 * min(max((elapsed - 8.2) / 2.0, 0.0), 1.0)
                yield replace(event, tf_odom_tracking=Pose(x + slip, y - 0.6 * slip, theta))
            elif not 8.0 < elapsed < end:
                yield event

    poses, _, _ = run(lossy())
    kept = (recording.stamps - begin <= 8.0) | (recording.stamps - begin >= end)
    distance, _ = errors(poses, recording.true_poses[kept])
    assert distance.max() < 0.06


def test_odometry_that_ends_early_does_no_harm(recording):
    events = (
        event
        for event in recording.events()
        if not isinstance(event, Odometry) or event.time - recording.stamps[0] < 12.0
    )
    poses, _, _ = run(events)
    distance, _ = errors(poses, recording.true_poses)
    assert distance.max() < 0.2


def test_a_robot_at_rest_keeps_its_pose(recording):
    scans = [event for event in recording.events() if isinstance(event, LaserScan)]
    rng = np.random.default_rng(9)
    still = [
        replace(scan, ranges=scans[0].ranges + rng.normal(scale=0.01, size=scans[0].ranges.shape))
        for scan in scans
    ]
    poses, results, slam = run(still)
    assert np.abs(poses[:, :2]).max() < 0.02
    assert np.abs(poses[:, 2]).max() < 0.005
    assert not slam.extrapolator.odometry.model.is_known
    assert sum(result.node is not None for result in results) < 8


def test_a_gyroscope_that_contradicts_scans_is_not_used(recording, mapped):
    def with_imu():
        for event in recording.events():
            yield Imu(event.stamp, event.time, (0.0, 0.0, 9.81), (0.0, 0.0, 0.3))
            yield event

    poses, _, slam = run(with_imu())
    distance, _ = errors(poses, recording.true_poses)
    assert distance.max() < 0.1
    assert not slam.extrapolator.gyroscope.calibration.agrees


def test_an_imu_can_be_disabled(recording, mapped):
    def with_imu():
        for event in recording.events():
            yield Imu(event.stamp, event.time, (0.0, 1.0, 9.81), (0.0, 0.0, 0.3))
            yield event

    config = Config(local_slam=LocalSlamConfig(use_imu=False))
    assert np.array_equal(run(with_imu(), config)[0], mapped[0])


def test_no_event_is_no_error():
    poses, results, slam = run([])
    assert poses.shape == (0, 3)
    assert results == []
    assert slam.active_submaps == ()


def test_a_walker_without_odometry_is_tracked_from_rest():
    # A regression: here a velocity prior of zero kept the walker at rest for metres.
    recording = simulate(make_world("museum", 4), seed=4, duration=9.0)
    poses, _, _ = run(recording.events())
    distance, _ = errors(poses, recording.true_poses)
    assert np.hypot(*(recording.true_poses[-1] - recording.true_poses[0])[:2]) > 8.0
    assert distance.max() < 0.2


def moved_and_delayed(recording, distance, pause):
    """The events, shifted after 5 s by a distance [m] and a pause [s], with blind scans then."""
    for event in with_scans_changed(recording, all_set_to(np.inf), first=5.0, last=6.0):
        if event.time - recording.stamps[0] < 5.0:
            yield event
        elif isinstance(event, Odometry):
            x, y, theta = event.tf_odom_tracking
            there = Pose(x + distance, y, theta)
            yield replace(event, time=event.time + pause, tf_odom_tracking=there)
        else:
            yield replace(event, time=event.time + pause)


@pytest.mark.parametrize("distance", [1e5, 1e8, 1e9, 1e18])
def test_scans_further_apart_than_a_submap_raise(recording, distance):
    with pytest.raises(InputError, match=r"at the scan with stamp .* odometry jumped"):
        run(moved_and_delayed(recording, distance, pause=distance))


def test_scans_far_apart_are_mapped_without_odometry(recording):
    config = Config(local_slam=LocalSlamConfig(use_odometry=False))
    poses, _, _ = run(moved_and_delayed(recording, 1e9, pause=1e9), config)
    assert np.isfinite(poses).all()
    assert np.abs(poses).max() < 100.0
