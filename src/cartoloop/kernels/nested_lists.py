# SPDX-License-Identifier: Apache-2.0
"""Lists within a list, as in serialized messages: the length of each, then its items."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel
from cartoloop.arrays import IntArray


@kernel
def find_lists(
    words: NDArray[np.uint32],
    start: int,
    out_firsts: IntArray,
    out_counts: IntArray,
) -> int:
    """Write the index of each list's first item and its length; return the end of the last.

    Parameters
    ----------
    words : uint32, shape (num_words,): lengths, and items of the same size.
    start : of the first list.
    out_firsts, out_counts : int64, shape (num_lists,).

    Returns
    -------
    The place after the last item, or -1 where the lists are longer than the words.
    """
    place = start
    for i in range(out_firsts.size):
        if place >= words.size:
            return -1
        out_counts[i] = words[place]
        out_firsts[i] = place + 1
        place += 1 + int(out_counts[i])
    return place if place <= words.size else -1
