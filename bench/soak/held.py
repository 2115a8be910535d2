# SPDX-License-Identifier: Apache-2.0
"""What a process holds: memory of the system, and how much of it is in use."""

from __future__ import annotations

import ctypes
import math
import resource
import sys
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Held:
    """What a process holds at a moment.

    Attributes
    ----------
    memory_mb : memory of the system [MB]: what is in use, and what is kept to be used again.
    in_use_mb : that the C library has handed out, arrays above all [MB]; nan without glibc.
    blocks : of Python's own allocator in use: small objects.
    scans, nodes : mapped so far.
    """

    memory_mb: float = 0.0
    in_use_mb: float = 0.0
    blocks: int = 0
    scans: int = 0
    nodes: int = 0


def held(scans: int, nodes: int) -> Held:
    """Return what this process holds."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    memory_mb = pages * resource.getpagesize() / 1e6
    return Held(memory_mb, _in_use_mb(), sys.getallocatedblocks(), scans, nodes)


class _MallInfo(ctypes.Structure):
    """glibc's ``struct mallinfo2`` (malloc.h)."""

    _fields_ = [
        (name, ctypes.c_size_t)
        for name in (
            "arena", "ordblks", "smblks", "hblks", "hblkhd",
            "usmblks", "fsmblks", "uordblks", "fordblks", "keepcost",
        )
    ]  # fmt: skip


def _in_use_mb() -> float:
    try:
        mallinfo = ctypes.CDLL(None).mallinfo2
    except (AttributeError, OSError, TypeError):  # another C library, or an older one
        return math.nan
    mallinfo.restype = _MallInfo
    info = mallinfo()
    return (int(info.uordblks) + int(info.hblkhd)) / 1e6
