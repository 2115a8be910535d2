# SPDX-License-Identifier: Apache-2.0
"""How the C library and Python deal with the memory that mapping takes and gives back."""

from __future__ import annotations

import ctypes
import gc
from collections.abc import Callable
from typing import cast

from cartoloop.reused_memory import return_idle

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3
_LARGE_BYTES = 2 << 20
_KEPT_BYTES = 16 << 20

_OBJECTS = 100_000
"""Mapping makes many objects that stay, and compiling even more, but hardly any that refer to each
other in a circle: to look for such as often as Python usually does takes 2 % of the time of the
one and a tenth of that of the other."""


def look_seldom_for_garbage() -> None:
    """Have Python look only once in a while for what refers to itself and to nothing else."""
    gc.freeze()  # what was imported stays
    gc.set_threshold(_OBJECTS)


def return_large_blocks() -> None:
    """Have blocks of two megabytes or more go back to the system as soon as they are freed.

    The grids of submaps come and go, each of another size. glibc learns from the first ones to keep
    what is freed for the next, which then does not fit: a third of the memory of a long run. What
    is smaller is kept, up to 16 MB: the system clears what it hands out anew, in vain if each
    search gives back what the next one needs. Other C libraries have nothing to be told.
    """
    if (mallopt := _of_c_library("mallopt")) is not None:
        mallopt(_M_TRIM_THRESHOLD, _KEPT_BYTES)
        mallopt(_M_MMAP_THRESHOLD, _LARGE_BYTES)


def return_unused() -> None:
    """Give back to the system what is kept for the next search, before the map is composed."""
    return_idle()
    if (malloc_trim := _of_c_library("malloc_trim")) is not None:
        malloc_trim(0)


def _of_c_library(name: str) -> Callable[..., int] | None:
    """Return a function that glibc has, and None elsewhere."""
    try:
        return cast(Callable[..., int], getattr(ctypes.CDLL(None), name))
    except (AttributeError, OSError, TypeError):  # no glibc; TypeError: no C library by default
        return None
