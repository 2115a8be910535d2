# SPDX-License-Identifier: Apache-2.0
"""Visits measure their positions along the path against each other where the scans show it."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from cartoloop.quality.along_corridors import (
    are_here,
    are_supported,
    met_nodes,
    shifts_along,
)
from cartoloop.quality.encounters import Encounters, encounters
from cartoloop.quality.motion import Event
from cartoloop.quality.motion_places import gap_places
from cartoloop.quality.pairs import compared_pairs, path_lengths, scans_of
from cartoloop.quality.slides import slides
from cartoloop.quality.verdict import Severity
from cartoloop.quality.visit_offsets import (
    MIN_VISITS,
    displacement_by_scale,
    offset_places,
    visit_offsets,
)
from cartoloop.session import Session
from tests.quality.test_slides import CONFIG, second_round_moved


def met_of(result):
    """Return the encounters of a map, and the path lengths of its nodes."""
    paths = path_lengths(result.graph.node_poses)
    pairs = compared_pairs(result, scans_of(result), CONFIG, paths)
    is_apart = pairs.path >= CONFIG.min_visit_path
    return encounters(pairs.take(is_apart), paths, result, scans_of(result), CONFIG), paths


@pytest.fixture(scope="module")
def rounds(two_rounds_result):
    """Return a right map of two rounds, with its encounters and their shifts."""
    met, paths = met_of(two_rounds_result)
    return (
        two_rounds_result,
        met,
        paths,
        shifts_along(met, two_rounds_result, scans_of(two_rounds_result), paths),
    )


@pytest.mark.slow
def test_visits_of_a_right_map_are_measured_to_agree(rounds):
    _, _, _, shifts = rounds

    assert np.mean(np.isfinite(shifts[:, 0])) > 0.5
    assert are_here(shifts)[np.isfinite(shifts[:, 0])].all()


@pytest.mark.slow
def test_shifts_along_the_path_are_measured(two_rounds_result):
    moved = second_round_moved(two_rounds_result, 0.5)
    met, paths = met_of(moved)

    shifts = shifts_along(met, moved, scans_of(moved), paths)

    along_x = shifts[np.abs(shifts[:, 0]) > 0.3, 0]
    back = np.where(np.diff(met_nodes(met), axis=1)[:, 0] < 0, -1.0, 1.0)
    assert len(along_x) >= 4
    assert np.abs(along_x) == pytest.approx(0.5, abs=0.15)
    assert np.sign(along_x) == pytest.approx(back[np.abs(shifts[:, 0]) > 0.3])


@pytest.mark.slow
def test_a_shift_of_one_encounter_alone_is_none(two_rounds_result):
    moved = second_round_moved(two_rounds_result, 0.5)
    met, paths = met_of(moved)
    far_apart = 100.0 * np.arange(len(paths))

    shifts = shifts_along(met, moved, scans_of(moved), far_apart)

    assert not np.any(np.hypot(*shifts.T) > 0.3)


@pytest.mark.parametrize(
    ("others", "counts"),
    [([1.0], True), ([1.0, 0.0], True), ([1.0, 0.0, 0.0], False), ([0.0], False), ([], False)],
)
def test_shifts_are_not_outnumbered_by_others_nearby(others, counts):
    # The others meet there, seen from the other visit: the same shift is the opposite one.
    at = np.array(
        [(20.0, 150.0)] + [(149.0 - k, 21.0 + k) for k in range(len(others))] + [(90, 90)]
    )
    along = np.array([1.0] + [-shift for shift in others] + [0.0])
    shifts = np.column_stack((along, np.zeros(len(at))))

    assert are_supported(shifts, at)[0] == counts


@pytest.mark.slow
def test_what_fits_here_does_not_slide(two_rounds_result):
    moved = second_round_moved(two_rounds_result, 3.0)
    met, _ = met_of(moved)
    scans = scans_of(moved)

    assert np.isfinite(slides(met, moved, scans, CONFIG, np.zeros(len(met), bool))).any()
    assert np.isnan(slides(met, moved, scans, CONFIG, np.ones(len(met), bool))).all()


@pytest.mark.slow
def test_a_right_map_has_no_places_of_offsets(rounds):
    result, met, paths, shifts = rounds
    none = np.zeros((len(paths), 2))

    assert offset_places(met, visit_offsets(met, shifts, none, paths), result) == []


@pytest.mark.slow
@pytest.mark.parametrize(("metres", "is_doubtful"), [(0.2, False), (0.6, True)])
def test_expected_offsets_are_doubtful(rounds, metres, is_doubtful):
    result, met, paths, shifts = rounds
    displaced = np.zeros((len(paths), 2))
    displaced[len(paths) // 2 :, 0] = metres
    unknown = np.full_like(shifts, np.nan)

    places = offset_places(met, visit_offsets(met, unknown, displaced, paths), result)

    assert bool(places) == is_doubtful
    assert all(f"{metres:.1f} m" in place.reason for place in places)


@pytest.mark.slow
def test_what_is_measured_corrects_what_is_expected(rounds):
    result, met, paths, shifts = rounds
    displaced = np.zeros((len(paths), 2))
    displaced[len(paths) // 2 :, 0] = 0.6

    assert offset_places(met, visit_offsets(met, shifts, displaced, paths), result) == []


def test_few_visits_have_no_offsets():
    few = range(MIN_VISITS - 1)

    assert offset_places(few, np.ones((len(few), 2)), None) == []


ONE_SESSION = (Session(),)


def run_of(places, sessions=ONE_SESSION):
    """Return a run with a node each second."""
    graph = SimpleNamespace(node_poses=np.column_stack((places, np.zeros(len(places)))))
    rows = np.arange(len(places))
    return SimpleNamespace(
        graph=graph, stamps=rows.astype(float), node_scan_index=rows, sessions=sessions
    )


def along_x(x):
    return np.stack((x, np.zeros(len(x))), -1)


SCALES = [{"begin": 0.0, "translation_scale": 1.0}, {"begin": 10.0, "translation_scale": 0.95}]
ODOMETRY = {"translation_scale": 0.94, "scales": SCALES}


def test_a_corridor_is_displaced_by_the_scale_not_known_yet():
    run = run_of(along_x(np.arange(101.0)))
    everywhere = np.ones(101, bool)

    displaced = displacement_by_scale(run, everywhere, ODOMETRY)

    expected = 10.0 * (1.0 / 0.94 - 1.0) + 90.0 * (0.95 / 0.94 - 1.0)
    assert displaced[-1] == pytest.approx((expected, 0.0))
    assert not displacement_by_scale(run, ~everywhere, ODOMETRY).any()
    assert not displacement_by_scale(run, everywhere, None).any()
    assert not displacement_by_scale(run, everywhere, {"translation_scale": 0.94}).any()


def test_the_way_back_by_the_same_scale_displaces_no_more():
    there_and_back = np.concatenate((np.arange(5.0), np.arange(5.0, -1.0, -1.0)))
    run = run_of(along_x(there_and_back))

    displaced = displacement_by_scale(run, np.ones(11, bool), ODOMETRY)

    assert np.abs(displaced).max() == pytest.approx(5.0 * (1.0 / 0.94 - 1.0))
    assert displaced[-1] == pytest.approx((0.0, 0.0), abs=1e-9)


def test_between_sessions_nothing_is_displaced():
    places = along_x(np.concatenate((np.zeros(5), np.full(5, 80.0))))
    sessions = (Session(), Session(first_node=5, first_scan=5))

    run = run_of(places, sessions)

    assert not displacement_by_scale(run, np.ones(10, bool), ODOMETRY).any()


def moved_before(result, middle, moved):
    """Return the graph of a map whose closures moved what is before a node back [m]."""
    graph = deepcopy(result.graph)
    step = graph.node_poses[middle, :2] - graph.node_poses[middle - 1, :2]
    graph.node_poses[:middle, :2] -= moved * step / np.hypot(*step)
    return graph


@pytest.mark.slow
@pytest.mark.parametrize(
    ("expected", "measured", "moved", "severity"),
    [
        (3.0, True, 2.5, Severity.MINOR),
        (9.0, True, 8.0, Severity.MINOR),
        (3.0, False, 2.5, Severity.DOUBTFUL),
        (3.0, True, 0.5, Severity.DOUBTFUL),
        (9.0, True, 4.0, Severity.DOUBTFUL),
        (12.0, True, 11.0, Severity.DOUBTFUL),
    ],
)
def test_a_gap_that_visits_made_up_for_is_minor(rounds, expected, measured, moved, severity):
    result, met, paths, shifts = rounds
    middle = int(np.searchsorted(paths, 0.5 * paths[-1]))
    event = Event(int(result.node_scan_index[middle]), 5.0, 0.5, expected)
    known = shifts if measured else np.full_like(shifts, np.nan)
    graph = moved_before(result, middle, moved)

    (place,) = gap_places([event], met, known, replace(result, graph=graph))

    assert place.severity is severity


@pytest.mark.slow
def test_a_gap_is_not_made_up_for_by_a_few_visits(rounds):
    result, met, paths, shifts = rounds
    middle = int(np.searchsorted(paths, 0.5 * paths[-1]))
    event = Event(int(result.node_scan_index[middle]), 5.0, 0.5, 3.0)
    moved = replace(result, graph=moved_before(result, middle, 2.5))
    far = np.hypot(*(met_places(met, result) - result.trajectory[event.scan, :2]).T) > 6.0
    rows = np.flatnonzero(far & are_here(shifts))[:3]
    few = Encounters(met.first[rows], met.end[rows], met.pairs, *columns(met, rows))

    [place] = gap_places([event], few, shifts[rows], moved)

    assert few.length.sum() > 5.0
    assert place.severity is Severity.DOUBTFUL


def columns(met, rows):
    """Return the rest of what is known of some encounters."""
    return [
        column[rows]
        for column in (met.length, met.contradiction, met.displacement, met.contradicts)
    ]


def met_places(met, result):
    """Return the places of the first nodes of encounters."""
    return result.graph.node_poses[met.pairs.node[met.first], :2]
