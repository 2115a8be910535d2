# SPDX-License-Identifier: Apache-2.0
"""Memory of the process: settings of the C library and of Python, and what was used."""

from __future__ import annotations

import ctypes
import gc
import sys
from collections.abc import Callable
from pathlib import Path
from typing import cast

from cartoloop.runtime.reused_memory import drop_idle_memory

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3
"""Numbers of the options of glibc's mallopt (malloc.h)."""

_LARGE_BYTES = 2 << 20
"""Blocks from this size on are mapped and unmapped one by one [bytes]."""

_KEPT_BYTES = 16 << 20
"""Free memory that the C library keeps at the top of its heap [bytes]."""

_GC_THRESHOLD = 100_000
"""Allocations between collections of the youngest generation. Mapping makes many objects that stay,
and compiling even more, but hardly any cycles: Python's default threshold costs 2% of the time of
mapping and a tenth of the time of compiling."""


def relax_gc() -> None:
    """Raise the threshold of the garbage collector, and exclude what was imported from it."""
    gc.freeze()
    gc.set_threshold(_GC_THRESHOLD)


def set_malloc_thresholds() -> None:
    """Have glibc return blocks of 2 MB or more to the system as soon as they are freed.

    The grids of submaps have many different sizes. By default glibc adapts to the first ones and
    keeps freed blocks for later ones, which then do not fit: a third of the memory of a long run.
    Smaller blocks are kept, up to 16 MB, because the system clears every page that it hands out,
    and each search would pay for that again. Other C libraries are left as they are.
    """
    if (mallopt := _c_function("mallopt")) is not None:
        mallopt(_M_TRIM_THRESHOLD, _KEPT_BYTES)
        mallopt(_M_MMAP_THRESHOLD, _LARGE_BYTES)


def release_unused_memory() -> None:
    """Return idle memory to the system, before the map is composed."""
    drop_idle_memory()
    if (malloc_trim := _c_function("malloc_trim")) is not None:
        malloc_trim(0)


class PeriodicRelease:
    """Returns unused memory to the system now and then, in a run that may last for days.

    Blocks of many sizes come and go with each submap. What is in use does not grow, but the free
    blocks between do.

    Parameters
    ----------
    period : scans between.
    """

    def __init__(self, period: int = 6000) -> None:
        self._period = period
        self._count = 0

    def after_scan(self) -> None:
        """Count a scan, and release what is unused when it is time."""
        self._count += 1
        if self._count == self._period:
            self._count = 0
            release_unused_memory()


def peak_memory_mb() -> float:
    """Return the most memory that this process ever held [MB]; 0 where it is unknown."""
    if sys.platform == "win32":
        return 0.0
    status = Path("/proc/self/status")
    if status.exists():  # getrusage would include the process that this one was forked from
        for line in status.read_text(encoding="utf-8").splitlines():
            if line.startswith("VmHWM:"):
                return float(line.split()[1]) * 1024 / 1e6
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1e6 if sys.platform == "darwin" else peak * 1024 / 1e6


def _c_function(name: str) -> Callable[..., int] | None:
    """Return a function of glibc, and None elsewhere."""
    try:
        return cast(Callable[..., int], getattr(ctypes.CDLL(None), name))
    except (AttributeError, OSError, TypeError):  # no glibc; TypeError: no C library by default
        return None
