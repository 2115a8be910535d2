# SPDX-License-Identifier: Apache-2.0
"""The points of many scans, as kernels take them that process one scan after the other."""

from __future__ import annotations

from typing import NamedTuple

from cartoloop.arrays import FloatArray, IntArray


class ScanBatch(NamedTuple):
    """The points of k scans.

    Attributes
    ----------
    points : float64, shape (n, 2), tracking frame [m].
    firsts, ends : int64, shape (k,): scan i has ``points[firsts[i] : ends[i]]``.
    """

    points: FloatArray
    firsts: IntArray
    ends: IntArray
