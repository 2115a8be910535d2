# SPDX-License-Identifier: Apache-2.0
"""Two drives of one building become one map; those of two buildings stay apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import cartoloop
from cartoloop import Mapper, UsageError
from cartoloop.evaluation.trajectories import absolute_trajectory_error
from cartoloop.global_slam.closure_status import Status
from cartoloop.localisation.known_map import known_map_of
from cartoloop.map_output.main_part import main_scans, main_submaps
from cartoloop.result import load_map
from cartoloop.sensor.events import LaserScan
from cartoloop.sensor.pose import relative_all
from cartoloop.session import MAIN_PART
from cartoloop.simulation import ring, simulate
from tests.conftest import mapped

MAX_ERROR_M = 0.1


def halves(events):
    """Return the events of the first half of the scans, and those of the second."""
    scans = [i for i, event in enumerate(events) if isinstance(event, LaserScan)]
    middle = scans[len(scans) // 2]
    return events[:middle], events[middle:]


@pytest.fixture(scope="module")
def rounds(two_rounds):
    """The events of the first round through the ring, and of the second."""
    return halves(list(two_rounds.events()))


@pytest.fixture(scope="module")
def maps(rounds):
    return [mapped(events) for events in rounds]


@pytest.fixture(scope="module")
def merged(maps):
    return cartoloop.merge(maps)


@pytest.fixture(scope="module")
def elsewhere():
    """The map of a drive in another building, whose corridors are as long and as wide."""
    return mapped(simulate(ring(seed=7), seed=2, duration=40.0).events())


@pytest.fixture(scope="module")
def strangers(maps, elsewhere):
    return cartoloop.merge([maps[0], elsewhere])


def true_error(result, simulated):
    """Return the mean distance of the scans from the truth [m], fitted."""
    poses = simulated.true_poses[np.searchsorted(simulated.stamps, result.stamps - 1e-6)]
    return float(absolute_trajectory_error(result.trajectory, poses).mean())


def test_drives_of_which_one_is_stretched_are_joined():
    # Without a first pass, the first round is half a percent too long: matched once, too many of
    # its scans contradict the other.
    simulated = simulate(ring(seed=9), seed=9)
    stretched = cartoloop.merge([mapped(each) for each in halves(list(simulated.events()))])
    assert [session.part for session in stretched.sessions] == [MAIN_PART, MAIN_PART]
    assert true_error(stretched, simulated) < MAX_ERROR_M


def test_drives_of_one_building_are_joined(merged):
    assert [session.part for session in merged.sessions] == [MAIN_PART, MAIN_PART]
    (join,) = merged.report.extra["joins"]
    assert join["joined"]
    assert join["agreeing_scans"] >= 3
    assert join["contradicted_m"] <= 0.1 * join["overlap_m"]


def test_all_that_was_requested_is_searched(merged):
    closures = merged.closures
    assert not np.any(closures.search_status[: closures.num_requested] == Status.WAITING)


def test_merged_map_is_as_true_as_its_drives(merged, maps, two_rounds):
    apart = [true_error(each, two_rounds) for each in maps]
    assert true_error(merged, two_rounds) < 1.1 * np.mean(apart)


def test_sessions_begin_where_the_maps_did(merged, maps):
    second = merged.sessions[1]
    assert second.first_scan == len(maps[0].stamps)
    assert second.first_node == maps[0].graph.num_nodes
    assert second.first_submap == maps[0].graph.num_submaps


def test_order_of_the_maps_gives_the_frame(merged, maps):
    other = cartoloop.merge(maps[::-1])
    assert {session.part for session in other.sessions} == {MAIN_PART}
    np.testing.assert_allclose(other.graph.submap_poses[0], maps[1].graph.submap_poses[0])
    np.testing.assert_allclose(merged.graph.submap_poses[0], maps[0].graph.submap_poses[0])


def test_merging_twice_gives_the_same_map(merged, maps, tmp_path):
    again = cartoloop.merge(maps)
    for result, name in ((merged, "one"), (again, "other")):
        result.save(tmp_path / name)
    for name in ("map.cartoloop", "trajectory.tum", "map.pgm"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "other" / name).read_bytes()


def test_maps_do_not_change_when_they_are_merged(rounds, maps, merged):
    again = mapped(rounds[0])
    np.testing.assert_array_equal(again.graph.node_poses, maps[0].graph.node_poses)
    assert len(again.closures) == len(maps[0].closures)


def test_drives_of_two_buildings_stay_apart(strangers):
    assert [session.part for session in strangers.sessions] == [0, 1]
    (join,) = strangers.report.extra["joins"]
    assert not join["joined"]
    assert join["why_not"]


def test_parts_apart_keep_their_maps(strangers, maps, elsewhere):
    first = maps[0].graph.num_nodes
    nodes = strangers.graph.node_poses
    for ours, theirs in ((nodes[:first], maps[0]), (nodes[first:], elsewhere)):
        apart = relative_all(ours[0], ours) - relative_all(
            theirs.graph.node_poses[0], theirs.graph.node_poses
        )
        assert np.hypot(apart[:, 0], apart[:, 1]).max() < MAX_ERROR_M


def test_only_the_main_part_is_drawn(strangers, maps, tmp_path):
    assert len(main_submaps(strangers).grids) == maps[0].graph.num_submaps
    assert len(main_scans(strangers)) == len(maps[0].stamps)
    strangers.save(tmp_path)
    lines = (tmp_path / "trajectory.tum").read_text().splitlines()
    assert len(lines) == 1 + len(maps[0].stamps)


def test_a_robot_is_located_in_the_main_part_only(strangers, maps):
    ours, alone = known_map_of(strangers), known_map_of(maps[0])
    assert np.abs(np.subtract(ours.grid.shape, alone.grid.shape)).max() <= 2
    assert ours.usual.agreement == pytest.approx(alone.usual.agreement, abs=0.01)


def test_parts_apart_are_in_the_file(strangers, tmp_path):
    strangers.save(tmp_path)
    read = load_map(tmp_path)
    assert [session.part for session in read.sessions] == [0, 1]
    assert read.graph.num_nodes == strangers.graph.num_nodes


def test_merged_map_can_be_merged_again(merged, elsewhere):
    whole = cartoloop.merge([elsewhere, merged])
    assert [session.part for session in whole.sessions] == [0, 1, 1]
    assert whole.graph.num_loop_closures > 0


def test_session_is_added_to_a_map(rounds, maps, two_rounds):
    mapper = Mapper(onto=maps[0])
    for event in rounds[1]:
        mapper.add(event)
    result = mapper.finish()
    assert [session.part for session in result.sessions] == [MAIN_PART, MAIN_PART]
    assert len(result.stamps) == sum(len(each.stamps) for each in maps)
    apart = [true_error(each, two_rounds) for each in maps]
    assert true_error(result, two_rounds) < 1.1 * np.mean(apart)


def test_live_session_is_added_to_a_map(rounds, maps):
    mapper = Mapper(onto=maps[0], live=True)
    for event in rounds[1]:
        mapper.add(event)
    result = mapper.finish()
    assert [session.part for session in result.sessions] == [MAIN_PART, MAIN_PART]


def test_session_that_is_cut_short_is_kept_with_the_map(rounds, maps):
    mapper = Mapper(onto=maps[0])
    for event in rounds[1][:100]:
        mapper.add(event)
    mapper.close()
    result = mapper.result()
    assert result.sessions[0].part == MAIN_PART
    assert result.graph.num_nodes > maps[0].graph.num_nodes
    first = result.graph.node_poses[: maps[0].graph.num_nodes]
    # Adjusted again, to convergence.
    np.testing.assert_allclose(first, maps[0].graph.node_poses, atol=1e-4)


def test_session_is_added_where_it_is_said_to_be(rounds, maps):
    # The second round begins where the first one ends.
    pose = cartoloop.Pose(*maps[0].trajectory[-1].tolist())
    mapper = Mapper(onto=maps[0], onto_pose=pose)
    for event in rounds[1][: len(rounds[1]) // 2]:
        mapper.add(event)
    result = mapper.finish()
    assert [session.part for session in result.sessions] == [MAIN_PART, MAIN_PART]
    assert result.report.extra["joins"][0]["searches"] < 100


def test_map_of_other_submaps_is_refused(maps):
    submaps = maps[0].config.local_slam.submaps.model_copy(update={"resolution": 0.1})
    local = maps[0].config.local_slam.model_copy(update={"submaps": submaps})
    config = maps[0].config.model_copy(update={"local_slam": local})
    with pytest.raises(UsageError, match=r"resolution of 0\.05 m"):
        Mapper(config, onto=maps[0])


@pytest.mark.parametrize("given", [[], ["one"], "text", 5])
def test_too_few_maps_are_refused(given):
    with pytest.raises(UsageError, match="merge"):
        cartoloop.merge(given)


@pytest.mark.parametrize("twice", [["a", "./a/"], ["a", "a/map.cartoloop"], ["a", "b/../a"]])
def test_a_path_that_is_given_twice_is_refused(twice):
    with pytest.raises(UsageError, match="is given twice; give each map once"):
        cartoloop.merge(twice)


def test_a_map_that_is_given_twice_is_refused(maps):
    with pytest.raises(UsageError, match="a map is given twice"):
        cartoloop.merge([maps[0], maps[1], maps[0]])


def test_map_without_returns_is_refused(maps):
    bare = replace(maps[0], node_points=())
    with pytest.raises(UsageError, match="no returns"):
        cartoloop.merge([bare, maps[1]])
