# SPDX-License-Identifier: Apache-2.0
"""Points in another frame, against the same in NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.kernels.moved_points import moved_points
from cartoloop.sensor.pose import Pose, transform_points


@settings(deadline=None, max_examples=60)
@given(
    pose=st.builds(Pose, *[st.floats(-1e3, 1e3)] * 2, st.floats(-4.0, 4.0)),
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(0, 20),
)
def test_equals_the_transformed_points(pose, seed, count):
    points = np.random.default_rng(seed).uniform(-50.0, 50.0, (count, 2))
    expected = transform_points(pose, points)
    assert moved_points(*pose, points) == pytest.approx(expected, abs=1e-12, rel=1e-14)
