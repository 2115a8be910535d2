# SPDX-License-Identifier: Apache-2.0
"""Points as whole numbers, against NumPy."""

from __future__ import annotations

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from cartoloop.sensor.packed_points import POINT_UNIT, pack_points, unpack_points

POINTS = arrays(
    np.float64,
    st.tuples(st.integers(0, 20), st.just(2)),
    elements=st.floats(-1e9, 1e9) | st.floats(-40.0, 40.0) | st.floats(-0.01, 0.01),
)


@given(points=POINTS)
@example(points=np.array(((0.0005, -0.0005), (0.0015, 0.0025))))  # halves go to the even number
@example(points=np.array(((32.767, -32.768), (0.0, 40.0))))
def test_numbers_are_the_nearest_of_a_unit_that_fits(points):
    unit, packed = pack_points(points)

    expected_unit = max(POINT_UNIT, float(np.abs(points).max(initial=0.0)) / 32767)
    expected = np.rint(points.T / expected_unit).astype("<i2")
    assert (unit, packed) == (expected_unit, expected.tobytes())
    unpacked = unpack_points(len(points), unit, packed)
    assert np.abs(unpacked - points).max(initial=0.0) <= 0.5 * unit * (1.0 + 1e-9)


def test_points_of_other_layouts_are_packed():
    points = np.array(((0.25, -1.5), (3.0, 2.0), (1.0, 0.5)))
    expected = pack_points(points)
    assert pack_points(np.asfortranarray(points)) == expected
    assert pack_points(points.astype(np.float32)) == expected
