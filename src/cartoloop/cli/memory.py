# SPDX-License-Identifier: Apache-2.0
"""How the C library deals with the memory that mapping takes and gives back."""

from __future__ import annotations

import ctypes

_M_MMAP_THRESHOLD = -3
_LARGE_BYTES = 1 << 20


def return_large_blocks() -> None:
    """Have blocks of a megabyte or more go back to the system as soon as they are freed.

    The grids of submaps come and go, each of another size. glibc learns from the first ones to keep
    what is freed for the next, which then does not fit: a third of the memory of a long run. Other
    C libraries do not, and have nothing to be told.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):  # no glibc; TypeError: no C library by default
        return
    mallopt(_M_MMAP_THRESHOLD, _LARGE_BYTES)
