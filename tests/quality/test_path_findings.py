# SPDX-License-Identifier: Apache-2.0
"""Gaps, jumps, blind stretches and standing, in runs made by hand."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from cartoloop.config import QualityConfig
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.quality import motion, scan_changes
from cartoloop.quality.blind_stretches import blind_stretches
from cartoloop.quality.corridors import corridors
from cartoloop.quality.encounters import Encounters
from cartoloop.quality.motion_places import (
    FEW_TEARS,
    blind_places,
    jump_places,
    tear_places,
    without_gaps,
)
from cartoloop.quality.odometry_use import length_error
from cartoloop.quality.pairs import Pairs
from cartoloop.quality.verdict import Severity


@dataclass
class Run:
    stamps: np.ndarray
    local_trajectory: np.ndarray
    node_scan_index: np.ndarray
    node_points: list = field(default_factory=list)
    submap_grids: list = field(default_factory=list)

    @property
    def trajectory(self):
        return self.local_trajectory

    @property
    def graph(self):
        graph = PoseGraph()
        graph.add_nodes(self.trajectory[self.node_scan_index])
        return graph


def drive(speed=1.0, seconds=20.0, rate=5.0):
    """Return a run straight ahead, a node every fifth of a metre."""
    stamps = 100.0 + np.arange(int(seconds * rate)) / rate
    poses = np.zeros((len(stamps), 3))
    poses[:, 0] = speed * (stamps - 100.0)
    return Run(stamps, poses, np.arange(len(stamps)))


def room(half=3.0, shift=0.0):
    """Return the outline of a square room, whose right wall may be elsewhere."""
    along = np.linspace(-half, half, 40)
    right = np.column_stack((np.full(40, half + shift), along))
    others = [(along, np.full(40, half)), (along, np.full(40, -half)), (np.full(40, -half), along)]
    return np.concatenate((right, *(np.column_stack(wall) for wall in others)))


def without(run, first, last, *, moved):
    """Return a run without the scans of some seconds, during which it moved or did not."""
    kept = (run.stamps < first) | (run.stamps >= last)
    poses = run.local_trajectory[kept]
    after = run.stamps[kept] >= last
    if not moved:
        poses[after, 0] -= poses[after][0, 0] - poses[~after][-1, 0]
    return Run(run.stamps[kept], poses, np.arange(int(kept.sum())))


def test_an_even_drive_has_no_events():
    run = drive()

    assert motion.gaps(run) == []
    assert motion.jumps(run) == []
    assert blind_stretches(run) == []
    assert motion.standing(run) == []


def test_a_gap_counts_if_the_poses_missed_the_motion():
    [gap] = motion.gaps(without(drive(), 108.0, 114.0, moved=False))

    assert gap.seconds == pytest.approx(6.2)
    assert gap.moved == pytest.approx(0.0, abs=1e-9)
    assert gap.expected == pytest.approx(6.2, rel=0.1)


def test_a_gap_that_the_odometry_bridged_is_none():
    assert motion.gaps(without(drive(), 108.0, 114.0, moved=True)) == []


def test_a_robot_that_stands_may_pause():
    assert motion.gaps(without(drive(speed=0.0), 108.0, 114.0, moved=False)) == []


def stopping(speed, braking=0.0):
    """Return a run that stands after a gap, having moved on by a length [m]."""
    run = without(drive(speed), 108.0, 114.0, moved=False)
    after = run.stamps >= 114.0
    run.local_trajectory[after, 0] = run.local_trajectory[~after][-1, 0] + braking
    return run


def test_a_robot_at_speed_does_not_stop_at_once():
    [gap] = motion.gaps(stopping(1.0))

    assert gap.scan == 40
    assert gap.expected == pytest.approx(0.25)


def test_nor_does_it_start_at_once():
    run = stopping(1.0)
    run.stamps = 220.0 - run.stamps[::-1]
    run.local_trajectory = run.local_trajectory[::-1].copy()

    assert len(motion.gaps(run)) == 1


@pytest.mark.parametrize(("speed", "braking"), [(1.0, 0.3), (0.4, 0.0)])
def test_a_robot_may_stop_during_a_gap(speed, braking):
    assert motion.gaps(stopping(speed, braking)) == []


def test_scans_after_each_metre_have_no_gaps_in_time():
    run = without(drive(speed=1.0, rate=1.0, seconds=40.0), 108.0, 120.0, moved=False)
    assert len(motion.gaps(run)) == 1

    run.stamps += np.cumsum(np.arange(len(run.stamps)) % 3)
    assert motion.gaps(run) == []


def test_gaps_among_disordered_stamps_are_not_believed():
    run = without(drive(), 108.0, 114.0, moved=False)
    run.stamps[30] -= 0.5

    assert motion.gaps(run) == []


def test_a_turn_during_a_gap_is_seen_in_the_scans():
    run = without(drive(speed=0.0), 108.0, 114.0, moved=False)
    wide = room() * (2.0, 0.5)
    run.node_points = [wide] * 40 + [wide[:, ::-1]] * (len(run.stamps) - 40)

    [misfit] = motion.misfits(run)

    assert misfit.scan == 40
    run.node_points = [wide] * len(run.stamps)
    assert motion.misfits(run) == []


@pytest.mark.parametrize(("people", "misfits"), [(0.0, 1), (-1.0, 0)])
def test_a_smaller_part_counts_where_else_nothing_moves(people, misfits):
    run = without(drive(speed=0.0), 108.0, 114.0, moved=False)
    before, after = room() * (1.0, 0.6), room() * (0.8, 0.6)
    run.node_points = [before] * 40 + [after] * (len(run.stamps) - 40)
    run.node_points[37] = room(shift=people) * (1.0, 0.6)

    share = scan_changes.changed_share(run, 39, 40)
    assert motion.UNUSUAL_SHARE < share < motion.MISFIT_SHARE
    assert len(motion.misfits(run)) == misfits


def seen_ahead(points, theta, mounted):
    """Return what a scanner of 180 degrees sees at a heading, tracking frame."""
    cos, sin = np.cos(theta), np.sin(theta)
    turned = points @ np.array(((cos, -sin), (sin, cos)))
    return turned[turned @ (np.cos(mounted), np.sin(mounted)) > 0.0]


@pytest.mark.parametrize("mounted", [0.0, np.pi, -2.0])
def test_what_a_scanner_had_not_looked_at_is_no_misfit(mounted):
    run = without(drive(speed=0.0), 108.0, 114.0, moved=False)
    before, after = 40, len(run.stamps) - 40
    run.local_trajectory[before:, 2] = 1.1
    run.node_points = [seen_ahead(room(), 0.0, mounted)] * before + [
        seen_ahead(room(), 1.1, mounted)
    ] * after
    assert motion.misfits(run) == []

    run.node_points[before:] = [seen_ahead(room() * (0.4, 1.6), 1.1, mounted)] * after
    assert [misfit.scan for misfit in motion.misfits(run)] == [before]


def test_jumps_are_faster_than_robots():
    run = drive()
    run.local_trajectory[50:, 1] += 2.0

    [jump] = motion.jumps(run)

    assert jump.scan == 50
    assert jump.moved == pytest.approx(2.01, abs=0.01)


@dataclass
class Finished(Run):
    """A run whose finished trajectory is another than that of local SLAM."""

    finished: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def trajectory(self):
        return self.finished


def finished(run, moved):
    """Return a run whose scans from the 50th on are elsewhere in the finished map."""
    poses = run.local_trajectory.copy()
    poses[50:, :2] += moved
    return Finished(run.stamps, run.local_trajectory, run.node_scan_index, finished=poses)


def test_steps_that_only_the_finished_map_makes_tear_it():
    run = finished(drive(), (0.0, 3.0))
    run.finished[51:, 1] += 2.0  # the next step, too

    [tear] = motion.tears(run)
    [place] = tear_places([tear], run)

    assert motion.jumps(run) == []
    assert (tear.scan, tear.seconds) == (50, pytest.approx(0.2))
    assert (tear.moved, tear.expected) == (pytest.approx(3.01, abs=0.01), pytest.approx(0.2))
    assert place.severity is Severity.DOUBTFUL
    assert "3.0 m from one scan to the next, 0.2 m by the scans" in place.reason


@pytest.mark.parametrize(
    ("num_moved", "severity"), [(1, Severity.MINOR), (5, Severity.MINOR), (30, Severity.DOUBTFUL)]
)
def test_a_tear_of_a_few_scans_is_minor(num_moved, severity):
    run = finished(drive(), (0.0, 3.0))
    run.finished[50 + num_moved :, 1] -= 3.0

    tears = motion.tears(run)

    assert 50 <= tears[0].scan <= 51
    assert {place.severity for place in tear_places(tears, run)} == {severity}


@pytest.mark.parametrize(
    ("count", "severity"), [(FEW_TEARS, Severity.MINOR), (FEW_TEARS + 1, Severity.DOUBTFUL)]
)
def test_many_tears_are_not_minor(count, severity):
    run = finished(drive(), (0.0, 0.0))
    for scan in range(10, 10 + 20 * count, 20):
        run.finished[scan, 1] += 3.0

    places = tear_places(motion.tears(run), run)

    assert [place.severity for place in places] == [severity] * count


def test_scans_that_come_back_elsewhere_are_torn():
    run = finished(drive(), (0.0, 3.0))
    run.finished[53:, 1] -= 2.0

    away, back = motion.tears(run)

    assert (away.scan, back.scan) == (50, 53)
    assert {place.severity for place in tear_places([away, back], run)} == {Severity.DOUBTFUL}


@pytest.mark.parametrize(("scan", "num_left"), [(49, 0), (50, 0), (40, 1)])
def test_what_is_torn_at_a_gap_is_the_gap(scan, num_left):
    run = finished(drive(), (0.0, 3.0))
    run.node_scan_index = np.array((0, 30, 48, 51, 60))
    gap = motion.Event(51, 7.0, 0.0, 7.0)

    assert len(without_gaps([motion.Event(scan, 0.2, 3.0, 0.2)], [gap], run)) == num_left


def test_corrections_by_loop_closures_tear_nothing():
    assert motion.tears(finished(drive(), (0.0, 0.6))) == []


def test_a_jump_of_the_scans_is_no_tear():
    run = drive()
    run.local_trajectory[50:, 1] += 2.0

    assert motion.tears(finished(run, (0.1, 0.1))) == []


def visits(nodes, own_nodes, contradicts):
    """Return 10 m of path on which nodes see a submap of others, or contradict it."""
    count, nothing = len(nodes), np.zeros(len(nodes))
    pairs = Pairs(
        np.zeros(count, np.int64),
        np.array(nodes),
        np.array(own_nodes),
        np.zeros((count, 3)),
        nothing + 100.0,
        nothing,
        np.full(count, 50),
        np.zeros(count, np.int64),
    )
    first = np.arange(count)
    length = np.full(count, 10.0 / count)
    does = np.full(count, contradicts)
    return Encounters(first, first + 1, pairs, length, nothing, nothing * np.nan, does)


@pytest.mark.parametrize(
    ("met", "severity"),
    [
        (visits([80, 90], [10, 20], False), Severity.MINOR),
        (visits([80, 90], [10, 20], True), Severity.DOUBTFUL),
        (visits([80, 90], [60, 70], False), Severity.DOUBTFUL),
        (visits([55, 60], [45, 40], False), Severity.DOUBTFUL),
    ],
)
def test_a_jump_is_minor_where_visits_agree_away_from_it(met, severity):
    run = drive()
    run.local_trajectory[50:, 1] += 2.0

    [place] = jump_places(motion.jumps(run), met, run)

    assert place.severity is severity


def test_scans_without_nodes_in_between_are_a_blind_stretch():
    run = drive()
    run.node_scan_index = np.concatenate((np.arange(40), np.arange(70, 100)))

    [blind] = blind_stretches(run)

    assert blind.scan == 70
    assert blind.moved == pytest.approx(6.2)


def test_a_drive_that_begins_or_ends_unseen_is_blind_there():
    run = drive()
    run.node_scan_index = np.arange(30, 60)

    begin, end = blind_stretches(run)

    assert (begin.scan, end.scan) == (30, 99)
    assert (begin.moved, end.moved) == pytest.approx((6.0, 8.0))


def box():
    """Return the near side of a box, seen by some beams."""
    return np.column_stack((np.full(15, 4.0), np.linspace(-0.2, 0.2, 15)))


def test_nodes_that_show_a_box_only_are_a_blind_stretch():
    run = drive()
    run.node_points = [box() if 40 <= node < 70 else room() for node in range(100)]

    [blind] = blind_stretches(run)

    assert blind.scan == 69
    assert blind.moved == pytest.approx(5.8)


def test_forgotten_returns_do_not_make_a_path_blind():
    run = drive()
    run.node_points = [box()] * 100

    assert blind_stretches(run, is_whole=False) == []


def test_a_second_scanner_that_sees_little_makes_nothing_blind():
    run = drive()
    run.node_points = [box(), room()] * 50

    assert blind_stretches(run) == []


def test_coarse_scans_of_a_room_are_not_blind():
    run = drive()
    run.node_points = [room()[::8]] * 100

    assert blind_stretches(run) == []


@pytest.mark.parametrize(
    ("noise", "agrees", "severity"),
    [
        (0.01, True, Severity.MINOR),
        (0.1, True, Severity.DOUBTFUL),
        (0.01, False, Severity.DOUBTFUL),
    ],
)
def test_a_blind_stretch_needs_visits_and_good_odometry(noise, agrees, severity):
    run = drive()
    run.node_scan_index = np.concatenate((np.arange(40), np.arange(70, 100)))
    odometry = {"translation_error_m": 0.01, "metre_noise_m": noise, "measured_metres": 100}
    met = visits([5, 8], [60, 65], not agrees)

    [place] = blind_places(blind_stretches(run), met, odometry, run, QualityConfig())

    assert place.severity is severity


@pytest.mark.parametrize(
    "odometry",
    [
        None,
        {
            "translation_error_m": 0.01,
            "metre_noise_m": 0.01,
            "measured_metres": 100,
            "faults": [{"begin": 0.0, "end": None}],
        },
    ],
)
def test_a_long_blind_stretch_without_odometry_is_doubtful(odometry):
    run = drive()
    run.node_scan_index = np.concatenate((np.arange(40), np.arange(70, 100)))
    met = visits([5, 8], [60, 65], [False, False])

    [place] = blind_places(blind_stretches(run), met, odometry, run, QualityConfig())

    assert place.severity is Severity.DOUBTFUL
    assert "constant velocity" in place.reason


def test_a_recording_of_a_scan_each_metres_is_not_blind():
    run = drive(speed=3.0, rate=1.0)

    assert blind_stretches(run) == []


@pytest.mark.parametrize(("shift", "changed"), [(0.0, 0.0), (-1.0, 0.25)])
def test_returns_that_move_while_the_pose_stands_are_counted(shift, changed):
    run = drive(speed=0.0, seconds=25.0, rate=0.2)
    run.node_points = [room(), room(shift=shift), room(), room(shift=shift), room()]

    [stand] = motion.standing(run)

    assert (stand.first, stand.last, stand.seconds) == (0, 4, 20.0)
    assert stand.changed == pytest.approx(changed, abs=0.06)


def among_people(points, bearings):
    """Return what a scanner sees of a room with people two metres away, half a metre wide."""
    seen = points.copy()
    angles = np.arctan2(points[:, 1], points[:, 0])
    for bearing in bearings:
        is_hidden = np.abs(angles - bearing) < 0.125
        seen[is_hidden] = 2.0 * np.column_stack((np.cos(angles), np.sin(angles)))[is_hidden]
    return seen


@pytest.mark.parametrize(("shift", "changed"), [(0.0, 0.0), (-1.0, 0.25)])
def test_people_around_a_robot_that_stands_do_not_count(shift, changed):
    run = drive(speed=0.0, seconds=25.0, rate=0.2)
    run.node_points = [
        among_people(room(shift=shift * (row % 2)), 0.8 * row + np.array((-2.5, -0.5, 0.5)))
        for row in range(5)
    ]

    [stand] = motion.standing(run)

    assert scan_changes.changed_share(run, 0, 1) > 0.1
    assert stand.changed == pytest.approx(changed, abs=0.06)


def test_corridors_are_seen_by_their_walls():
    run = drive()
    along = np.linspace(-8.0, 8.0, 80)
    walls = np.concatenate([np.column_stack((along, np.full(80, y))) for y in (-1.0, 1.0)])
    run.node_points = [room()] * 60 + [walls] * 40

    halls = corridors(run, 10.0, None)

    assert not halls.is_corridor[halls.nodes < 40].any()
    assert halls.is_corridor[halls.nodes > 80].all()


def test_a_length_is_known_as_well_as_metres_were_measured():
    known = {"translation_error_m": 0.001, "rotation_error_rad": 0.01}
    measured = known | {"metre_noise_m": 0.03, "measured_metres": 100}

    assert length_error(100.0, measured) == pytest.approx(0.03 * np.sqrt(200.0))
    assert length_error(100.0, measured | {"measured_metres": 10_000}) < 0.305
    assert length_error(100.0, known) == pytest.approx(1.8)


def with_outliers(share):
    """Return a robot that stands in a room, with returns before the walls at random."""
    rng, run = np.random.default_rng(3), drive(speed=0.0)
    for _ in run.stamps:
        points = room()
        is_wrong = rng.random(len(points)) < share
        nearer = points * rng.uniform(0.2, 0.8, (len(points), 1))
        run.node_points.append(np.where(is_wrong[:, np.newaxis], nearer, points))
    return run


def test_returns_that_change_everywhere_show_no_motion():
    assert scan_changes.usual_change(with_outliers(0.0)) == 0.0
    assert scan_changes.usual_change(with_outliers(0.2)) > 0.05
    assert scan_changes.usual_change(drive()) == 0.0
