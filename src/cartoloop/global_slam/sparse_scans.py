# SPDX-License-Identifier: Apache-2.0
"""Recordings of a scan a metre or so, as many public ones are: when scans are sparse.

Sparse scans overlap little. Their poses drift more, and they leave holes in the walls of a submap,
so that right matches score as low there as false ones.
"""

from __future__ import annotations

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.submaps.submap import SPARSE_STEP_M

TURN_STEP_M = 0.1
"""Shorter steps are turns on the spot [m]."""


def are_sparse(poses: FloatArray) -> bool:
    """Return whether the median step of a submap's nodes, but for turns, is that of sparse scans.

    Parameters
    ----------
    poses : of the nodes in their order, shape (n, 3) [m, m, rad].
    """
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    steps = steps[steps > TURN_STEP_M]
    return len(steps) > 0 and float(np.median(steps)) > SPARSE_STEP_M
