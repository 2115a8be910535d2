# SPDX-License-Identifier: Apache-2.0
"""The mapper on a simulated ring, and events that cannot be used."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import islice

import numpy as np
import pytest

from cartoloop import Config, Imu, Mapper, Odometry, Pose, load_map
from cartoloop.evaluation.trajectories import absolute_trajectory_error
from cartoloop.global_slam import refinement
from cartoloop.global_slam.closure_status import Status
from cartoloop.global_slam.submap_paths import LOST_M
from cartoloop.map_output.save import save
from cartoloop.sensor.events import LaserScan
from cartoloop.simulation import Difficulties, office, ring, simulate


@pytest.fixture(scope="module")
def recording(two_rounds):
    return two_rounds


OPEN_WALLS = {"submaps": {"max_return_gap": 0.0}, "prediction": {"spurious_information": 0.6}}
"""Local SLAM that drifts: walls are open between beams, and long walls leave all to odometry."""


def map_events(events, local_slam=None, **global_slam):
    config = {"global_slam": global_slam, "local_slam": local_slam or {}}
    mapper = Mapper(Config.model_validate(config))
    for event in events:
        mapper.add(event)
    return mapper.finish()


def mean_error(result, recording):
    return float(absolute_trajectory_error(result.trajectory, recording.true_poses).mean())


def test_closing_loops_at_least_halves_the_error(recording, two_rounds_result):
    drifted = map_events(recording.events(), OPEN_WALLS, optimize_every_n_nodes=0)
    mended = map_events(recording.events(), OPEN_WALLS)
    assert mean_error(mended, recording) < 0.12
    assert mean_error(mended, recording) < 0.5 * mean_error(drifted, recording)

    closed = two_rounds_result
    assert mean_error(closed, recording) < 0.02
    assert closed.report.constraints.precision > 0.95
    assert closed.report.constraints.found == len(closed.closures.found) > 0
    assert closed.report.constraints.rejected == closed.closures.counts()[Status.CONTRADICTED]
    assert drifted.report.constraints.loop_closure == 0
    assert drifted.report.adjustment.runs == 0
    assert np.allclose(drifted.trajectory, drifted.local_trajectory, atol=1e-9)


def test_stopping_the_last_pass_keeps_the_loop_closures(recording, monkeypatch):
    match_again = refinement.match_again

    def stopped_at_the_third(submap, *rest):
        if submap.index == 2:
            raise KeyboardInterrupt
        return match_again(submap, *rest)

    monkeypatch.setattr(refinement, "match_again", stopped_at_the_third)
    mapper = Mapper()
    for event in recording.events():
        mapper.add(event)
    with pytest.raises(KeyboardInterrupt):
        mapper.finish()

    result = mapper.result()
    assert result.graph.num_loop_closures == result.closures.num_found > 0


def test_every_scan_has_a_pose_and_nodes_are_among_them(recording):
    result = map_events(islice(recording.events(), 600))

    assert np.array_equal(result.stamps, recording.stamps[:300])
    assert result.trajectory.shape == result.local_trajectory.shape == (300, 3)
    assert len(result.node_scan_index) == result.graph.num_nodes == result.report.nodes
    assert len(result.submap_grids) == result.graph.num_submaps
    at_nodes = result.trajectory[result.node_scan_index]
    assert np.allclose(at_nodes, result.graph.node_poses, atol=1e-12)


def test_an_office_is_mapped_without_odometry():
    recording = simulate(office(), seed=1, duration=60.0)

    result = map_events(recording.events(with_odometry=False))

    assert result.report.input.path_length_m > 30.0
    assert absolute_trajectory_error(result.trajectory, recording.true_poses).max() < 0.15


@pytest.fixture(scope="module")
def paused():
    """A drive round a ring, without odometry, in which 8 s with a turn are missing; and its map."""
    drive = simulate(ring(), seed=1, duration=200.0, difficulties=Difficulties(pause=8.0))
    return drive, map_events(drive.events(with_odometry=False))


@pytest.mark.slow
def test_a_robot_that_was_lost_is_found_where_it_comes_back(paused):
    drive, result = paused
    local = absolute_trajectory_error(result.local_trajectory, drive.true_poses)
    assert local.max() > 3.0
    assert absolute_trajectory_error(result.trajectory, drive.true_poses).mean() < 0.1


@pytest.mark.slow
def test_a_continued_map_knows_where_a_robot_was_lost(paused, tmp_path):
    save(paused[1], tmp_path)
    mapper = Mapper(onto=load_map(tmp_path))
    lost = mapper._global_slam._pairs._gaps.before_submap
    assert (lost[0], lost[-1]) == (0.0, LOST_M)


def test_events_that_cannot_be_used_are_skipped_and_counted(recording):
    good = list(islice(recording.events(), 200))
    scan = next(event for event in good if isinstance(event, LaserScan))
    bad = [
        replace(scan, time=math.nan),
        replace(scan, time=math.inf),
        replace(scan, time=good[100].time - 5.0),
        replace(scan, time=good[101].time),
        replace(scan, time=good[101].time, ranges=scan.ranges[:-1]),
        Odometry(math.nan, math.nan, Pose(0.0, 0.0, 0.0)),
        Odometry(good[101].time, good[101].time, Pose(math.nan, 0.0, 0.0)),
        Odometry(good[101].time, good[101].time, Pose(0.0, 0.0, math.inf)),
    ]

    expected = map_events(good)
    result = map_events([*good[:102], *bad, *good[102:]])

    assert result.report.skipped == {
        "number of ranges does not match the scanner": 1,
        "odometry is not finite": 2,
        "time is not finite": 3,
        "time runs backwards": 1,
        "two scans at one time": 1,
    }
    assert result.report.input.scans == 105
    assert np.array_equal(result.trajectory, expected.trajectory)


def test_inertial_readings_are_accepted(recording):
    mapper = Mapper()
    for event in islice(recording.events(), 20):
        mapper.add(Imu(event.time, event.time, np.array((0.0, 0.0, 9.8)), np.zeros(3)))
        mapper.add(event)

    assert mapper.finish().report.skipped == {}


def test_mapping_continues_after_an_intermediate_result(recording):
    events = list(islice(recording.events(), 400))
    mapper = Mapper()
    for event in events[:200]:
        mapper.add(event)
    middle = mapper.result()
    snapshot = middle.trajectory.copy()
    for event in events[200:]:
        mapper.add(event)
    end = mapper.finish()

    assert len(middle.trajectory) == 100
    assert len(middle.submap_grids) == middle.report.submaps
    assert np.array_equal(middle.trajectory, snapshot)
    assert np.array_equal(end.trajectory, map_events(events).trajectory)


def test_counters_and_pose_follow_the_events(recording):
    mapper = Mapper()
    assert mapper.pose == Pose(0.0, 0.0, 0.0)
    for event in islice(recording.events(), 400):
        mapper.add(event)

    assert mapper.num_scans == 200
    assert 50 < mapper.num_nodes <= 200
    truth = np.linalg.norm(recording.true_poses[199, :2] - recording.true_poses[0, :2])
    assert math.hypot(mapper.pose.x, mapper.pose.y) == pytest.approx(truth, abs=0.2)
    mapper.close()


def test_add_returns_the_pose_of_a_mapped_scan(recording):
    mapper = Mapper()
    for event in islice(recording.events(with_odometry=False), 20):
        pose = mapper.add(event)
        assert pose == (mapper.pose if isinstance(event, LaserScan) else None)
    assert mapper.add(event) is None  # skipped: two scans at one time
    mapper.close()


@pytest.mark.parametrize("ask", [Mapper.result, Mapper.finish])
def test_without_events_there_is_an_empty_result(ask, tmp_path):
    result = ask(Mapper())

    assert result.trajectory.shape == (0, 3)
    assert result.submap_grids == []
    assert result.report.input.scans == 0
    assert result.report.constraints.precision is None
    result.save(tmp_path)
    assert (tmp_path / "map.png").exists()


def test_result_finish_and_close_can_follow_each_other(recording):
    mapper = Mapper()
    for event in islice(recording.events(), 100):
        mapper.add(event)
    mapper.result()
    first = mapper.finish()
    mapper.close()

    assert np.array_equal(mapper.result().trajectory, first.trajectory)


def test_a_growing_map_can_be_read(recording):
    mapper = Mapper()
    assert mapper.last_scan is None
    assert mapper.recorded_s == 0.0
    assert math.isnan(mapper.last_stamp)
    for event in islice(recording.events(), 600):
        mapper.add(event)

    graph = mapper.global_slam.graph
    assert mapper.last_stamp == recording.stamps[299]
    assert mapper.recorded_s == pytest.approx(recording.stamps[299] - recording.stamps[0])
    assert len(mapper.last_scan.returns) > 100
    assert len(mapper.global_slam.node_points) == graph.num_nodes == mapper.num_nodes
    assert mapper.active_submaps[-1].index == graph.num_submaps - 1
    assert mapper.skipped == {}
    result = mapper.finish()
    stamps = result.stamps[result.node_scan_index]
    assert np.array_equal(mapper.node_stamps(0), stamps)
    assert np.array_equal(mapper.node_stamps(5), stamps[5:])
    assert [len(points) for points in result.node_points] == [
        len(points) for points in mapper.global_slam.node_points
    ]
