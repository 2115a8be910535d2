# SPDX-License-Identifier: Apache-2.0
"""One call from a recording to a saved map: read, map, complete the report, save.

>>> from cartoloop.runs.recording import map_recording
>>> result = map_recording("intel.clf.gz", out="intel")
>>> result.report.wall_s, result.report.skipped
"""

from __future__ import annotations

import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cartoloop.arguments import as_path, require_type, shown
from cartoloop.config import Config
from cartoloop.config_file import LoadedConfig
from cartoloop.errors import InputError, Interrupted, UsageError
from cartoloop.journal.outcomes import NO_RUN_OUTCOMES
from cartoloop.map_file.run_header import RunHeader
from cartoloop.map_output.output_folder import RunFolder, prepare_folder
from cartoloop.runs.end import Outcome, Saved, completed, save_outcome, timed
from cartoloop.runs.events import map_events
from cartoloop.runs.journal import (
    InterruptedRun,
    RunJournal,
    begin_journal,
    interrupted_run,
    nothing_to_resume,
    options_document,
    resume_journal,
)
from cartoloop.runs.observer import RunObserver
from cartoloop.session import named
from cartoloop.stop_request import StopRequest

if TYPE_CHECKING:
    from cartoloop.map_data import MapData
    from cartoloop.map_output.picture import Layer
    from cartoloop.readers import Log, ReadOptions
    from cartoloop.result import Result
    from cartoloop.runs.base import RunBase
    from cartoloop.sensor.pose import Pose


MIN_SHARE_OF_SCANS = 0.5
"""A run that maps a smaller share of a recording's scans has failed."""


def map_recording(
    recording: str | PathLike[str] | Sequence[str | PathLike[str]] | Log,
    config: Config | LoadedConfig | None = None,
    out: str | PathLike[str] | None = None,
    *,
    options: ReadOptions | None = None,
    layers: Collection[Layer] | None = None,
    observer: RunObserver | None = None,
    stop: StopRequest | None = None,
    overwrite: bool = False,
    onto: MapData | str | PathLike[str] | None = None,
    onto_pose: Pose | None = None,
) -> Result:
    """Map a recording and save the map; the report has name, times and skipped lines.

    Parameters
    ----------
    recording : path of a recording, of its parts in order, or a log that is open.
    config : by default the defaults.
    out : folder to save in; None: the map is not saved. A finished map in it is only replaced when
        the run comes to its end; until then, the map of this one is saved in a folder inside.
    options : how to read the recording; see `cartoloop.readers.open_log`.
    layers : drawn over the picture of the map; by default the trajectory.
    observer : is informed of the progress.
    stop : by which another thread or a signal handler can stop the run. Ctrl-C stops it anyway.
    overwrite : whether the map of another recording in `out` may be replaced.
    onto : a map, or its path, that the recording is added to as a session; see `Mapper`. `out` may
        be its folder: then it is replaced when the run comes to its end, and stays otherwise.
    onto_pose : where the robot is in it at first, see `Mapper`.

    Raises
    ------
    InputError
        The recording cannot be read, has no scan that can be mapped, or only a part of it could
        be read or mapped. What was mapped until then is saved.
    OutputError
        The folder `out` cannot be written, or holds the map of another recording, or another run
        writes there; where possible, raised before mapping starts.
    Interrupted
        The run was stopped; what was mapped until then is saved, unless it was stopped again.
    """
    from cartoloop.map_output.picture import DEFAULT_LAYERS, known_layers

    loaded = _loaded(config)
    drawn = DEFAULT_LAYERS if layers is None else known_layers(layers)
    out = None if out is None else as_path(out, "map_recording: out")
    log = _opened(recording, options, out if onto is None else None, overwrite)
    base = None
    if onto is not None:
        from cartoloop.runs.base import base_of_new_run

        base = base_of_new_run(onto, onto_pose, out, loaded.config, (log.name, log.fingerprint))
    run = _Run(log, loaded, drawn, observer or RunObserver(), stop or StopRequest(), base)
    if out is None:
        return _carried_out(run, None, None)
    folder = run.folder(out, overwrite=overwrite)
    folder.check()
    prepare_folder(folder.path)
    return _carried_out(run, folder, _new_journal(run, folder, options_document(options)))


