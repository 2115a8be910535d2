# SPDX-License-Identifier: Apache-2.0
"""The trail keeps the latest metres, and composes their scans."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop.localisation.trail import LENGTH_M, MAX_SCANS, Trail
from cartoloop.sensor.pose import IDENTITY, Pose

WALL = np.array(((2.0, 0.0), (2.0, 1.0)))


def driven(length, step=0.1):
    trail = Trail()
    for k in range(round(length / step) + 1):
        x = k * step
        trail.add(Pose(x, 0.0, 0.0), WALL - (x, 0.0), IDENTITY)
    return trail


def test_scans_are_composed_in_the_frame_of_the_newest():
    composite = driven(1.0).composite(LENGTH_M)

    assert len(composite.scans) > 1
    assert np.allclose(np.unique(composite.points.round(9), axis=0), WALL - (1.0, 0.0))


def test_a_composite_of_no_length_is_the_newest_scan():
    assert len(driven(1.0).composite(0.0).scans) == 1


def test_only_the_latest_metres_are_kept():
    trail = driven(3.0 * LENGTH_M)

    assert trail.travelled == pytest.approx(3.0 * LENGTH_M)
    assert trail.length <= LENGTH_M + 0.3


def test_turning_on_the_spot_for_long_takes_no_more_memory():
    trail = Trail()
    for k in range(5 * MAX_SCANS):
        trail.add(Pose(0.0, 0.0, 0.5 * k), WALL, IDENTITY)

    assert len(trail.composite(LENGTH_M).scans) <= MAX_SCANS + 1


def test_a_trail_without_returns_has_no_composite():
    trail = Trail()
    assert trail.composite(1.0) is None

    trail.add(IDENTITY, np.empty((0, 2)), IDENTITY)
    assert trail.composite(1.0) is None
