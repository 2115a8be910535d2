# SPDX-License-Identifier: Apache-2.0
"""The points of many scans in one array, for kernels that process many scans."""

from __future__ import annotations

from collections.abc import Sequence
from typing import overload

import numpy as np

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.growing_array import GrowingArray


class ScanPoints(Sequence[FloatArray]):
    """The points of each of many scans, shapes (k, 2) [m]. Read only.

    Attributes
    ----------
    points : float64, shape (n, 2), of these scans and possibly others.
    firsts, ends : int64, shape (len(self),): scan i has ``points[firsts[i] : ends[i]]``.
    """

    __slots__ = ("ends", "firsts", "points")

    def __init__(self, points: FloatArray, firsts: IntArray, ends: IntArray) -> None:
        self.points = points
        self.firsts = firsts
        self.ends = ends

    @staticmethod
    def of(scans: Sequence[FloatArray]) -> ScanPoints:
        """Return the points of a sequence of scans."""
        ends = np.cumsum([0, *map(len, scans)], dtype=np.int64)
        points = np.ascontiguousarray(np.concatenate([np.empty((0, 2)), *scans]))
        return ScanPoints(points, ends[:-1], ends[1:])

    @property
    def counts(self) -> IntArray:
        """Number of points of each scan, shape (len(self),)."""
        return self.ends - self.firsts

    def take(self, scans: IntArray) -> ScanPoints:
        """Return the scans with these indices, without copying points."""
        return ScanPoints(self.points, self.firsts[scans], self.ends[scans])

    def __len__(self) -> int:
        return len(self.firsts)

    @overload
    def __getitem__(self, scan: int) -> FloatArray: ...
    @overload
    def __getitem__(self, scan: slice) -> ScanPoints: ...
    def __getitem__(self, scan: int | slice) -> FloatArray | ScanPoints:
        if isinstance(scan, slice):
            return ScanPoints(self.points, self.firsts[scan], self.ends[scan])
        return self.points[self.firsts[scan] : self.ends[scan]]


class NodePoints:
    """The returns of all nodes so far; one thread adds nodes, others may read."""

    def __init__(self) -> None:
        self._points = GrowingArray((2,), np.float64)
        self._bounds = GrowingArray((), np.int64)
        self._bounds.append(0)

    def append(self, points: FloatArray) -> None:
        """Add the returns of the next node, shape (k, 2) [m], tracking frame."""
        self._points.extend(points)
        self._bounds.append(len(self._points))

    @property
    def view(self) -> ScanPoints:
        """The returns of the nodes so far; nodes added later do not change it."""
        bounds = self._bounds.view  # read before the points, which are appended first
        return ScanPoints(self._points.view, bounds[:-1], bounds[1:])