def resume_recording(
    recording: str | PathLike[str] | Sequence[str | PathLike[str]] | Log,
    out: str | PathLike[str],
    config: Config | LoadedConfig | None = None,
    *,
    options: ReadOptions | None = None,
    layers: Collection[Layer] | None = None,
    observer: RunObserver | None = None,
    stop: StopRequest | None = None,
    onto: MapData | str | PathLike[str] | None = None,
) -> Result:
    """Go on with a run of `map_recording` that was interrupted: killed, stopped or failed.

    The result is the same as that of a run without interruption, to the last bit. A finished map in
    `out` is returned as it is.

    Parameters
    ----------
    recording : that of the run.
    out : the folder of the run.
    config, options, layers : as in `map_recording`; what is not given is as the run had it.
    observer, stop : as in `map_recording`.
    onto : the map that the run adds to, where it is not where it was.

    Raises
    ------
    InputError, Interrupted
        As `map_recording`; or the run was of another recording, or had other parameters, or the
        map that it adds to has changed.
    OutputError
        As `map_recording`; or there is nothing to resume.
    """
    from cartoloop.map_output.picture import known_layers
    from cartoloop.runs.base import base_of_resumed_run

    path = Path(as_path(out, "resume_recording: out"))
    observer, stop = observer or RunObserver(), stop or StopRequest()
    before = interrupted_run(path)
    loaded = None if config is None else _loaded(config)
    if before is not None:
        loaded, options = _as_before(before, loaded, options)
    overwrite = before is not None and before.header.overwrite
    log = _opened(recording, options, None, overwrite)
    if before is None:
        folder = RunFolder(path, log.name, log.fingerprint, overwrite)
        return _finished_map(folder, observer)
    before.check_recording(log.name, log.fingerprint)
    if (result := _result_of_ended(before, observer)) is not None:
        return result
    drawn = known_layers(before.header.layers if layers is None else layers)
    base = base_of_resumed_run(before, onto)
    run = _Run(log, loaded or before.loaded, drawn, observer, stop, base)
    folder = run.folder(path, overwrite=overwrite)
    folder.check()
    return _carried_out(run, folder, resume_journal(before, observer.journal_failed))


@dataclass(frozen=True)
class _Run:
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
        return RunFolder(path, *self.identity, overwrite, adds)


def _carried_out(run: _Run, folder: RunFolder | None, journal: RunJournal | None) -> Result:
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
    _raise_if_incomplete(replace(saved, outcome=outcome), log, _hint(journal))
    return outcome.result


def _new_journal(run: _Run, folder: RunFolder, options: Mapping[str, Any]) -> RunJournal:
    header = RunHeader(
        "map",
        folder.name,
        folder.fingerprint,
        run.loaded.config,
        run.loaded.origins,
        options,
        tuple(run.layers),
        folder.overwrite,
    )
    if run.base is not None:
        graph = run.base.content.graph
        header = replace(
            header,
            continues=True,
            first_node=graph.num_nodes,
            first_submap=graph.num_submaps,
            base=run.base.about,
        )
    return begin_journal(folder.path, header, run.observer.journal_failed)


def _as_before(
    run: InterruptedRun, loaded: LoadedConfig | None, options: ReadOptions | None
) -> tuple[LoadedConfig, ReadOptions]:
    """Return configuration and reading options of a run to be resumed; check what is given.

    How many threads search is not checked: the result does not depend on it.
    """
    config = run.loaded
    if loaded is not None:
        run.check_config(loaded)
        config = LoadedConfig(loaded.config, config.origins)
    before = run.read_options
    if options is not None:
        run.check_options(options)
    return config, before


