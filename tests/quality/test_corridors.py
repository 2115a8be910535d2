# SPDX-License-Identifier: Apache-2.0
"""Corridors: what scans measure along them, what nothing measures, and what contradicts it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from cartoloop.config import QualityConfig
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.quality.corridor_places import (
    DISPLACED_GAIN,
    NodeVisits,
    corridor_places,
    measured_by_odometry,
)
from cartoloop.quality.corridors import (
    MAX_RADIUS_M,
    MIN_RADIUS_M,
    Corridors,
    corridors,
    gain_elsewhere,
    path_bend,
)
from cartoloop.quality.motion import standing
from cartoloop.quality.motion_places import STANDS_CHANGED_CORRIDOR, standing_places
from cartoloop.quality.odometry_use import without_odometry

STEP_M, SECONDS = 0.2, 0.2
GOOD = {"translation_error_m": 0.002, "metre_noise_m": 0.005, "measured_metres": 100, "faults": []}
ALWAYS = {"begin": 0.0, "end": None, "kind": "stands still"}
FROZEN = {**GOOD, "faults": [ALWAYS | {"begin": 120.0}]}


@dataclass
class Run:
    """Nodes on a line, each with the returns that it sees."""

    positions: np.ndarray
    node_points: list = field(default_factory=list)
    seconds: float = SECONDS

    @property
    def stamps(self):
        return 100.0 + self.seconds * np.arange(len(self.positions))

    @property
    def trajectory(self):
        return np.column_stack((self.positions, np.zeros((len(self.positions), 2))))

    @property
    def node_scan_index(self):
        return np.arange(len(self.positions))

    @property
    def graph(self):
        graph = PoseGraph()
        graph.add_nodes(self.trajectory)
        return graph


def seen_from(x, *, niches):
    """Return the returns of two walls 2 m apart, with or without niches, seen from a position."""
    bearings = np.radians(np.arange(-89.5, 90.0))
    points = []
    for bearing in np.concatenate((bearings, bearings + np.pi)).tolist():
        for depth in (0.0, 0.3):
            ahead = (1.0 + depth) / abs(np.sin(bearing)) * np.cos(bearing)
            is_niche = niches and (x + ahead) % 3.0 < 0.8
            if abs(ahead) < 10.0 and (not is_niche or depth > 0.0):
                points.append((ahead, (1.0 + depth) * np.sign(np.sin(bearing))))
                break
    return np.array(points)


def run_along(true, positions=None, *, niches=True, seconds=SECONDS):
    """Return a run past some true positions, whose poses may be others."""
    points = [seen_from(x, niches=niches) for x in true.tolist()]
    return Run(true if positions is None else positions, points, seconds)


@pytest.mark.parametrize("x", [0.0, 0.7, 1.4, 2.1])
def test_a_step_past_niches_is_measured(x):
    assert gain_elsewhere(run_along(np.array((x, x + STEP_M))), 0) < -10.0


@pytest.mark.parametrize("x", [0.0, 0.7, 1.4, 2.1])
def test_a_step_that_is_too_short_is_contradicted_by_niches(x):
    run = run_along(np.array((x, x + 0.7)), np.array((0.0, STEP_M)))

    assert gain_elsewhere(run, 0) > 20.0


def test_between_bare_walls_no_step_is_measured():
    run = run_along(np.array((0.0, STEP_M)), niches=False)

    assert abs(gain_elsewhere(run, 0)) < 1.0


def test_scans_of_few_returns_are_not_compared():
    run = run_along(np.array((0.0, STEP_M)))
    run.node_points[1] = run.node_points[1][:10]

    assert np.isnan(gain_elsewhere(run, 0))


@pytest.mark.parametrize("niches", [True, False])
def test_corridors_are_compared_where_a_node_follows(niches):
    halls = corridors(run_along(STEP_M * np.arange(40), niches=niches), 10.0, None)

    assert halls.is_corridor.all()
    assert np.isfinite(halls.gains).sum() == np.count_nonzero(halls.nodes < 39)
    assert (halls.gains[:-1] < -5.0).all() == niches


def with_people(points, at):
    """Return returns with those of narrow objects, 0.4 m wide, before what is behind them."""
    bearings = np.arctan2(points[:, 1], points[:, 0])
    points = points.copy()
    for x, y in at:
        apart = np.abs(np.angle(np.exp(1j * (bearings - np.arctan2(y, x)))))
        hidden = (apart < 0.2 / np.hypot(x, y)) & (np.hypot(*points.T) > np.hypot(x, y) + 0.3)
        seen = bearings[hidden, np.newaxis]
        points[hidden] = np.hypot(x, y) * np.hstack((np.cos(seen), np.sin(seen)))
    return points


def crowded(count=40):
    """Return a run between bare walls among many people."""
    at = [(1.2, 0.3), (2.0, -0.4), (3.0, 0.2), (-1.3, 0.3), (-2.1, -0.4), (-3.0, 0.3)]
    run = run_along(STEP_M * np.arange(count), niches=False)
    run.node_points = [with_people(points, at) for points in run.node_points]
    return run


def test_people_do_not_hide_a_corridor():
    halls = corridors(crowded(), 5.0, None)

    assert halls.is_corridor.all()
    assert not corridors(crowded(), 5.0, GOOD).is_corridor.any()
    assert corridors(crowded(), 5.0, FROZEN | {"faults": [ALWAYS]}).is_corridor.all()


@pytest.mark.parametrize("sigma", [0.0, 0.04])
def test_noise_hides_no_length_that_odometry_measures(sigma):
    run, rng = run_along(STEP_M * np.arange(40), niches=False), np.random.default_rng(5)
    run.node_points = [
        points
        * (1.0 + rng.normal(0.0, sigma, (len(points), 1)) / np.hypot(*points.T)[:, np.newaxis])
        for points in run.node_points
    ]

    halls = corridors(run, 10.0, GOOD)

    assert halls.is_corridor.all() == (sigma == 0.0)
    assert halls.is_by_chords.all()
    assert np.count_nonzero(measured_by_odometry(halls, GOOD, run)) >= 38


def test_steps_are_compared_where_there_is_no_odometry():
    run = run_along(STEP_M * np.arange(200), niches=False)
    is_frozen = run.stamps[corridors(run, 5.0, GOOD).nodes] >= FROZEN["faults"][0]["begin"]

    assert np.isnan(corridors(run, 5.0, GOOD).gains).all()
    assert np.isfinite(corridors(run, 5.0, FROZEN).gains[is_frozen][:-1]).all()
    assert np.isnan(corridors(run, 5.0, FROZEN).gains[:10]).all()


RADIUS_M = 15.0


class RoundRun(Run):
    """Nodes on a circle around the origin, at some angles."""

    @property
    def trajectory(self):
        angles = self.positions
        places = RADIUS_M * np.column_stack((np.cos(angles), np.sin(angles)))
        return np.column_stack((places, angles + 0.5 * np.pi))


def seen_on_circle(angle, *, niches):
    """Return what is seen between round walls 2 m apart, with or without niches in the outer."""
    points = []
    for bearing in np.radians(np.arange(0.5, 360.0, 1.0)).tolist():
        # Frame of the robot: the centre is to its left.
        ray = np.array((np.cos(bearing), np.sin(bearing)))
        towards = RADIUS_M * ray[1]
        for radius, far in ((RADIUS_M - 1.0, -1.0), (RADIUS_M + 1.0, 1.0), (RADIUS_M + 1.3, 1.0)):
            square = towards**2 - RADIUS_M**2 + radius**2
            if square < 0.0 or (far < 0.0 and towards < 0.0):
                continue
            point = (towards + far * np.sqrt(square)) * ray
            place = angle + np.arctan2(point[0], RADIUS_M - point[1])
            if radius == RADIUS_M + 1.0 and niches and (RADIUS_M * place) % 3.0 < 0.8:
                continue
            points.append(point)
            break
    return np.array(points)


def round_run(true, positions=None, *, niches):
    """Return a run past some true angles, whose poses may be at others."""
    points = [seen_on_circle(angle, niches=niches) for angle in true.tolist()]
    return RoundRun(true if positions is None else positions, points)


def steps(count, length=STEP_M):
    return length / RADIUS_M * np.arange(count)


@pytest.mark.parametrize("length", [STEP_M, -STEP_M])
def test_a_step_in_a_round_corridor_is_not_measured(length):
    run = round_run(steps(40, length), niches=False)

    assert abs(gain_elsewhere(run, 20)) < 1.0


def test_a_step_past_niches_of_a_round_corridor_is_measured():
    run = round_run(steps(40), niches=True)

    assert all(gain_elsewhere(run, node) < -10.0 for node in range(10, 30, 4))


def test_a_wrong_step_in_a_round_corridor_is_contradicted():
    run = round_run(steps(40, 0.7), steps(40), niches=True)

    assert np.median([gain_elsewhere(run, node) for node in range(10, 30, 4)]) > 20.0


@pytest.mark.parametrize("heading", [0.0, 2.0])
@pytest.mark.parametrize("turn", [1.0, -1.0])
def test_the_bend_of_an_arc_is_found_whatever_faces_ahead(turn, heading):
    trajectory = RoundRun(turn * steps(40)).trajectory
    trajectory[:, 2] += heading

    bend = path_bend(trajectory, 20)

    # The path goes ahead, or back, along the tangent.
    ahead = turn * np.array((np.cos(heading), -np.sin(heading)))
    assert bend[:2] == pytest.approx(ahead, abs=0.02)
    assert bend.theta == pytest.approx(turn / RADIUS_M, rel=0.01)


@pytest.mark.parametrize("radius", [0.5 * MIN_RADIUS_M, 2.0 * MAX_RADIUS_M])
def test_corners_and_lines_are_no_bends(radius):
    angles = STEP_M / radius * np.arange(40)
    places = radius * np.column_stack((np.cos(angles), np.sin(angles)))

    assert path_bend(np.column_stack((places, angles)), 20) is None


def test_a_path_back_and_forth_is_no_bend():
    angles = steps(40)
    there_and_back = RoundRun(np.concatenate((angles[:20], angles[20::-1])))

    assert path_bend(there_and_back.trajectory, 5) is not None
    assert path_bend(there_and_back.trajectory, 20) is None


def hall(gain, count=300):
    """Return a corridor of a node every 0.2 m, with one gain, and its run without returns."""
    nodes = np.arange(0, count, 3)
    run = Run(STEP_M * np.arange(count))
    alike = np.ones(len(nodes), bool)
    return Corridors(nodes, alike, alike, np.full(len(nodes), gain)), run


def places_of(halls, odometry, run, *, visited=True, displaced=0.0, here=False):
    """Return the places of corridors, displaced by so much at the last node [m]."""
    count = len(run.graph.node_poses)
    by = displaced * np.column_stack((np.linspace(0.0, 1.0, count), np.zeros(count)))
    visits = NodeVisits(np.full(count, visited), np.full(count, here), by)
    return corridor_places(halls, odometry, visits, run, QualityConfig())


@pytest.mark.parametrize(
    ("visited", "displaced", "is_doubtful"),
    [(False, 0.2, False), (False, 0.7, True), (True, 0.7, False)],
)
def test_a_displaced_corridor_is_doubtful_if_seen_once(visited, displaced, is_doubtful):
    halls, run = hall(-5.0)

    places = places_of(halls, GOOD, run, visited=visited, displaced=displaced)

    assert len(places) == int(is_doubtful)


SLIPPED = {
    "begin": 20.0,
    "end": 25.0,
    "matched_m": 0.5,
    "odometry_m": 1.2,
    "matched_rad": 0.3,
    "odometry_rad": 0.3,
}


@pytest.mark.parametrize(
    ("fault", "is_doubtful"),
    [
        ({}, True),
        ({"end": None}, False),
        ({"odometry_m": 0.55}, False),
        ({"odometry_m": 0.1}, True),
    ],
)
def test_where_wheels_slipped_bare_walls_are_doubtful(fault, is_doubtful):
    halls, run = hall(0.1)

    places = places_of(halls, GOOD | {"faults": [SLIPPED | fault]}, run)

    assert any("seen to slip" in place.reason for place in places) == is_doubtful


def test_a_slip_on_a_long_path_hides_no_other():
    halls, run = hall(0.1)
    halls.gains[30:] = -5.0
    slipped = GOOD | {"faults": [SLIPPED]}
    measured = Run(STEP_M * np.arange(8000))

    assert places_of(halls, slipped, run)
    assert places_of(halls, slipped, run, here=True) == []
    assert places_of(halls, slipped, measured) == []


def test_wheels_that_slipped_are_compared_with_scans():
    run = run_along(STEP_M * np.arange(40), niches=False)

    assert np.isnan(corridors(run, 10.0, GOOD).gains).all()
    assert np.isfinite(corridors(run, 10.0, GOOD | {"faults": [SLIPPED]}).gains[:-1]).any()


@pytest.mark.parametrize(
    ("gain", "odometry", "is_doubtful"),
    [
        (-5.0, None, False),
        (0.1, None, True),
        (-5.0, GOOD, False),
        (0.1, GOOD, False),
        (-5.0, FROZEN, False),
        (0.1, FROZEN, True),
    ],
)
def test_a_length_that_nothing_measures_is_doubtful(gain, odometry, is_doubtful):
    halls, run = hall(gain)

    places = places_of(halls, odometry, run)

    assert len(places) == int(is_doubtful)
    assert all("nothing measures" in place.reason for place in places)


@pytest.mark.parametrize(
    ("share", "odometry", "is_doubtful"),
    [(0.02, None, False), (0.2, None, True), (0.2, GOOD, False), (0.2, FROZEN, True)],
)
def test_steps_that_fit_better_elsewhere_are_doubtful(share, odometry, is_doubtful):
    halls, run = hall(-50.0)
    halls.gains[:: round(1.0 / share)] = DISPLACED_GAIN + 1.0

    places = places_of(halls, odometry, run)

    assert any("another distance" in place.reason for place in places) == is_doubtful


@pytest.mark.parametrize(
    ("niches", "odometry", "is_doubtful"),
    [(False, None, True), (True, None, False), (False, GOOD, False)],
)
def test_a_pose_that_stands_between_bare_walls_is_doubtful(niches, odometry, is_doubtful):
    run = run_along(np.zeros(4), niches=niches, seconds=5.0)
    halls = corridors(run, 10.0, None)

    assert len(standing_places(standing(run), halls, odometry, run)) == int(is_doubtful)


@pytest.mark.parametrize(("odometry", "is_doubtful"), [(None, True), (GOOD, False), (FROZEN, True)])
def test_people_may_pass_a_robot_whose_odometry_stands(odometry, is_doubtful):
    run = run_along(np.zeros(6), niches=True, seconds=5.0)
    halls = corridors(run, 10.0, None)
    crowd = [each._replace(changed=1.5 * STANDS_CHANGED_CORRIDOR) for each in standing(run)]

    assert crowd
    assert len(standing_places(crowd, halls, odometry, run)) == int(is_doubtful)


def test_odometry_that_stands_still_counts_as_none():
    fault = {"begin": 110.0, "end": 120.0, "kind": "stands still"}
    stamps = np.array((100.0, 107.0, 115.0, 121.0))

    without = without_odometry(stamps, {**GOOD, "faults": [fault]})

    assert without.tolist() == [False, True, True, False]
    assert without_odometry(stamps, None).all()
