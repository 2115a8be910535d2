# SPDX-License-Identifier: Apache-2.0
"""A building that is driven through again: the old map gives way to the new drive."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop import Mapper
from cartoloop.config import Config, LifelongConfig
from cartoloop.evaluation.trajectories import align
from cartoloop.map_file.write import map_bytes
from cartoloop.result import load_map
from cartoloop.sensor.events import LaserScan
from cartoloop.sensor.pose import transform_points
from cartoloop.session import MAIN_PART
from cartoloop.simulation import make_world, simulate
from tests.conftest import mapped

LIFELONG = Config(lifelong=LifelongConfig(enabled=True))


def onto(result, events, config=LIFELONG):
    mapper = Mapper(config, onto=result)
    for event in events:
        mapper.add(event)
    return mapper.finish()


@pytest.fixture(scope="module")
def drive():
    return simulate(make_world("ring"), seed=1, duration=120.0)


@pytest.fixture(scope="module")
def rounds(drive):
    """The events of the first 90 s, and of a drive the same way from 40 s on."""
    start, events = float(drive.stamps[0]), list(drive.events())
    first = [event for event in events if event.stamp <= start + 90.0]
    return first, [event for event in events if event.stamp > start + 40.0]


@pytest.fixture(scope="module")
def first(rounds):
    return mapped(rounds[0])


@pytest.fixture(scope="module")
def refreshed(first, rounds):
    return onto(first, rounds[1])


def test_the_old_round_gives_way_to_the_new(first, refreshed):
    removed = refreshed.report.extra["lifelong"]
    assert removed["removed_submaps"] >= 0.5 * first.graph.num_submaps
    assert all(session.part == MAIN_PART for session in refreshed.sessions)
    assert removed["removed_nodes"] > 0
    assert refreshed.report.input.scans == len(refreshed.stamps)


def test_the_new_round_is_there_as_a_whole(refreshed, rounds):
    stamps = [event.stamp for event in rounds[1] if isinstance(event, LaserScan)]
    assert np.isin(stamps, refreshed.stamps).all()


def mean_error(result, simulated):
    """Mean distance of the scans from the truth [m], the map as a rigid whole."""
    truth = simulated.true_poses[np.searchsorted(simulated.stamps, result.stamps - 1e-6), :2]
    places = result.trajectory[:, :2]
    return np.hypot(*(transform_points(align(places, truth), places) - truth).T).mean()


def test_a_refreshed_map_is_true_to_a_pixel(refreshed, drive):
    assert mean_error(refreshed, drive) < 0.05
    assert refreshed.quality.verdict == "good"


def test_mapping_goes_on_from_a_refreshed_map(refreshed, rounds, tmp_path):
    refreshed.save(tmp_path / "map")
    again = onto(load_map(tmp_path / "map"), rounds[0])
    assert all(session.part == MAIN_PART for session in again.sessions)
    assert again.graph.num_nodes < 1.3 * refreshed.graph.num_nodes


def test_the_same_drives_yield_the_same_bytes(first, refreshed, rounds):
    assert map_bytes(onto(first, rounds[1])) == map_bytes(refreshed)


def test_without_the_option_everything_is_kept(first, rounds):
    kept = onto(first, rounds[1][: len(rounds[1]) // 8], Config())
    assert "lifelong" not in kept.report.extra
    assert kept.graph.num_submaps > first.graph.num_submaps
