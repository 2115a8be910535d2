# SPDX-License-Identifier: Apache-2.0
"""Whether a scanner sees what it saw before."""

from __future__ import annotations

import math

from cartoloop._jit import kernel
from cartoloop.arrays import FloatArray


@kernel
def any_changed(
    before: FloatArray,
    now: FloatArray,
    max_before: float,
    max_now: float,
    change: tuple[float, float, float],
    noise: tuple[float, float],
) -> bool:
    """Return whether a range has changed that is a return in both scans.

    Parameters
    ----------
    before, now : float64, shape (n,) [m].
    max_before, max_now : ranges between 0 and these are returns [m].
    change : a range has changed if it has by more than the first [m], the second times the smaller
        one, and the third times its standard deviation, added up.
    noise : that is the first [m], and the second times the range, their squares added up.
    """
    least, share, sigmas = change
    constant, noise_share = noise
    for k in range(before.shape[0]):
        if not (0.0 < before[k] < max_before and 0.0 < now[k] < max_now):
            continue
        nearer = min(before[k], now[k])
        sigma = math.hypot(constant, noise_share * nearer)
        if abs(now[k] - before[k]) > least + share * nearer + sigmas * sigma:
            return True
    return False
