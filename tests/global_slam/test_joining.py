# SPDX-License-Identifier: Apache-2.0
"""Which scans of parts that nothing connects are searched in each other, and how many."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from cartoloop.config import ConstraintSearchConfig
from cartoloop.global_slam.closure_search import FinishedSubmap
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.hypotheses import Candidate
from cartoloop.global_slam.join_evidence import GeometryCheck, Strictness
from cartoloop.global_slam.joining import MAX_FOLLOWED_SCANS, NUM_ROUNDS, Joining
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.global_slam.sessions import SessionRanges
from cartoloop.sensor.pose import Pose
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.submaps.finished_grid import FinishedGrid

POINTS = np.column_stack((np.arange(30.0), np.zeros(30)))


class Scans:
    """Composite scans, one at each node."""

    def __init__(self, count):
        self.nodes = np.arange(count)
        self.points = ScanPoints.of([POINTS] * count)

    def __len__(self):
        return len(self.nodes)


def two_parts(*counts, length=20):
    """Return the search between two parts of one submap each, and the graph; nothing fits.

    Parameters
    ----------
    counts : composite scans of each part.
    length : of the submaps along x [cells].
    """
    graph, sessions, submaps = PoseGraph(), SessionRanges(), []
    for part, count in enumerate(counts):
        sessions.begin(graph.num_nodes, part)
        graph.add_nodes([(4.0 * i, 0.0, 0.0) for i in range(count)])
        graph.add_submap((0.0, 0.0, 0.0))
        grid = FinishedGrid(np.full((20, length), 100, np.uint8), 0.0, 0.0, 0.05)
        submaps.append(FinishedSubmap(part, grid, 0.7))
    search = SimpleNamespace()
    joining = Joining(
        ConstraintSearchConfig(), Closures(), submaps, search, Scans(sum(counts)), sessions
    )
    return joining, graph


def fits(joining, scan, x, margin=0.2):
    """Note that a scan of the first part fits in the submap of the other, displaced by x."""
    node_x = 4.0 * scan
    candidate = Candidate(scan, scan, 1, np.array([node_x + x, 0.0, 0.0]), 0.6, 0.6 - margin)
    joining._matches.of_scan.setdefault(scan, []).append(candidate)


def rounds(joining, graph):
    """Return the number of searches after each round."""
    totals = []
    for number in range(NUM_ROUNDS):
        joining.request_round(number, graph)
        totals.append(joining.attempts[0, 1].num_searches)
    return totals


LONG = 2 * MAX_FOLLOWED_SCANS


def test_long_parts_are_sampled_where_nothing_agrees():
    joining, graph = two_parts(LONG, LONG)
    totals = rounds(joining, graph)
    assert totals[1] == totals[-1] == 2 * LONG // 4
    assert joining.attempts[0, 1].is_cut_short
    assert "a quarter of the scans was searched" in joining.attempts[0, 1].explanation


def test_long_parts_are_searched_whole_where_scans_agree():
    joining, graph = two_parts(LONG, LONG)
    for scan in (0, 4):
        fits(joining, scan, x=50.0)
    assert rounds(joining, graph)[-1] == 2 * LONG
    assert not joining.attempts[0, 1].is_cut_short


@pytest.mark.parametrize("turns", [2, 3])
def test_scans_that_disagree_do_not_count(turns):
    joining, graph = two_parts(LONG, LONG)
    for scan in range(turns):
        fits(joining, 4 * scan, x=50.0 + 20.0 * scan)
    assert rounds(joining, graph)[-1] == 2 * LONG // 4


def test_short_parts_are_searched_whole():
    joining, graph = two_parts(LONG, MAX_FOLLOWED_SCANS)
    assert rounds(joining, graph)[-1] == LONG + MAX_FOLLOWED_SCANS
    assert not joining.request_round(NUM_ROUNDS, graph)


def test_parts_that_agree_later_are_searched_then():
    joining, graph = two_parts(LONG, LONG)
    rounds(joining, graph)
    assert not joining.request_round(NUM_ROUNDS, graph)
    for scan in (0, 4):
        fits(joining, scan, x=50.0)
    assert joining.request_round(NUM_ROUNDS, graph)
    assert joining.attempts[0, 1].num_searches == 2 * LONG


@pytest.mark.parametrize(
    ("elsewhere", "strictness"), [(0, Strictness.NO_OTHER_PLACE), (1, Strictness.OTHER_PLACES)]
)
def test_scans_that_fit_elsewhere_make_it_stricter(elsewhere, strictness):
    joining, graph = two_parts(30, 30)
    joining.request_round(NUM_ROUNDS, graph)
    joining._has_news = True
    for scan in range(4 + elsewhere):
        fits(joining, scan, x=50.0 if scan < 4 else 90.0)
    assert joining.best(graph).strictness == strictness


def followed(*places):
    """Return two short parts after following: many scans fit in places, none is distinct."""
    joining, graph = two_parts(30, 30)
    joining.request_round(NUM_ROUNDS, graph)
    joining.follows = joining._has_news = True
    for number, (x, count) in enumerate(places):
        for scan in range(12 * number, 12 * number + count):
            fits(joining, scan, x, margin=0.025)
    return joining, graph


def check(fault="", floor_share=0.01):
    on_floor = round(4000 * floor_share)
    return GeometryCheck(40.0, 0.0, 4000 - on_floor, on_floor, fault)


def test_scans_that_are_not_distinct_are_examined_most_strictly():
    joining, graph = followed((50.0, 12))
    attempt = joining.best(graph)
    assert attempt.strictness == Strictness.FEW_DISTINCT
    assert attempt.is_ambiguous
    joining.leave_undecided(attempt, check())
    again = joining.best(graph)
    assert again is attempt
    assert not again.is_ambiguous


def test_nothing_is_believed_beside_a_place_that_was_refused():
    joining, graph = followed((50.0, 12), (200.0, 11))
    joining.refuse(joining.best(graph), check(fault="a wall contradicts it"))
    assert joining.best(graph) is None
    assert joining.attempts[0, 1].why_not == "a wall contradicts it"


@pytest.mark.parametrize(("floor_share", "is_right"), [(0.01, False), (0.02, True)])
def test_better_of_two_places_must_stand_out(floor_share, is_right):
    joining, graph = followed((50.0, 12), (200.0, 11))
    joining.leave_undecided(joining.best(graph), check())
    rival = joining.best(graph)
    assert rival.found.tf_one_other.x == pytest.approx(-200.0)
    joining.leave_undecided(rival, check(floor_share=floor_share))
    best = joining.best(graph)
    assert (best is not None) is is_right
    if is_right:
        assert best.found.tf_one_other.x == pytest.approx(-50.0)
        assert not best.is_ambiguous
    else:
        assert joining.attempts[0, 1].why_not


def test_only_distinct_scans_count_before_places_are_followed():
    joining, graph = followed((50.0, 12))
    joining.follows = False
    assert joining.best(graph) is None


def refused(*places):
    """Return two short parts: scans fit in the first of some places, and all were refused."""
    joining, graph = two_parts(12, 2, length=1200)
    joining.request_round(NUM_ROUNDS, graph)
    joining.follows = joining._has_news = True
    for scan in range(12):
        fits(joining, scan, places[0], margin=0.025)
    attempt = joining.best(graph)
    joining.refuse(attempt, check(fault="a wall contradicts it"))
    (examined,) = attempt.refused
    elsewhere = [examined._replace(tf_one_other=Pose(-x, 0.0, 0.0)) for x in places[1:]]
    attempt.refused += elsewhere
    return joining, graph, attempt, elsewhere


def test_refused_places_that_are_followed_are_open_again():
    joining, graph, attempt, _ = refused(2.0)
    assert joining.best(graph) is None
    assert joining.follow(graph)
    assert attempt.refused == []


def test_places_that_are_not_followed_stay_refused():
    joining, graph, attempt, elsewhere = refused(2.0, 300.0)
    assert joining.follow(graph)
    assert attempt.refused == elsewhere


def test_places_without_further_searches_stay_refused():
    joining, graph, attempt, _ = refused(2.0)
    assert joining.follow(graph)
    joining._has_news = True
    joining.refuse(joining.best(graph), check(fault="a wall contradicts it"))
    assert not joining.follow(graph)
    assert len(attempt.refused) == 1


def unsupported():
    """Return two short parts: half of the scans that should fit in a place do, none is distinct."""
    joining, graph = two_parts(26, 2, length=2600)
    joining.request_round(NUM_ROUNDS, graph)
    joining.follows = joining._has_news = True
    for scan in range(13):
        fits(joining, scan, 2.0, margin=0.025)
    return joining, graph


def test_places_without_support_are_examined_but_not_believed():
    joining, graph = unsupported()
    attempt = joining.best(graph)
    assert attempt.is_ambiguous
    joining.leave_undecided(attempt, check())
    assert joining.best(graph) is None
    assert attempt.why_not
    # More of the scans fit there now.
    for scan in range(13, 20):
        fits(joining, scan, 2.0, margin=0.001)
    joining._has_news = True
    assert joining.best(graph) is attempt
    assert not attempt.is_ambiguous


def test_place_behind_one_without_support_is_examined():
    joining, graph = unsupported()
    for scan in range(13, 26):
        fits(joining, scan, 300.0, margin=0.023)
    attempt = joining.best(graph)
    assert attempt.found.tf_one_other.x == pytest.approx(-2.0)
    joining.refuse(attempt, check(fault="scans contradict it", floor_share=0.4))
    again = joining.best(graph)
    assert again.found.tf_one_other.x == pytest.approx(-300.0)


def test_matches_within_a_part_are_given_back_once_joined():
    joining, graph = two_parts(4, 4)
    for scan in (1, 3):
        fits(joining, scan, 0.0)
    assert joining.drop_within_parts(graph) == []
    joining._sessions.join(1, 0)
    assert joining.drop_within_parts(graph) == [1, 3]
    assert joining.drop_within_parts(graph) == []
