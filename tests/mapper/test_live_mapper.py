# SPDX-License-Identifier: Apache-2.0
"""Live mapping: the same map, poses without delay, and access to the growing map."""

from __future__ import annotations

import time
from itertools import pairwise
from threading import Event

import numpy as np
import pytest

from cartoloop.config import Config
from cartoloop.mapper import Mapper
from cartoloop.sensor.events import LaserScan, Odometry
from cartoloop.sensor.pose import Pose
from cartoloop.simulation import make_world, simulate
from tests.limits import LIMIT_S

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def drive():
    return simulate(make_world("office", 1), seed=1, duration=60.0)


def small_submaps():
    config = Config()
    submaps = config.local_slam.submaps.model_copy(update={"num_range_data": 25})
    local_slam = config.local_slam.model_copy(update={"submaps": submaps})
    global_slam = config.global_slam.model_copy(update={"optimize_every_n_nodes": 30})
    return config.model_copy(update={"local_slam": local_slam, "global_slam": global_slam})


def test_live_poses_and_map_equal_those_of_a_recording(drive):
    results = []
    for live in (False, True):
        mapper = Mapper(small_submaps(), live=live)
        for event in drive.events(with_odometry=True):
            mapper.add(event)
        results.append(mapper.finish())
    recorded, live = results

    assert np.array_equal(live.stamps, recorded.stamps)
    assert np.array_equal(live.local_trajectory, recorded.local_trajectory)
    assert live.graph.num_nodes == recorded.graph.num_nodes
    assert live.graph.num_submaps == recorded.graph.num_submaps > 4
    assert live.closures.num_found > 0
    assert np.abs(live.trajectory - recorded.trajectory)[:, :2].max() < 0.1


def test_no_pose_waits_for_the_graph(drive):
    mapper = Mapper(live=True)
    may_go_on = Event()
    mapper.run_on_graph_thread(lambda: may_go_on.wait(LIMIT_S) and None)
    for event in drive.events(with_odometry=True):
        mapper.add(event)
        if mapper.num_scans == 50:
            break

    assert mapper.last_scan is not None
    assert mapper.pose != Pose(0.0, 0.0, 0.0)
    assert mapper.num_nodes > 10
    assert mapper.global_slam.graph.num_nodes == 0
    may_go_on.set()
    assert mapper.finish().graph.num_nodes == mapper.num_nodes


def test_a_handed_out_result_does_not_change(drive):
    mapper = Mapper(small_submaps(), live=True)
    handed_out, contents, times = [], [], []

    def content(result):
        return (
            result.closures.status.tobytes(),
            result.closures.found.tf_submap_node.tobytes(),
            [scan.tobytes() for scan in result.node_points],
        )

    def take(result):
        handed_out.append(result)
        contents.append(content(result))

    for event in drive.events(with_odometry=True):
        mapper.add(event)
        if isinstance(event, LaserScan) and mapper.num_scans % 60 == 0:
            mapper.call_with_result(take)
            times.append((mapper.num_scans, mapper.num_nodes))
    mapper.finish()

    assert [(len(r.stamps), r.graph.num_nodes) for r in handed_out] == times
    assert [content(result) for result in handed_out] == contents
    assert [len(result.node_points) for result in handed_out] == [nodes for _, nodes in times]
    for result in handed_out:
        assert len(result.submap_grids) == result.graph.num_submaps
        assert len(result.trajectory) == len(result.stamps)
        assert len(result.node_scan_index) == result.graph.num_nodes


def test_late_odometry_is_used_only_live(drive):
    events = [e for e in drive.events() if isinstance(e, LaserScan)][:3]
    late = Odometry(0.0, events[-1].time - 0.01, Pose(0.0, 0.0, 0.0))
    for live, skipped in ((True, {}), (False, {"time runs backwards": 1})):
        mapper = Mapper(live=live)
        for event in [*events, late]:
            mapper.add(event)
        mapper.close()
        assert dict(mapper.skipped) == skipped


def test_a_failure_of_the_graph_ends_the_run(drive, monkeypatch):
    mapper = Mapper(live=True)
    monkeypatch.setattr(mapper.global_slam, "add_node", lambda node: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        for event in drive.events(with_odometry=True):
            mapper.add(event)
        mapper.finish()
    mapper.close()


def test_a_pose_is_published_before_its_scan_is_inserted(drive):
    mapper = Mapper(small_submaps(), live=True)
    published, nodes_then = [], []

    def on_pose():
        published.append(mapper.local_pose)
        nodes_then.append(mapper.num_nodes)

    nodes_before = []
    for event in drive.events(with_odometry=True):
        if isinstance(event, LaserScan):
            nodes_before.append(mapper.num_nodes)
        mapper.add(event, on_pose)
        if mapper.num_scans == 40:
            break
    result = mapper.finish()

    assert nodes_then == nodes_before
    assert nodes_then[0] == 0
    assert result.graph.num_nodes > 10
    assert np.array_equal(result.local_trajectory, np.array(published))


def test_closures_join_long_before_the_next_adjustment(drive):
    config, joined = small_submaps(), []
    mapper = Mapper(config, live=True)
    slam = mapper.global_slam
    for event in drive.events(with_odometry=True):
        mapper.add(event)
        if isinstance(event, LaserScan):  # in real time, searches end before the next scan
            done = Event()
            mapper.run_on_graph_thread(done.set)
            assert done.wait(LIMIT_S)
            while slam.search.num_running:
                time.sleep(0.001)
            joined.append((slam.graph.num_nodes, slam.num_loop_closures))
    mapper.close()

    period = config.global_slam.optimize_every_n_nodes
    came_at = {
        nodes % period for (nodes, now), (_, before) in pairwise(reversed(joined)) if now > before
    }
    assert len(came_at) > 1
    waited = slam.closures.num_nodes_to_join()
    assert len(waited) == slam.closures.num_found > 0
    assert waited.max() <= 2 * (period // config.global_slam.live_searches_per_adjustment) + 1
    assert slam.num_put_off == 0
