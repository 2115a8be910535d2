# SPDX-License-Identifier: Apache-2.0
"""Statistics of errors."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cartoloop.evaluation.error_statistics import ErrorStatistics, percentiles

errors = st.lists(st.floats(0, 100), min_size=1, max_size=40).map(np.array)


def test_agree_with_a_case_computed_by_hand():
    statistics = ErrorStatistics.of(np.array([4.0, 1.0, 2.0, 3.0, 0.0]))

    assert statistics.to_dict() == pytest.approx(
        {
            "rmse": math.sqrt(30 / 5),
            "mean": 2.0,
            "median": 2.0,
            "std": math.sqrt((4 + 1 + 0 + 1 + 4) / 5),
            "min": 0.0,
            "max": 4.0,
            "p50": 2.0,
            "p90": 3.6,  # a tenth of the four steps before the greatest
            "p99": 3.96,
        }
    )


def test_percentiles_have_names():
    assert percentiles(np.array([0.0, 10.0]), (25, 90)) == pytest.approx(
        {"p25": 2.5, "p90": 9.0, "max": 10.0}
    )


@given(errors)
def test_square_is_mean_and_deviation(errors):
    statistics = ErrorStatistics.of(errors)

    assert statistics.rmse**2 == pytest.approx(statistics.mean**2 + statistics.std**2, abs=1e-9)


@given(errors)
def test_percentiles_are_in_order_and_bound_their_share(errors):
    bounds = percentiles(errors)

    assert np.all(np.diff(list(bounds.values())) >= -1e-9)
    assert np.mean(errors <= bounds["p50"] + 1e-9) >= 0.5
    assert bounds["max"] == errors.max()
