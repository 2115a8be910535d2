# SPDX-License-Identifier: Apache-2.0
"""Windows that hold the drift, against a slow and obvious reference."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cartoloop.kernels.wide_windows import WindowRule, drift_windows
from cartoloop.sensor.pose import Pose, relative

RULE = WindowRule(3.0, 0.5, 0.1, 0.04, 0.002)


def naive_window(drift, node, submap, box):
    """The window of a node in one submap, by matrices."""
    jacobian = np.array([[1.0, 0.0, submap.y - node.y], [0.0, 1.0, node.x - submap.x]])
    covariance = jacobian @ drift @ jacobian.T
    largest = float(np.linalg.eigvalsh(covariance)[1])
    linear = RULE.least_linear + RULE.num_sigmas * math.sqrt(largest + RULE.translation_variance)
    variance = float(drift[2, 2]) + RULE.rotation_variance
    angular = RULE.least_angular + RULE.num_sigmas * math.sqrt(variance)
    expected = relative(submap, node)
    nearest = np.clip(expected[:2], box[:2], box[2:])
    share = math.inf
    if math.dist(nearest, expected[:2]) <= linear:
        share = math.dist(0.5 * (box[:2] + box[2:]), expected[:2]) / linear
    return (*expected, linear, angular, share)


@given(st.integers(0, 1000), st.integers(1, 8), st.floats(1.0, 60.0))
def test_windows_hold_the_drift(seed, count, size):
    rng = np.random.default_rng(seed)
    roots = rng.normal(0.0, 1.0, (count, 3, 3)) * np.array((1.0, 1.0, 0.05))
    drift = np.swapaxes(roots, 1, 2) @ roots
    poses = rng.normal(0.0, size, (count, 3))
    node = Pose(*rng.normal(0.0, size, 3).tolist())
    low = rng.uniform(-20.0, -1.0, (count, 2))
    boxes = np.column_stack((low, low + rng.uniform(1.0, 40.0, (count, 2))))
    submaps = np.sort(rng.permutation(count)[: rng.integers(1, count + 1)])
    windows = np.empty((len(submaps), 6))
    num_in_reach = drift_windows(submaps, drift, node[:], poses, boxes, RULE[:], windows)
    expected = [naive_window(drift[i], node, Pose(*poses[i]), boxes[i]) for i in submaps.tolist()]
    assert windows == pytest.approx(np.array(expected), rel=1e-9, abs=1e-9)
    assert num_in_reach == sum(math.isfinite(share) for *_, share in expected)