def _finished_map(folder: RunFolder, observer: RunObserver) -> Result:
    """Return the finished map in a folder without an interrupted run.

    Raises
    ------
    OutputError
        There is none of this recording.
    """
    from cartoloop.result import load_map

    if not folder.is_finished():
        raise nothing_to_resume(folder.path)
    observer.already_finished(folder.path)
    return load_map(folder.path)


def _result_of_ended(run: InterruptedRun, observer: RunObserver) -> Result | None:
    """Return the map of a run that has replaced the one that it adds to, and was killed just then.

    Its journal is of no use any more, and is removed.
    """
    header = run.header
    folder = RunFolder(run.folder, header.name, header.fingerprint)
    if header.base is None or header.base.path != "." or not folder.is_finished():
        return None
    resume_journal(run, observer.journal_failed).remove()
    return _finished_map(folder, observer)


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


def _mapped(run: _Run, journal: RunJournal | None) -> Outcome:
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


def _reported(result: Result, run: _Run) -> Result:
    """Return a result whose report says all about the recording and the run."""
    log, (name, fingerprint) = run.log, run.identity
    messages = [problem.message for problem in log.problems]
    report = completed(result, name, log.skipped, messages, fingerprint=fingerprint)
    finished = report.finished and report.nodes > 0 and not _is_mostly_lost(result, log)
    return replace(
        result,
        report=timed(replace(report, finished=finished), run.start),
        sessions=named(result.sessions, log.name, log.fingerprint),
    )


def _loaded(config: Config | LoadedConfig | None) -> LoadedConfig:
    if isinstance(config, LoadedConfig):
        return config
    if config is not None:
        require_type(config, Config, "map_recording: config", "a cartoloop.Config")
    return LoadedConfig(config or Config(), {})


def _opened(
    recording: str | PathLike[str] | Sequence[str | PathLike[str]] | Log,
    options: ReadOptions | None,
    out: str | PathLike[str] | None,
    overwrite: bool,
) -> Log:
    """Return the log, opened if need be; before, check the folder to save in."""
    from cartoloop.readers import open_logs
    from cartoloop.readers.spool import regular_files

    if not isinstance(recording, str | PathLike | Sequence):
        if not hasattr(recording, "num_scans"):
            raise UsageError(
                f"map_recording: recording is {shown(recording)}: give a path, a list of paths, or "
                "what cartoloop.open_log returns"
            )
        return recording
    given = [recording] if isinstance(recording, str | PathLike) else recording
    if not given:
        raise UsageError("map_recording: recording is an empty list: give at least one path")
    files = regular_files([as_path(part, "recording") for part in given])
    if out is not None:
        folder_of(Path(out), files, overwrite=overwrite).check()
    return open_logs(files, options)


def folder_of(out: Path, files: Sequence[Path], *, overwrite: bool) -> RunFolder:
    """Return the folder for the map of a recording that is not open yet.

    Parameters
    ----------
    out : the folder.
    files : of the recording, in order.
    overwrite : whether the map of another recording may be replaced.
    """
    from cartoloop.readers.fingerprint import fingerprint, joint_fingerprint
    from cartoloop.readers.log import short_name

    name = " + ".join(short_name(file) for file in files)
    return RunFolder(out, name, joint_fingerprint([fingerprint(file) for file in files]), overwrite)


def _lost_scans(result: Result, log: Log) -> int:
    """Return how many scans of a recording could not be read, or not be mapped."""
    return log.num_lost_scans + result.report.input.scans - len(result.stamps)


def _is_mostly_lost(result: Result, log: Log) -> bool:
    num_mapped, num_lost = len(result.stamps), _lost_scans(result, log)
    return num_mapped < MIN_SHARE_OF_SCANS * (num_mapped + num_lost)


def _raise_if_incomplete(saved: Saved, log: Log, hint: str) -> None:
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
    if _is_mostly_lost(result, log):
        num_lost = _lost_scans(result, log)
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
