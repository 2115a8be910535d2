# SPDX-License-Identifier: Apache-2.0
"""Sessions: the drives that a map is made of, and which parts of it are connected."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

MAIN_PART = 0
"""The part of a map that is drawn and exported."""


@dataclass(frozen=True, slots=True)
class Session:
    """One drive of one robot, mapped without interruption, with a local frame of its own.

    The sessions of a map are contiguous ranges of its scans, nodes and submaps, in order: each ends
    where the next one begins.

    Attributes
    ----------
    name : of the session; by default that of the recording.
    recording : file name of the recording, or the live source.
    fingerprint : of the recording, see `Report.fingerprint`.
    first_scan, first_node, first_submap : where it begins.
    part : number of the connected part of the map that it belongs to. Poses of different parts are
        in different frames; those of part 0 are in the map frame.
    stamp : of its first scan [s], NaN without one.
    calibration : what was learnt about the sensors; values are JSON.
    """

    name: str = ""
    recording: str = ""
    fingerprint: str = ""
    first_scan: int = 0
    first_node: int = 0
    first_submap: int = 0
    part: int = MAIN_PART
    stamp: float = math.nan
    calibration: Mapping[str, Any] = field(default_factory=dict)


def whole_map(
    name: str = "", fingerprint: str = "", stamps: Sequence[float] | NDArray[np.float64] = ()
) -> tuple[Session, ...]:
    """Return the sessions of a map that is made of one."""
    stamp = float(stamps[0]) if len(stamps) else math.nan
    return (Session(name, name, fingerprint, stamp=stamp),)


def named(sessions: Sequence[Session], name: str, fingerprint: str) -> tuple[Session, ...]:
    """Return sessions, the last of them of a recording."""
    *before, last = sessions
    return (
        *before,
        replace(last, name=last.name or name, recording=name, fingerprint=fingerprint),
    )


def session_numbers(firsts: Sequence[int], count: int) -> NDArray[np.int64]:
    """Return the session that each of `count` scans, nodes or submaps belongs to, shape (count,).

    Parameters
    ----------
    firsts : where each session begins, ascending.
    """
    numbers: NDArray[np.int64] = np.searchsorted(firsts, np.arange(count), side="right") - 1
    return np.maximum(numbers, 0)


def parts_of(sessions: Sequence[Session], firsts: Sequence[int], count: int) -> NDArray[np.int64]:
    """Return the part that each of `count` scans, nodes or submaps belongs to, shape (count,)."""
    if not sessions:
        return np.full(count, MAIN_PART, dtype=np.int64)
    parts = np.array([session.part for session in sessions], dtype=np.int64)
    return parts[session_numbers(firsts, count)]


def ranges(firsts: Sequence[int], count: int) -> list[slice]:
    """Return the range of each session in `count` scans, nodes or submaps."""
    ends = [*firsts[1:], count] if firsts else []
    return [slice(first, end) for first, end in zip(firsts, ends, strict=True)]
