# SPDX-License-Identifier: Apache-2.0
"""The benchmark of localisation measures what it says, and its particle filter works."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from bench.__main__ import run
from bench.localisation import long_drive, measures
from bench.localisation.benchmark import _reported
from bench.localisation.drives import Drive, carried_away, corners_of, error, with_moved_boxes
from bench.localisation.figures import driving_figures
from bench.localisation.other_buildings import in_map_of, same_plan_row, stranger_row
from bench.localisation.particle_filter import ParticleFilter
from bench.record import Figure, Record, Row, read_record
from cartoloop.localisation.known_map import KnownMap
from cartoloop.localisation.localizer import Localizer
from cartoloop.runtime.process_memory import PeriodicRelease
from cartoloop.sensor.events import LaserScan, Odometry
from cartoloop.sensor.pose import IDENTITY, Pose, compose, relative
from cartoloop.simulation import make_world
from tests.localisation import rooms


def room_drive(steps=30):
    poses = rooms.drive(rooms.START, steps, step=0.05, turn=0.04)
    events = list(rooms.events(rooms.ROOM, poses))
    return Drive("room", None, events, np.array(poses))


@pytest.fixture(scope="module")
def known() -> KnownMap:
    return rooms.known_map(rooms.ROOM)


def test_a_drive_is_followed_with_its_errors(known):
    found = measures.follow(known, room_drive())

    assert found.path == 0.0
    assert found.num_located == sum(found.states.values()) == 31
    assert found.num_wrong == 0
    assert max(found.errors) < 0.1
    assert found.longest_located_s == pytest.approx(3.0)


def test_single_scans_are_claimed_rightly(known):
    found = measures.single_scans(known, room_drive(), 3)

    assert found.overlapping == [True] * 3
    assert found.claimed == found.right == [True] * 3


def test_scans_of_another_place_do_not_overlap_the_map(known):
    drive = room_drive(2)
    drive.truth += (30.0, 0.0, 0.0)

    assert not measures.overlaps(known, drive, 0)


def test_a_robot_is_carried_away_without_a_trace():
    drive = room_drive()

    away = carried_away(drive, at=5, to=20)

    assert len(away.truth) == 6 + 11
    assert len(away.scan_places) == len(away.truth)
    times = [event.time for event in away.events]
    assert all(a <= b + 1e-9 for a, b in pairwise(times))
    odom = [event.tf_odom_tracking for event in away.events if isinstance(event, Odometry)]
    steps = [math.hypot(*relative(a, b)[:2]) for a, b in pairwise(odom)]
    assert max(steps) < 0.2


def test_the_particle_filter_follows_a_robot(known):
    drive = room_drive(120)
    particles = ParticleFilter(known, 3000, 0)
    odom = IDENTITY
    for event in drive.events:
        if isinstance(event, LaserScan):
            angles = event.geometry.angles
            points = event.ranges[:, None] * np.column_stack((np.cos(angles), np.sin(angles)))
            particles.add(odom, points)
        else:
            odom = event.tf_odom_tracking

    pose, sigma = particles.estimate
    assert sigma < 1.0
    assert error(drive.truth[-1], pose)[0] < 0.5


def test_errors_are_those_of_distance_and_angle():
    truth = np.array((1.0, 2.0, 0.5))

    distance, angle = error(truth, compose(Pose(1.0, 2.0, 0.5), Pose(0.3, 0.4, -0.1)))

    assert distance == pytest.approx(0.5)
    assert angle == pytest.approx(0.1)


def test_some_boxes_of_a_world_are_moved():
    world = make_world("office", 1)
    moved = with_moved_boxes(world, np.random.default_rng(0))

    assert 0 < len(world.walls) - len(moved.walls) < 0.4 * len(world.walls)


def test_corners_of_a_path_are_a_metre_apart():
    path = np.column_stack((np.linspace(0.0, 5.0, 51), np.zeros(51), np.zeros(51)))

    assert corners_of(path)[:, 0].tolist() == pytest.approx([0.0, 1.0, 2.0, 3.0, 4.0, 5.0])


def test_a_lap_is_driven_again_and_again(known):
    poses = rooms.drive(rooms.START, 20, step=0.05, turn=0.04)
    there_and_back = [*poses, *reversed(poses)]
    events = list(rooms.events(rooms.ROOM, there_and_back))
    scans = [event for event in events if isinstance(event, LaserScan)]
    period = scans[-1].time - scans[0].time + 0.1
    lap = long_drive._Lap(known, events, np.array(there_and_back), period)
    found = long_drive._Found(*(np.full(3 * len(scans), np.nan) for _ in range(2)))
    localizer = Localizer(known, at=rooms.START)

    for number in range(3):
        long_drive._drive(localizer, lap, number, found, PeriodicRelease())

    assert localizer.num_scans == localizer.num_located == 3 * len(scans)
    assert np.isfinite(found.processor).all()
    assert found.errors.max() < 0.1


def test_memory_of_this_process_is_known():
    memory = long_drive._memory_mb()

    assert math.isnan(memory) or memory > 10.0


def test_a_robot_says_that_it_is_in_another_building():
    soon = measures.Followed(num_located=2, unlocated_path=3.0)
    soon.states.update({"located": 2, "searching": 8})
    never = measures.Followed(unlocated_path=0.0)
    never.states.update({"searching": 10})
    late = measures.Followed(num_located=10, unlocated_path=25.0, longest_located_s=9.0)
    late.states.update({"located": 10})

    row = stranger_row({}, [soon, never, late])

    values = {name: figure.value for name, figure in row.figures.items()}
    assert values["says so within 20 m"] == pytest.approx(200.0 / 3.0)
    assert values["wrong"] == pytest.approx(40.0)
    assert values["longest located"] == 9.0


def test_claims_in_an_office_of_the_same_plan_are_judged():
    never = measures.Followed()
    right = measures.Followed(num_located=6)
    once = measures.Followed(num_located=4, num_wrong=3)
    for each, searching in ((never, 20), (right, 4), (once, 6)):
        each.states.update({"located": each.num_located, "searching": searching})

    row = same_plan_row({}, [never, right, once])

    values = {name: figure.value for name, figure in row.figures.items()}
    assert values["located where it is in the plan"] == pytest.approx(17.5)
    assert values["drives with a wrong claim"] == pytest.approx(100.0 / 3.0)
    assert values["wrong"] == pytest.approx(7.5)


def test_a_drive_is_moved_into_the_map_of_the_same_plan():
    tf_world_robot = Pose(3.0, 1.0, 0.5)
    mapped, driven = (
        Drive("", None, [], np.array([compose(tf, tf_world_robot)]), tf_map_world=tf)
        for tf in (Pose(1.0, -2.0, 0.3), Pose(-4.0, 0.5, -1.2))
    )

    moved = in_map_of(mapped, driven)

    assert moved.truth == pytest.approx(mapped.truth)


def test_rows_of_other_parts_are_kept(tmp_path):
    kept = Record("localisation", (Row({"what": "tracking"}, {"rmse": Figure(2.0, "cm")}),))
    path = tmp_path / "localisation.json"
    path.write_text(kept.to_json())
    nothing = ["localisation", "--only", "alike", "--seeds", "0", "-o", str(tmp_path)]

    assert run([*nothing, "--add"]) == 0
    assert [row.case for row in read_record(path).rows] == [{"what": "tracking"}]
    assert run(nothing) == 0
    assert read_record(path).rows == ()


def test_drives_that_leave_the_map_are_counted_apart():
    soon = measures.Followed(2.0, 1.0, processor=[0.01], whole_overlap=1.0)
    late = measures.Followed(9.0, 8.0, processor=[0.01], whole_overlap=12.0)
    left = measures.Followed(processor=[0.01], whole_overlap=2.0)
    for run_ in (soon, late, left):
        run_.states.update({"searching": 1})

    figures = driving_figures([soon, late, left], by_overlap=True)

    values = {name: figure.value for name, figure in figures.items()}
    assert values["located within 3 m"] == pytest.approx(100.0 / 3.0)
    assert values["drives with 3 m on the map"] == 1.0
    assert values["of these located within 3 m"] == 0.0
    assert values["drives with 10 m on the map"] == 1.0
    assert values["of these located within 10 m"] == pytest.approx(100.0)


def test_figures_of_what_never_happened_are_left_out():
    never = measures.Followed(processor=[0.01])
    never.states.update({"searching": 1})
    row = Row({"what": "driving"}, driving_figures([never], by_overlap=False))
    assert math.isnan(row.figures["rmse"].value)

    (reported,) = _reported(iter([row]), lambda line: None)

    assert "rmse" not in reported.figures
    assert reported.figures["located"].value == 0.0
    assert Record("localisation", (reported,)).to_json()
