# SPDX-License-Identifier: Apache-2.0
"""Visits that are displaced along corridors: found where many agree, not where chance has a few."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cartoloop.config import QualityConfig
from cartoloop.kernels.map_agreement import CellGrid
from cartoloop.quality.encounters import encounters
from cartoloop.quality.examine import examine
from cartoloop.quality.pairs import compared_pairs, path_lengths
from cartoloop.quality.slides import NEAR_KNOWN_M, agreeing, near_known, slides
from cartoloop.quality.verdict import Kind
from cartoloop.sensor.pose import compose_all
from cartoloop.sensor.scan_points import ScanPoints

CONFIG = QualityConfig()


def found(result):
    """Return the displacements along the path in a map."""
    scans = ScanPoints.of(list(result.node_points))
    paths = path_lengths(result.graph.node_poses)
    pairs = compared_pairs(result, scans, CONFIG, paths)
    met = encounters(pairs.take(pairs.path >= CONFIG.min_visit_path), paths, result, scans, CONFIG)
    return slides(met, result, scans, CONFIG, np.zeros(len(met), bool))


def second_round_moved(result, metres):
    """Return the map of a ring with its second round moved along two of the four corridors."""
    graph = result.graph.copy()
    nodes, submaps = graph.num_nodes // 2, graph.num_submaps // 2
    by = np.array((metres, 0.0, 0.0))
    graph.node_poses[nodes:] = compose_all(by, graph.node_poses[nodes:])
    graph.submap_poses[submaps:] = compose_all(by, graph.submap_poses[submaps:])
    return replace(result, graph=graph)


@pytest.mark.slow
def test_in_a_right_map_nothing_is_displaced(two_rounds_result):
    assert np.isnan(found(two_rounds_result)).all()


@pytest.mark.slow
@pytest.mark.parametrize("metres", [1.5, 3.0])
def test_displacements_along_corridors_are_measured(two_rounds_result, metres):
    displacements = found(second_round_moved(two_rounds_result, metres))

    same = displacements[np.isfinite(displacements)]
    assert len(same) >= 4
    assert np.median(same) == pytest.approx(metres, abs=0.2)


@pytest.mark.slow
def test_a_displaced_round_is_a_place(two_rounds_result):
    quality = examine(second_round_moved(two_rounds_result, 3.0), CONFIG)

    assert not quality.is_good
    reasons = [place.reason for place in quality.places if place.kind == Kind.CONTRADICTION]
    assert any("displaced along the path" in reason for reason in reasons)


def test_enough_must_agree():
    chance = np.array([0.4, 1.1, 2.0, 2.2, np.nan, 3.5, 4.1, np.nan])
    assert not agreeing(chance, 5.0, 0.05).any()
    assert not agreeing(np.full(5, np.nan), 5.0, 0.05).any()
    assert not agreeing(np.zeros(0), 5.0, 0.05).any()


def test_the_largest_set_wins():
    values = np.array([1.0, 3.0, np.nan, 1.2, 3.1, 3.2, 3.05, 1.1, 1.15, 3.15])
    assert np.flatnonzero(agreeing(values, 5.0, 0.05)).tolist() == [1, 4, 5, 6, 9]


def test_an_encounter_that_fits_here_is_not_displaced():
    values = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 2.0])
    assert not agreeing(values, 5.0, 0.05).any()


def test_many_that_scatter_are_chance():
    rng = np.random.default_rng(3)
    assert not agreeing(rng.uniform(0.3, 4.7, 60), 5.0, 0.05).any()


def test_returns_far_from_what_is_known_do_not_count():
    cells = np.zeros((40, 80), np.uint8)
    cells[:, :40] = 30  # up to x = 2 m; the rest was forgotten
    grid = CellGrid(cells, 0.025, 0.025, 0.05)
    beyond = NEAR_KNOWN_M + 0.05
    points = np.array([(1.0, 1.0), (1.99, 0.5), (2.3, 1.0), (2.0 + beyond, 1.0), (1.0, -beyond)])

    assert near_known(points, grid).tolist() == points[:3].tolist()
    assert len(near_known(points[:0], grid)) == 0
