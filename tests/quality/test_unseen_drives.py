# SPDX-License-Identifier: Apache-2.0
"""Gaps across which the robot drove far."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop.quality.encounters import Encounters
from cartoloop.quality.pairs import Pairs
from cartoloop.quality.unseen_drives import UNSEEN_M, unseen_drives, unseen_places
from cartoloop.quality.verdict import Severity
from tests.quality.gap_run import drive


def far_drive(**changes):
    """Return a run at 1 m/s without a minute and 30 m in the middle."""
    return drive(**{"gap": 60.0, "moved": 30.0, "half": 100} | changes)


def visits(*pairs, contradict=False):
    """Return encounters of 4 m, each of a node with what another one saw."""
    nodes, own = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    count = len(nodes)
    compared = Pairs(
        np.zeros(count, np.int64), nodes, own, np.zeros((count, 3)), np.full(count, 90.0),
        np.zeros(count), np.full(count, 50), np.zeros(count, np.int64),
    )  # fmt: skip
    first = np.arange(count)
    return Encounters(
        first, first + 1, compared, np.full(count, 4.0), np.zeros(count),
        np.full(count, np.nan), np.full(count, contradict),
    )  # fmt: skip


def test_a_long_drive_that_no_scan_has_seen_is_doubtful():
    run = far_drive()
    [event] = unseen_drives(run)
    assert (event.scan, event.moved) == (100, pytest.approx(30.2))
    [place] = unseen_places([event], visits(), run)
    assert place.severity is Severity.DOUBTFUL
    assert "drove 30.2 m meanwhile" in place.reason


def test_later_visits_confirm_where_it_led_to():
    run = far_drive()
    agreeing = (10, 190), (20, 180)
    [place] = unseen_places(unseen_drives(run), visits(*agreeing), run)
    assert place.severity is Severity.MINOR
    [place] = unseen_places(unseen_drives(run), visits(*agreeing, contradict=True), run)
    assert place.severity is Severity.DOUBTFUL


@pytest.mark.parametrize("change", [{"gap": 0.5}, {"moved": UNSEEN_M - 0.5}])
def test_short_gaps_and_drives_are_none(change):
    assert unseen_drives(far_drive(**change)) == []


def test_scans_by_distance_have_no_gaps_in_time():
    run = far_drive(steps=1.0)
    run.stamps[:] = np.cumsum(np.random.default_rng(1).exponential(3.0, 200))
    assert unseen_drives(run) == []
