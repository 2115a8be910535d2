# SPDX-License-Identifier: Apache-2.0
"""From the stamps of a text recording's lines to times, and what is told of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cartoloop.readers.log import Problems
from cartoloop.readers.source import Source
from cartoloop.sensor.time_repair import TimeReport, jump_length, repair_times, times_between

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def line_times(
    stamps: FloatArray, scans: Sequence[IntArray], odometry: IntArray
) -> tuple[FloatArray, TimeReport]:
    """Return a time for each line with an event, NaN for others, and what was wrong.

    Parameters
    ----------
    stamps : float64, shape (num_lines,), as recorded; NaN where missing [s].
    scans : the lines that hold a scan, for each scanner; the main scanner first.
    odometry : the lines that hold odometry and no scan.

    Returns
    -------
    times : float64, shape (num_lines,), never running backwards [s].
    report : of the main scanner; gaps and resets are indices of lines.
    """
    times = np.full(len(stamps), np.nan)
    for lines in reversed(scans):  # the main scanner last: its report is the log's
        times[lines], report = repair_times(stamps[lines])
    sweeps = np.flatnonzero(np.isfinite(times))
    times[sweeps] = np.maximum.accumulate(times[sweeps])
    if len(odometry):
        times[odometry] = times_between(
            stamps[odometry], odometry, stamps[sweeps], times[sweeps], sweeps
        )
    # Scans may pause while odometry goes on: it is a gap only where both are silent.
    events = np.flatnonzero(np.isfinite(times))
    silence = np.diff(times[events])
    gaps = np.flatnonzero(silence > jump_length(report.period))
    report = replace(
        report,
        gaps=tuple(events[gaps + 1].tolist()),
        gap_lengths=tuple(silence[gaps].tolist()),
        resets=tuple(scans[0][list(report.resets)].tolist()),
    )
    return times, report


def note_damage(found: Problems, source: Source, num_lines: int) -> None:
    """Note that the compressed file breaks off or is damaged."""
    if source.damage:
        found.add(
            "error",
            f"{source.name}:{num_lines}: {source.damage} after this line; "
            "what precedes is used, fetch the file again for the rest",
            "damaged",
        )


def note_times(found: Problems, name: str, report: TimeReport) -> None:
    """Note what was wrong with the stamps; the report is of lines."""
    if not report.is_sound:
        found.add("warning", f"{name}: {report.describe()}; file order is kept", "stamps")
    for line, length in zip(report.gaps, report.gap_lengths, strict=True):
        message = f"nothing was recorded for {length:.6g} s before this line"
        found.add("warning", f"{name}:{line + 1}: {message}", "gap")
    for line in report.resets:
        message = "the clock starts anew at this line; times go on from the line before"
        found.add("warning", f"{name}:{line + 1}: {message}", "reset")
