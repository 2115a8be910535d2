# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cartoloop.readers.ros.cloud import decode_cloud, relative_times
from cartoloop.readers.ros.wire import DecodeError
from tests.readers.ros.bag_files import NANO, START, Messages

POINTS = np.array([[1.0, 2.0, 3.0], [-4.0, 5.5, 0.25], [7.0, -8.0, 9.0], [0.5, 0.5, 0.5]])


def table(dtype, **columns):
    data = np.zeros(len(POINTS), dtype)
    data["x"], data["y"], data["z"] = POINTS.T
    for name, values in columns.items():
        data[name] = values
    return data


@pytest.mark.parametrize("ros1", [True, False], ids=["ros1", "cdr"])
@given(
    names=st.permutations(["x", "y", "z", "intensity", "ring"]),
    kind=st.sampled_from(["f4", "f8"]),
    big=st.booleans(),
    height=st.sampled_from([1, 2, 4]),
    row_pad=st.integers(0, 9),
    padding=st.integers(0, 5),
)
def test_points_are_found_in_any_layout(ros1, names, kind, big, height, row_pad, padding):
    order = ">" if big else "<"
    kinds = dict.fromkeys("xyz", order + kind) | {"intensity": "|u1", "ring": order + "u2"}
    formats = [kinds[name] for name in names]
    sizes = [np.dtype(f).itemsize for f in formats]
    offsets = np.concatenate(([0], np.cumsum(sizes)[:-1])) + padding
    dtype = np.dtype(
        {
            "names": names,
            "formats": formats,
            "offsets": offsets.tolist(),
            "itemsize": int(sum(sizes)) + 2 * padding,
        }
    )
    make = Messages(ros1)
    message = make.cloud(START, table(dtype), dtype, height=height, row_pad=row_pad, big_endian=big)
    cloud = decode_cloud(make.encode(message), ros1)
    np.testing.assert_array_equal(cloud.points, POINTS)
    assert cloud.points.dtype == np.float64
    assert cloud.times is None


XYZ = [("x", "<f4"), ("y", "<f4"), ("z", "<f4")]


def test_points_without_a_return_are_left_out():
    dtype = np.dtype([*XYZ, ("t", "<u4")])
    data = table(dtype, t=[0, 10_000_000, 20_000_000, 30_000_000])
    data["x"][1] = np.nan
    for name in "xyz":
        data[name][2] = 0.0
    make = Messages(False)
    cloud = decode_cloud(make.encode(make.cloud(START, data, dtype)), False)
    np.testing.assert_array_equal(cloud.points, POINTS[[0, 3]])
    np.testing.assert_allclose(cloud.times, [0.0, 0.03])


STAMP = START * NANO + 250_000_000
EXPECTED = np.array([0.0, 0.02, 0.05, 0.099])


@pytest.mark.parametrize(
    "values",
    [
        EXPECTED.astype(np.float32),
        np.round(EXPECTED * 1e9).astype(np.uint32),
        np.round(EXPECTED * 1e6).astype(np.uint32),
        EXPECTED + STAMP * 1e-9,
        np.round(EXPECTED * 1e9).astype(np.uint64) + np.uint64(STAMP),
        np.round(EXPECTED * 1e9) + float(STAMP),
        np.round(EXPECTED * 1e6).astype(np.int64) + STAMP // 1000,
        EXPECTED + 77_000_000.0,
    ],
    ids=["s", "ns", "us", "s of 1970", "ns of 1970", "ns as float", "us of 1970", "other clock"],
)
def test_times_of_points_in_any_unit_from_any_start(values):
    np.testing.assert_allclose(relative_times(values, STAMP), EXPECTED, atol=2e-6)


def test_times_before_the_end_of_the_sweep_stay_before_it():
    np.testing.assert_allclose(relative_times(EXPECTED - 0.1, STAMP), EXPECTED - 0.1)


@pytest.mark.parametrize("values", [np.zeros(4), np.full(4, 7.0), np.array([0.0, 1e40])])
def test_times_without_information_are_left_out(values):
    assert relative_times(values, STAMP) is None


def test_an_empty_cloud_is_empty():
    dtype = np.dtype([*XYZ, ("t", "<u4")])
    make = Messages(True)
    cloud = decode_cloud(make.encode(make.cloud(START, np.zeros(0, dtype), dtype)), True)
    assert cloud.points.shape == (0, 3)


def test_a_cloud_without_coordinates_is_refused():
    dtype = np.dtype([("x", "<f4"), ("y", "<f4")])
    make = Messages(True)
    raw = make.encode(make.cloud(START, np.zeros(3, dtype), dtype))
    with pytest.raises(DecodeError, match="without field z"):
        decode_cloud(raw, True)


@given(data=st.data())
def test_a_cloud_cut_off_is_refused(data):
    dtype = np.dtype(XYZ)
    make = Messages(True)
    raw = make.encode(make.cloud(START, table(dtype), dtype))
    end = data.draw(st.integers(0, len(raw) - 2))
    with pytest.raises(DecodeError):
        decode_cloud(raw[:end], True)


@given(raw=st.binary(max_size=300), ros1=st.booleans())
def test_any_bytes_are_a_cloud_or_refused(raw, ros1):
    try:
        decode_cloud(raw, ros1)
    except DecodeError as error:
        assert str(error)
