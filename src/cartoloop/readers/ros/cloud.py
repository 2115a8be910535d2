# SPDX-License-Identifier: Apache-2.0
"""Points and their times out of sensor_msgs/PointCloud2, in any order and type of its fields."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import FloatArray
from cartoloop.readers.ros.wire import (
    NANO,
    Cursor,
    DecodeError,
    MessageHeader,
    aligned,
    read_header,
)

TIME_FIELDS = (
    "t", "time", "timestamp", "time_stamp", "offset_time", "time_offset", "timeoffset", "ts",
)  # fmt: skip
"""Names that drivers give to the time of a point."""

_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
_UNITS = (1.0, 1e-3, 1e-6, 1e-9)
_SHORTEST_SWEEP = 2e-3
_LONGEST_SWEEP = 2.0
"""Sweeps last this long [s]: the units differ by factors of 1000, so only one of them fits."""

_EPOCH = 1e6
"""Larger times count from an epoch, not from the start of the sweep [s]."""


class RawCloud(NamedTuple):
    """A cloud as sent.

    Attributes
    ----------
    header : stamp [ns] and frame.
    points : float64, shape (n, 3) [m], sensor frame, without the points that are not finite or
        lie in the scanner itself, which mean no return.
    times : float64, shape (n,) [s] from the stamp on; None if the cloud has none.
    """

    header: MessageHeader
    points: FloatArray
    times: FloatArray | None


def decode_cloud(raw: bytes, is_ros1: bool) -> RawCloud:
    """Return a sensor_msgs/PointCloud2.

    Raises
    ------
    DecodeError
        The bytes are no such message, or it holds no x, y and z.
    """
    header = read_header(raw, is_ros1)
    cursor = Cursor(raw, is_ros1, aligned(header.end, 4, is_ros1))
    height, width = cursor.u32(), cursor.u32()
    fields = {}
    for _ in range(cursor.u32()):
        name = cursor.text().decode("utf-8", "replace").lower()
        offset = cursor.u32()
        code = cursor.data(1)[0]
        cursor.u32()  # count: only the first of several values can be meant
        fields[name] = (offset, code)
    order = ">" if cursor.data(1)[0] else "<"
    point_step, row_step = cursor.u32(), cursor.u32()
    size = cursor.u32()
    data = cursor.data(size)
    if missing := [name for name in "xyz" if name not in fields]:
        raise DecodeError(f"cloud without field {missing[0]}")
    table = _Table(data, order, height, width, point_step, row_step)
    with np.errstate(invalid="ignore"):  # odd kinds of NaN make NumPy warn
        columns = [table.column(*fields[name]).astype(np.float64) for name in "xyz"]
    points = np.column_stack(columns)
    kept = np.isfinite(points).all(axis=1) & (points != 0.0).any(axis=1)
    times = None
    for name in TIME_FIELDS:
        if name in fields:
            times = relative_times(table.column(*fields[name])[kept], header.stamp)
            break
    return RawCloud(header, points[kept], times)


class _Table:
    """The points of a cloud: rows of `row_step` bytes with `width` points of `point_step`."""

    def __init__(
        self, data: bytes, order: str, height: int, width: int, point_step: int, row_step: int
    ) -> None:
        rows = max(height, 1)
        # Some drivers leave row_step at 0, or count it in points.
        step = row_step if row_step >= width * point_step else width * point_step
        if width and (point_step == 0 or len(data) < (rows - 1) * step + width * point_step):
            raise DecodeError("cut off")
        self._data, self._order = data, order
        self._shape, self._strides = (rows, width), (step, point_step)

    def column(self, offset: int, code: int) -> NDArray[np.generic]:
        """Return one field of all points, row by row."""
        if code not in _TYPES:
            raise DecodeError("field of unknown type")
        dtype = np.dtype(self._order + _TYPES[code])
        if self._shape[1] == 0:
            return np.empty(0, dtype)
        if offset + dtype.itemsize > self._strides[1]:
            raise DecodeError("field beyond its point")
        array: NDArray[np.generic] = np.ndarray(
            self._shape, dtype, self._data, offset, self._strides
        )
        return array.reshape(-1)


def relative_times(values: NDArray[np.generic], stamp: int) -> FloatArray | None:
    """Return the times of points [s] from the stamp of their cloud on.

    Drivers send seconds, milliseconds, microseconds or nanoseconds, since the sweep began, since
    an epoch, or before the sweep's end. A sweep lasts 2 ms to 2 s, which determines the unit.

    Parameters
    ----------
    values : shape (n,), as sent.
    stamp : of the cloud [ns].

    Returns
    -------
    float64, shape (n,) [s], or None if all are equal or fit no unit.
    """
    if len(values) == 0:
        return np.empty(0)
    first = values.min()
    # The smallest goes before the change of type: nanoseconds since 1970 overflow a float64.
    since_first = (values - first).astype(np.float64)
    span = float(since_first.max())
    unit = next((u for u in _UNITS if _SHORTEST_SWEEP <= span * u < _LONGEST_SWEEP), None)
    if unit is None or not np.isfinite(span):
        return None
    start = first.item() * unit
    if abs(start) > _EPOCH:
        start = (round(first.item() * round(unit * NANO)) - stamp) / NANO
    # Another clock, or seconds within the hour: all that is known is the order.
    if abs(start) > _LONGEST_SWEEP:
        start = 0.0
    times: FloatArray = since_first * unit + start
    return times
