# SPDX-License-Identifier: Apache-2.0
"""The points of many scans, as kernels take them that process one scan after the other."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class ScanBatch(NamedTuple):
    """The points of k scans.

    Attributes
    ----------
    points : float64, shape (n, 2), tracking frame [m].
    firsts, ends : int64, shape (k,): scan i has ``points[firsts[i] : ends[i]]``.
    """

    points: NDArray[np.float64]
    firsts: NDArray[np.int64]
    ends: NDArray[np.int64]
