# SPDX-License-Identifier: Apache-2.0
"""The motion to surveyed points is that of least squares."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cartoloop.map_editing.rigid_fit import fit_points
from cartoloop.sensor.pose import Pose, transform_points

coordinates = st.floats(-50.0, 50.0).map(lambda value: round(value, 3))
points = st.lists(st.tuples(coordinates, coordinates), min_size=2, max_size=6, unique=True)


@given(points, st.tuples(coordinates, coordinates), st.floats(-3.1, 3.1))
def test_an_exact_motion_is_found(places, shift, angle):
    places = np.array(places)
    if np.ptp(places, axis=0).max() < 0.5:
        places[0] += 10.0
    surveyed = transform_points(Pose(*shift, angle), places)
    fit = fit_points(places, surveyed)

    np.testing.assert_allclose(transform_points(fit.tf_surveyed_map, places), surveyed, atol=1e-8)
    assert fit.scale == pytest.approx(1.0)


@given(points, st.integers(0, 1000))
def test_no_other_motion_nearby_fits_better(places, seed):
    places = np.array(places)
    if np.ptp(places, axis=0).max() < 0.5:
        places[0] += 10.0
    rng = np.random.default_rng(seed)
    surveyed = places @ np.array([(0.0, 1.2), (-1.2, 0.0)]) + rng.normal(0.0, 0.5, places.shape)
    if np.hypot(*(surveyed - surveyed.mean(axis=0)).T).max() < 0.2:
        return
    fit = fit_points(places, surveyed)
    best = np.sum(fit.residuals**2)

    for step in rng.normal(0.0, 1e-3, (20, 3)):
        other = Pose(*(np.array(fit.tf_surveyed_map) + step).tolist())
        assert np.sum((surveyed - transform_points(other, places)) ** 2) >= best - 1e-9


def test_points_at_one_place_are_refused():
    apart = np.array([(0.0, 0.0), (10.0, 0.0)])
    for places, surveyed in ((apart * 0.001, apart), (apart, apart * 0.001)):
        with pytest.raises(ValueError, match=r"lie within 0\.1 m"):
            fit_points(places, surveyed)


def test_the_scale_is_reported_and_left():
    fit = fit_points(np.array([(0.0, 0.0), (10.0, 0.0)]), np.array([(0.0, 0.0), (0.0, 11.0)]))

    assert fit.tf_surveyed_map.theta == pytest.approx(math.pi / 2)
    assert fit.scale == pytest.approx(1.1)
    np.testing.assert_allclose(fit.distances, (0.5, 0.5))
