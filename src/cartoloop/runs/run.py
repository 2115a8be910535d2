# SPDX-License-Identifier: Apache-2.0
"""A run over a recording: its scans are mapped, with a journal on the way, and the map is saved."""

from __future__ import annotations

import time
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from cartoloop.errors import Interrupted
from cartoloop.journal.outcomes import NO_RUN_OUTCOMES
from cartoloop.map_output.output_folder import RunFolder
from cartoloop.runs.end import Outcome, Saved, completed, save_outcome, timed
from cartoloop.runs.events import map_events
from cartoloop.runs.incomplete import is_mostly_lost, raise_if_incomplete
from cartoloop.runs.journal import RunJournal
from cartoloop.runs.observer import RunObserver
from cartoloop.session import named
from cartoloop.stop_request import StopRequest

if TYPE_CHECKING:
    from cartoloop.config_file import LoadedConfig
    from cartoloop.map_output.picture import Layer
    from cartoloop.readers import Log
    from cartoloop.result import Result
    from cartoloop.runs.base import RunBase


@dataclass(frozen=True)
class Run:
    """What is mapped, and how.

    Attributes
    ----------
    base : the map that it is added to, if any.
    start : when it began [s], as of `time.perf_counter`.
    """

    log: Log
    loaded: LoadedConfig
    layers: Collection[Layer]
    observer: RunObserver
    stop: StopRequest
    base: RunBase | None = None
    start: float = field(default_factory=time.perf_counter)

    @property
    def identity(self) -> tuple[str, str]:
        """Name and fingerprint of the map: those of all its recordings."""
        log = self.log
        if self.base is None:
            return log.name, log.fingerprint
        base = self.base.content
        from cartoloop.readers.fingerprint import joint_fingerprint

        return (
            f"{base.report.input.name} + {log.name}",
            joint_fingerprint([base.report.fingerprint, log.fingerprint]),
        )

    def folder(self, path: Path, *, overwrite: bool) -> RunFolder:
        """Return the folder to save the map in."""
        adds = self.base is not None and self.base.is_in_folder
        added_to = self.base.state if self.base is not None and adds else None
        return RunFolder(path, *self.identity, overwrite, adds, added_to=added_to)


def carry_out(run: Run, folder: RunFolder | None, journal: RunJournal | None) -> Result:
    """Map, save, and raise what has to be raised."""
    log, observer, stop = run.log, run.observer, run.stop
    try:
        outcome = _mapped(run, journal)
        if not outcome.is_complete and outcome.failure is None and not len(outcome.result.stamps):
            if journal is not None and not journal.num_recorded_scans:
                journal.remove()
            raise Interrupted("stopped before the first scan: nothing was saved")
        if journal is not None and not outcome.is_complete:
            _keep_journal(journal, outcome)
        outcome = replace(outcome, result=_reported(outcome.result, run))
        observer.mapped(outcome.result, outcome.failure)
        saved = Saved(outcome, None, "")
        if folder is not None:
            saved = save_outcome(
                outcome, folder, run.layers, run.loaded.origins, observer.saving, run.start, stop
            )
    except KeyboardInterrupt as interrupt:
        raise Interrupted(f"stopped at once: nothing was saved{_hint(journal)}") from interrupt
    finally:
        if journal is not None:
            journal.close()
    if journal is not None and outcome.is_complete:
        journal.remove()
    # A stop during saving is reported too, so that no further step follows.
    outcome = replace(saved.outcome, is_complete=outcome.is_complete and not stop.made)
    observer.saved(outcome.result, outcome.failure)
    raise_if_incomplete(replace(saved, outcome=outcome), log, _hint(journal))
    return outcome.result


def _keep_journal(journal: RunJournal, outcome: Outcome) -> None:
    """Close the journal of a run that ended early.

    Raises
    ------
    Exception
        The run had not come as far as before it was resumed: less than that is not saved.
    """
    is_behind = journal.outcomes.is_replaying
    journal.close()
    if not is_behind:
        return
    if outcome.failure is not None:
        raise outcome.failure
    raise Interrupted(
        f"stopped before the run had come as far as before: nothing was saved{_hint(journal)}"
    )


def _hint(journal: RunJournal | None) -> str:
    """Return how to go on with a run that has a journal, as a clause."""
    return "" if journal is None else f"; --resume {journal.path.parent} goes on with it"


def _mapped(run: Run, journal: RunJournal | None) -> Outcome:
    # Loads the kernels: part of the measured time.
    from cartoloop.first_pass import recorded_calibration
    from cartoloop.mapper import Mapper

    config = run.loaded.config
    run.observer.started(run.log.num_scans)
    outcomes = NO_RUN_OUTCOMES if journal is None else journal.outcomes
    if journal is not None and journal.num_recorded_scans:
        run.observer.resumed(journal.num_recorded_scans)
    calibration = recorded_calibration(run.log, config, run.stop, outcomes.local)
    mapper = Mapper(
        config,
        calibration=calibration,
        outcomes=outcomes,
        onto=None if run.base is None else run.base.content,
        onto_pose=None if run.base is None else run.base.about.pose,
    )
    return map_events(run.log, mapper, run.observer, run.stop)


def _reported(result: Result, run: Run) -> Result:
    """Return a result whose report says all about the recording and the run."""
    log, (name, fingerprint) = run.log, run.identity
    messages = [problem.message for problem in log.problems]
    report = completed(result, name, log.skipped, messages, fingerprint=fingerprint)
    finished = report.finished and report.nodes > 0 and not is_mostly_lost(result, log)
    return replace(
        result,
        report=timed(replace(report, finished=finished), run.start),
        sessions=named(result.sessions, log.name, log.fingerprint),
    )
