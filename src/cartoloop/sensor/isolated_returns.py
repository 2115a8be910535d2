# SPDX-License-Identifier: Apache-2.0
"""Returns of a scan with none of their neighbours near: dust, insects, sunlight, electrical noise.

They are few in a scan, but a composite scan of many, thinned to a point in each voxel, keeps them
all, while the walls that its scans share are thinned.
"""

from __future__ import annotations

from cartoloop.arrays import FloatArray
from cartoloop.kernels.near_neighbours import with_near_neighbour

NEAR_M, NEAR_SPACINGS = 0.3, 6.0
"""A neighbour is near within the first distance [m] and this many times the distance of two beams
at the range of the return: on walls that are seen at a slant, returns are some beams apart."""

MIN_RETURNS = 10
"""Scans with fewer returns keep them all."""


def without_isolated(returns: FloatArray) -> FloatArray:
    """Return the returns that have a neighbour by angle near, in their order, shape (m, 2).

    Parameters
    ----------
    returns : float64, shape (n, 2), around the sensor, roughly [m].
    """
    if len(returns) < MIN_RETURNS:
        return returns
    return with_near_neighbour(returns, NEAR_M, NEAR_SPACINGS)
