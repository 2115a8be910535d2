# SPDX-License-Identifier: Apache-2.0
"""The verdict on maps of a simulated ring: right ones, and the same with a part displaced."""

from __future__ import annotations

import json
from dataclasses import asdict, replace

import numpy as np
import pytest

from cartoloop.config import QualityConfig
from cartoloop.quality.clusters import clusters
from cartoloop.quality.examine import examine
from cartoloop.quality.verdict import Kind, Place, Quality, Severity
from cartoloop.sensor.pose import compose_all

pytestmark = pytest.mark.slow


def displaced(result, metres):
    """Return a map whose second half is moved sideways, as after a wrong loop closure."""
    graph = result.graph.copy()
    nodes, submaps = graph.num_nodes // 2, graph.num_submaps // 2
    by = np.array((metres, metres, 0.0))
    graph.node_poses[nodes:] = compose_all(by, graph.node_poses[nodes:])
    graph.submap_poses[submaps:] = compose_all(by, graph.submap_poses[submaps:])
    return replace(result, graph=graph)


@pytest.fixture(scope="module")
def odometry(two_rounds_result):
    return two_rounds_result.report.extra["odometry"]


def test_a_right_map_is_good(two_rounds_result):
    quality = two_rounds_result.quality

    assert quality.verdict == "good"
    assert quality.is_good
    assert quality.summary() == "good"
    assert quality.figures["revisited_m"] > 100.0
    assert quality.figures["contradicted_share"] < 0.05
    assert quality.figures["confirmed_share"] > 0.7


@pytest.mark.parametrize("metres", [0.4, 0.8, 2.0])
def test_a_displaced_half_contradicts_the_other(two_rounds_result, odometry, metres):
    quality = examine(displaced(two_rounds_result, metres), QualityConfig(), odometry)

    assert not quality.is_good
    worst = quality.places[0]
    assert worst.kind == Kind.CONTRADICTION
    assert worst.severity in (
        (Severity.WRONG,) if metres < 1.0 else (Severity.DOUBTFUL, Severity.WRONG)
    )
    assert worst.from_stamp < worst.to_stamp
    assert "m" in worst.reason
    assert worst.advice
    if metres < 0.7:
        assert quality.figures["displacement_m"] == pytest.approx(np.hypot(metres, metres), abs=0.2)


def test_a_clock_that_jumps_leaves_a_map_good(two_rounds_result, odometry):
    result, at = two_rounds_result, 300
    stamps = result.stamps.copy()
    stamps[at:] += 3600.0
    jumped = replace(result, stamps=stamps)
    step = np.hypot(*np.diff(result.local_trajectory[at - 1 : at + 1, :2], axis=0)[0])
    turn = np.diff(result.local_trajectory[at - 1 : at + 1, 2])[0]
    pause = {"begin": stamps[at - 1], "end": stamps[at], "odometry_m": step, "odometry_rad": turn}

    without = examine(jumped, result.config.quality, odometry)
    by_odometry = examine(jumped, result.config.quality, odometry | {"pauses": [pause]})

    assert (without.verdict, by_odometry.verdict) == ("doubtful", "good")
    assert [p.severity for p in by_odometry.places if p.kind == Kind.GAP] == [Severity.MINOR]
    assert by_odometry.figures["gaps"] == without.figures["gaps"] == 1.0


def test_the_verdict_is_the_same_each_time(two_rounds_result, odometry):
    wrong = displaced(two_rounds_result, 0.8)

    assert examine(wrong, QualityConfig(), odometry) == examine(wrong, QualityConfig(), odometry)


def test_fewer_searches_find_the_same_places(two_rounds_result, odometry):
    wrong = displaced(two_rounds_result, 0.8)
    config = QualityConfig(max_searches=0)

    assert examine(wrong, config, odometry).verdict == "wrong"


def test_it_is_in_the_report_and_comes_back_with_the_map(two_rounds_result, tmp_path):
    from cartoloop import load_map

    two_rounds_result.save(tmp_path)

    saved = json.loads((tmp_path / "report.json").read_text())["quality"]
    assert saved["verdict"] == "good"
    assert load_map(tmp_path).quality == two_rounds_result.quality
    again = load_map(tmp_path).examined().quality
    assert again.verdict == "good"
    assert again.figures["contradicted_share"] == pytest.approx(
        two_rounds_result.quality.figures["contradicted_share"], abs=0.02
    )


def test_without_examination_nothing_is_claimed(two_rounds_result):
    quality = examine(two_rounds_result, QualityConfig(enabled=False), None)

    assert quality.verdict == "unknown"
    assert quality.places == ()


def test_quality_survives_json(two_rounds_result, odometry):
    quality = examine(displaced(two_rounds_result, 0.8), QualityConfig(), odometry)

    assert Quality.from_dict(json.loads(json.dumps(asdict(quality)))) == quality


def test_the_summary_names_the_worst_places():
    place = Place(1.0, 2.0, 3.0, 100.0, 200.0, Kind.GAP, Severity.DOUBTFUL, "a gap", "try again")
    minor = replace(place, severity=Severity.MINOR)
    quality = Quality("doubtful", (place, place, place, minor))

    assert quality.summary() == (
        "doubtful at x 1.0, y 2.0 (stamp 100.00): a gap; x 1.0, y 2.0 (stamp 100.00): a gap; "
        "and 1 more places"
    )
    assert Quality("good", (minor,)).summary() == "good"


def test_points_that_are_near_are_one_place():
    points = np.array([(0.0, 0.0), (3.0, 1.0), (30.0, 0.0), (6.0, 2.0)])

    assert [group.tolist() for group in clusters(points)] == [[0, 1, 3], [2]]
