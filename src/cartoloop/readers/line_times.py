# SPDX-License-Identifier: Apache-2.0
"""From the stamps of a text recording's lines to times, and the problems with the stamps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.readers.log import ProblemLog
from cartoloop.readers.text_file import TextFile
from cartoloop.sensor.ordered_times import strictly_increasing
from cartoloop.sensor.time_repair import (
    TimeReport,
    jump_length,
    repair_times,
    run_backwards,
    times_between,
)

DENSE_ODOMETRY = 3
"""Lines of odometry for each scan from which scans are few: their stamps may seem to be in order
where those of the odometry show that lines were written in bursts."""


def line_times(
    stamps: FloatArray, scans: Sequence[IntArray], odometry: IntArray
) -> tuple[FloatArray, TimeReport]:
    """Return a time for each line with an event, NaN for others, and a report.

    Parameters
    ----------
    stamps : float64, shape (num_lines,), as recorded; NaN where missing [s].
    scans : the lines that hold a scan, for each scanner; the main scanner first.
    odometry : the lines that hold odometry and no scan.

    Returns
    -------
    times : float64, shape (num_lines,), never running backwards [s].
    report : what was wrong with the main scanner's stamps; gaps and resets are indices of lines.
    """
    times = np.full(len(stamps), np.nan)
    for lines in reversed(scans):  # the main scanner last: its report is the log's
        times[lines], report = repair_times(stamps[lines])
    sweeps = np.flatnonzero(np.isfinite(times))
    if len(odometry) >= DENSE_ODOMETRY * len(sweeps) and run_backwards(stamps[odometry]):
        times[odometry], _ = repair_times(stamps[odometry])
        times[sweeps] = _times_of_few(stamps, times, sweeps, odometry)
        num_repaired = int((times[scans[0]] != stamps[scans[0]]).sum())
        report = replace(report, num_repaired=num_repaired)
    else:
        times[sweeps] = np.maximum.accumulate(times[sweeps])
        times[odometry] = times_between(
            stamps[odometry], odometry, stamps[sweeps], times[sweeps], sweeps
        )
    # Scans may pause while odometry continues: a gap is where both are missing.
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


def _times_of_few(
    stamps: FloatArray, times: FloatArray, sweeps: IntArray, odometry: IntArray
) -> FloatArray:
    """Return times for scans among lines of odometry, whose times are known."""
    between = times_between(stamps[sweeps], sweeps, stamps[odometry], times[odometry], odometry)
    before = odometry[np.maximum(np.searchsorted(odometry, sweeps) - 1, 0)]
    # a scan repeats the reading before it; in a burst, that after it may have the same stamp
    return strictly_increasing(np.where(stamps[before] == stamps[sweeps], times[before], between))


def note_damage(found: ProblemLog, text: TextFile, num_lines: int) -> None:
    """Note that the compressed file is cut off or damaged."""
    if text.damage:
        found.add(
            "error",
            f"{text.name}:{num_lines}: {text.damage} after this line; "
            "what precedes is used, fetch the file again for the rest",
            "damaged",
        )


def note_times(found: ProblemLog, name: str, report: TimeReport) -> None:
    """Note what was wrong with the stamps; gaps and resets in the report are indices of lines."""
    if not report.is_sound:
        found.add("warning", f"{name}: {report.describe()}; file order is kept", "stamps")
    for line, length in zip(report.gaps, report.gap_lengths, strict=True):
        message = f"nothing was recorded for {length:.6g} s before this line"
        found.add("warning", f"{name}:{line + 1}: {message}", "gap")
    for line in report.resets:
        message = "the clock restarts at this line; times continue from the line before"
        found.add("warning", f"{name}:{line + 1}: {message}", "reset")
