# SPDX-License-Identifier: Apache-2.0
"""Runs that mapped only a part of their recording, and the errors that say so."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cartoloop.errors import InputError, Interrupted
from cartoloop.runs.end import Saved
from cartoloop.sensor.repeated_scans import SENT_AGAIN

if TYPE_CHECKING:
    from cartoloop.readers import Log
    from cartoloop.result import Result

MIN_SHARE_OF_SCANS = 0.5
"""A run that maps a smaller share of a recording's scans has failed."""


def is_mostly_lost(result: Result, log: Log) -> bool:
    """Return whether most of a recording is not in its map."""
    num_mapped, num_lost = len(result.stamps), num_lost_scans(result, log)
    return num_mapped < MIN_SHARE_OF_SCANS * (num_mapped + num_lost)


def raise_if_incomplete(saved: Saved, log: Log, hint: str) -> None:
    """Raise the error of a run that did not map the whole recording.

    Parameters
    ----------
    hint : how to go on with it, as a clause.
    """
    outcome, where = saved.outcome, saved.where
    result = outcome.result
    report = result.report
    if outcome.failure is not None:
        raise outcome.failure
    if not outcome.is_complete:
        kept = f"; the map of these is{where}" if where else "; their map was not saved"
        raise Interrupted(f"stopped after {len(result.stamps)} scans{kept}{hint}")
    if is_mostly_lost(result, log):
        num_lost = num_lost_scans(result, log)
        raise InputError(
            f"{log.name}: {num_lost} of {len(result.stamps) + num_lost} scans were skipped, the "
            f"map{where} is of the others alone; `cartoloop doctor` shows what is wrong with them"
        )
    if report.nodes == 0:
        raise InputError(
            f"{log.name}: no scan has enough returns to be mapped, the map{where} is empty; "
            "`cartoloop doctor` shows what the recording contains"
        )
    if lost := next((p.message for p in log.problems if p.severity == "error"), None):
        raise InputError(f"the map{where} covers a part of the recording: {lost}")


def num_lost_scans(result: Result, log: Log) -> int:
    """Return how many scans of a recording could not be read, or not be mapped.

    Scans that were sent again show nothing that is not mapped.
    """
    report = result.report
    num_used = len(result.stamps) + report.skipped.get(SENT_AGAIN, 0)
    return log.num_lost_scans + report.input.scans - num_used
