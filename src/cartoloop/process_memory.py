# SPDX-License-Identifier: Apache-2.0
"""How the C library and Python deal with the memory that mapping takes and gives back."""

from __future__ import annotations

import ctypes
import gc

_M_MMAP_THRESHOLD = -3
_LARGE_BYTES = 1 << 20

_OBJECTS = 100_000
"""Mapping makes many objects that stay, and compiling even more, but hardly any that refer to each
other in a circle: to look for such as often as Python usually does takes 2 % of the time of the
one and a tenth of that of the other."""


def look_seldom_for_garbage() -> None:
    """Have Python look only once in a while for what refers to itself and to nothing else."""
    gc.freeze()  # what was imported stays
    gc.set_threshold(_OBJECTS)


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
