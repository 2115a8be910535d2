# SPDX-License-Identifier: Apache-2.0
"""One call from a recording to a saved map: read, map, complete the report, save.

>>> from cartoloop.recording_run import map_recording
>>> result = map_recording("intel.clf.gz", out="intel")
>>> result.report.wall_s, result.report.skipped
"""

from __future__ import annotations

import time
from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import partial
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from cartoloop.arguments import as_path, require_type, shown
from cartoloop.config import Config
from cartoloop.config_file import LoadedConfig
from cartoloop.errors import InputError, Interrupted, UsageError
from cartoloop.map_output.output_folder import RunFolder, prepare_folder
from cartoloop.run_end import Outcome, Saved, completed, save_outcome, timed
from cartoloop.session import named
from cartoloop.stop_request import StopRequest

if TYPE_CHECKING:
    from cartoloop.map_data import MapData
    from cartoloop.map_output.picture import Layer
    from cartoloop.mapper import Mapper
    from cartoloop.readers import Log, ReadOptions
    from cartoloop.result import Result
    from cartoloop.sensor.events import SensorEvent
    from cartoloop.sensor.pose import Pose


MIN_SHARE_OF_SCANS = 0.5
"""A run that maps a smaller share of a recording's scans has failed."""


class RunObserver:
    """Callbacks of a run, all in the mapping thread; this one ignores them all."""

    def started(self, num_scans: int) -> None:
        """The recording was opened and has `num_scans` scans."""

    def before_event(self, mapper: Mapper, event: SensorEvent) -> None:
        """`event` is added next."""

    def after_event(self, mapper: Mapper, event: SensorEvent) -> None:
        """`event` was added."""

    def finishing(self, mapper: Mapper, stage: str | None) -> None:
        """The last pass begins (`stage` None), or the stage of it that is named."""

    def mapped(self, result: Result, failure: Exception | None) -> None:
        """The map is complete, or as it was when `failure` ended the run; it is saved next."""

    def saving(self, folder: Path) -> None:
        """The map is saved in `folder` next: the one asked for, or one inside."""

    def saved(self, result: Result, failure: Exception | None) -> None:
        """The map was saved, and the report has its final times."""


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
        The folder `out` cannot be written, or holds the map of another recording; where possible,
        raised before mapping starts.
    Interrupted
        The run was stopped; what was mapped until then is saved, unless it was stopped again.
    """
    from cartoloop.map_output.picture import DEFAULT_LAYERS, known_layers
    from cartoloop.map_sessions import map_of

    loaded = _loaded(config)
    layers = None if layers is None else known_layers(layers)
    out = None if out is None else as_path(out, "map_recording: out")
    observer, stop = observer or RunObserver(), stop or StopRequest()
    overwrite = overwrite or is_same_folder(onto, out)
    log = _opened(recording, options, out, overwrite)
    start = time.perf_counter()
    base = None if onto is None else map_of(onto, "map_recording: onto")
    name, fingerprint = _identity(base, log)
    folder = None
    if out is not None:
        folder = RunFolder(Path(out), name, fingerprint, overwrite)
        folder.check()
        prepare_folder(folder.path)
    try:
        outcome = _mapped(log, loaded, observer, stop, base, onto_pose)
        if not outcome.is_complete and outcome.failure is None and not len(outcome.result.stamps):
            raise Interrupted("stopped before the first scan: nothing was saved")
        result = _reported(outcome.result, log, start, name, fingerprint)
        outcome = replace(outcome, result=result)
        observer.mapped(outcome.result, outcome.failure)
        saved = Saved(outcome, None, "")
        if folder is not None:
            drawn = DEFAULT_LAYERS if layers is None else layers
            saved = save_outcome(
                outcome, folder, drawn, loaded.origins, observer.saving, start, stop
            )
    except KeyboardInterrupt as interrupt:
        raise Interrupted("stopped at once: nothing was saved") from interrupt
    # A stop during saving is reported too, so that no further step follows.
    outcome = replace(saved.outcome, is_complete=outcome.is_complete and not stop.made)
    observer.saved(outcome.result, outcome.failure)
    _raise_if_incomplete(replace(saved, outcome=outcome), log)
    return outcome.result


def _mapped(
    log: Log,
    loaded: LoadedConfig,
    observer: RunObserver,
    stop: StopRequest,
    base: MapData | None,
    pose: Pose | None,
) -> Outcome:
    # Loads the kernels: part of the measured time.
    from cartoloop.first_pass import calibrate
    from cartoloop.mapper import Mapper

    observer.started(log.num_scans)
    calibration = calibrate(log, loaded.config, stop)
    mapper = Mapper(loaded.config, calibration=calibration, onto=base, onto_pose=pose)
    return run(log, mapper, observer, stop)


def is_same_folder(onto: object, out: str | PathLike[str] | None) -> bool:
    """Return whether a map that is added to is in the folder that the new one is saved in."""
    if out is None or not isinstance(onto, str | PathLike):
        return False
    given: str | PathLike[str] = onto
    path = Path(given)
    return (path if path.is_dir() else path.parent).resolve() == Path(out).resolve()


def _identity(base: MapData | None, log: Log) -> tuple[str, str]:
    """Return name and fingerprint of the map of a recording, or of one that it is added to."""
    if base is None:
        return log.name, log.fingerprint
    from cartoloop.readers.fingerprint import joint_fingerprint

    report = base.report
    return (
        f"{report.input.name} + {log.name}",
        joint_fingerprint([report.fingerprint, log.fingerprint]),
    )


def _reported(result: Result, log: Log, start: float, name: str, fingerprint: str) -> Result:
    """Return a result whose report says all about the recording and the run."""
    messages = [problem.message for problem in log.problems]
    report = completed(result, name, log.skipped, messages, fingerprint=fingerprint)
    finished = report.finished and report.nodes > 0 and not _is_mostly_lost(result, log)
    return replace(
        result,
        report=timed(replace(report, finished=finished), start),
        sessions=named(result.sessions, log.name, log.fingerprint),
    )


def run(log: Log, mapper: Mapper, observer: RunObserver, stop: StopRequest) -> Outcome:
    """Add all events of a log to a mapper and finish the map; close the mapper.

    A failure after the first scan ends the run but is not raised, so that the map can be kept.
    """
    failure: Exception | None = None
    is_stopped = False
    try:
        for event in log:
            if stop.made:
                break
            observer.before_event(mapper, event)
            mapper.add(event)
            observer.after_event(mapper, event)
        is_stopped = stop.made
    except KeyboardInterrupt:
        is_stopped = True
    except Exception as error:
        if mapper.num_scans == 0:
            mapper.close()
            raise
        failure = error
    if is_stopped or failure is not None:
        mapper.close()
        return Outcome(mapper.result(), failure, is_complete=False)
    return finish(mapper, observer, stop)


def finish(mapper: Mapper, observer: RunObserver, stop: StopRequest) -> Outcome:
    """Do the last pass and close the mapper; if it is stopped or fails, keep the map before it."""
    failure: Exception | None = None
    try:
        observer.finishing(mapper, None)
        with stop.at_once():
            return Outcome(mapper.finish(partial(observer.finishing, mapper)), None, True)
    except KeyboardInterrupt:
        pass
    except Exception as error:
        if mapper.num_scans == 0:
            raise
        failure = error
    finally:
        mapper.close()
    return Outcome(mapper.result(), failure, is_complete=False)


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


def _raise_if_incomplete(saved: Saved, log: Log) -> None:
    """Raise the error of a run that did not map the whole recording."""
    outcome, where = saved.outcome, saved.where
    result = outcome.result
    report = result.report
    if outcome.failure is not None:
        raise outcome.failure
    if not outcome.is_complete:
        kept = f"; the map of these is{where}" if where else "; their map was not saved"
        raise Interrupted(f"stopped after {len(result.stamps)} scans{kept}")
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
