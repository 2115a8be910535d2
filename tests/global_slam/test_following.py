# SPDX-License-Identifier: Apache-2.0
"""Places where a scan of one part fits in another are followed along its path."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop.config import WideSearchConfig
from cartoloop.global_slam.claims import Claim
from cartoloop.global_slam.closure_search import FinishedSubmap
from cartoloop.global_slam.following import (
    MASK_STRIDE,
    MAX_PLACES,
    Expected,
    SeenAreas,
    expected_scans,
    followed_places,
    why_not_supported,
)
from cartoloop.global_slam.hypotheses import Candidate
from cartoloop.global_slam.placing import Placement
from cartoloop.sensor.pose import Pose, compose
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.submaps.finished_grid import FinishedGrid

WIDE, MARGIN = WideSearchConfig(), 0.03
PLACE = Pose(3.0, -2.0, 1.0)


def claim(scan, place, evidence=0.1):
    tf_other_scan = Pose(4.0 * scan, 0.0, 0.0)
    candidate = Candidate(scan, scan, 0, np.zeros(3), 0.5, 0.5 - evidence)
    tf_one_scan = compose(place, tf_other_scan)
    return Claim(candidate, np.array(tf_one_scan), np.array(tf_other_scan), evidence)


def placed(count):
    claims = tuple(claim(scan, PLACE) for scan in range(count))
    return Placement(claims, PLACE, 0.1 * count, 4.0 * count, 0.0)


def expected(scan, share=0.8):
    return Expected(scan, 0, np.array([1.0, 2.0, 0.5]), share)


def match(scan, x=1.0, margin=0.1):
    return Candidate(scan, scan, 0, np.array([x, 2.0, 0.5]), 0.4, 0.4 - margin)


def supported(count, others, candidates):
    found = why_not_supported(placed(count), others, candidates, MARGIN, WIDE)
    return found == ""


def submap(seen_cols):
    """Return a submap of 10 x 10 m that has seen what lies left of a column."""
    cells = np.zeros((200, 200), np.uint8)
    cells[:, :seen_cols] = 100
    return FinishedSubmap(0, FinishedGrid(cells, 0.0, 0.0, 0.05), 0.7)


def test_each_place_is_followed_once():
    elsewhere = Pose(30.0, 5.0, -2.0)
    claims = [claim(0, PLACE, 0.05), claim(1, PLACE, 0.2), claim(2, elsewhere)]
    places = followed_places(claims, WIDE)
    assert places == [pytest.approx(PLACE), pytest.approx(elsewhere)]


def test_claims_that_agree_give_the_place_together():
    claims = []
    for scan, turn in enumerate((0.015, -0.015, 0.015, -0.015)):
        exact = claim(scan, PLACE, 0.1 + 0.01 * scan)
        claims.append(exact._replace(tf_one_scan=exact.tf_one_scan + np.array((0.0, 0.0, turn))))
    assert claims[-1].tf_one_other.theta == pytest.approx(PLACE.theta - 0.015)
    (place,) = followed_places(claims, WIDE)
    assert place.theta == pytest.approx(PLACE.theta, abs=0.003)
    assert compose(place, Pose(6.0, 0.0, 0.0))[:2] == pytest.approx(
        compose(PLACE, Pose(6.0, 0.0, 0.0))[:2], abs=0.01
    )


def test_only_the_likeliest_places_are_followed():
    claims = [claim(0, Pose(10.0 * i, 0.0, 0.0), 0.01 * (i + 1)) for i in range(40)]
    places = followed_places(claims, WIDE)
    assert [place.x for place in places] == pytest.approx([10.0 * i for i in range(39, 15, -1)])
    assert len(places) == MAX_PLACES


def test_place_is_supported_where_all_fit():
    others = [expected(10), expected(11)]
    assert supported(4, others, {10: [match(10)], 11: [match(11)]})


def test_place_is_not_supported_by_few():
    assert not supported(3, [], {})


def test_scans_that_do_not_fit_count_against_a_place():
    assert supported(4, [expected(10), expected(11)], {})
    assert not supported(4, [expected(10), expected(11), expected(12)], {})


def test_scans_that_fit_elsewhere_count_against_a_place():
    others = [expected(10), expected(11), expected(12)]
    away = {scan: [match(scan, x=3.0)] for scan in (10, 11, 12)}
    assert not supported(4, others, away)


def test_scans_that_fit_in_many_places_do_not_count():
    others = [expected(scan) for scan in range(10, 20)]
    assert supported(4, others, {scan: [match(scan, 3.0, 0.01)] for scan in range(10, 20)})


def test_scans_that_see_other_places_do_not_count():
    assert supported(4, [expected(scan, 0.4) for scan in range(10, 20)], {})


def test_scans_are_expected_where_the_other_part_has_seen():
    submaps = [submap(200), submap(60)]
    points = ScanPoints.of([np.array([(0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (4.0, 0.0)])] * 2)
    found = expected_scans(
        Pose(4.0, 5.0, 0.0),
        (np.array([0, 1]), np.array([(0.0, 0.0, 0.0), (50.0, 0.0, 0.0)]), points),
        np.array([1, 1]),
        (np.array([0, 0]), np.zeros((2, 3))),
        SeenAreas(submaps),
    )
    (only,) = found
    assert (only.scan, only.submap, only.share) == (0, 0, 1.0)
    assert only.tf_submap_scan == pytest.approx((4.0, 5.0, 0.0))


def naive_share(grid, points, pose):
    """The share of points that lie in cells of a coarse grid that were observed."""
    mask = grid.cells[::MASK_STRIDE, ::MASK_STRIDE] > 0
    step, seen = MASK_STRIDE * grid.resolution, 0
    for x, y in points:
        there = compose(Pose(*pose), Pose(x, y, 0.0))
        col, row = round((there.x - grid.origin_x) / step), round((there.y - grid.origin_y) / step)
        if 0 <= row < mask.shape[0] and 0 <= col < mask.shape[1]:
            seen += bool(mask[row, col])
    return seen / max(len(points), 1)


def test_what_a_submap_has_seen_of_scans_is_counted():
    rng = np.random.default_rng(4)
    cells = rng.integers(0, 2, (90, 120), dtype=np.uint8)
    grid = FinishedGrid(cells, -1.0, -2.0, 0.05)
    scans = [rng.uniform(-2.0, 4.0, (count, 2)) for count in (40, 0, 7, 90)]
    poses = rng.uniform(-2.0, 2.0, (4, 3))
    batch = ScanPoints.of([*scans, *scans]).take(np.array([4, 1, 2, 7]))

    shares = SeenAreas([FinishedSubmap(0, grid, 0.7)]).shares(0, batch, poses)

    expected = [naive_share(grid, *each) for each in zip(scans, poses.tolist(), strict=True)]
    assert shares.tolist() == pytest.approx(expected)
    assert 0.1 < shares[3] < 0.9


def test_scans_of_the_first_part_are_placed_in_the_second():
    (found,) = expected_scans(
        Pose(4.0, 5.0, 0.0),
        (np.array([0]), np.array([(7.0, 8.0, 0.0)]), ScanPoints.of([np.zeros((3, 2))])),
        np.array([0]),
        (np.array([-1, 1]), np.zeros((2, 3))),
        SeenAreas([submap(200), submap(200)]),
    )
    assert found.submap == 1
    assert found.tf_submap_scan == pytest.approx((3.0, 3.0, 0.0))
