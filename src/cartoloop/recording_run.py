# SPDX-License-Identifier: Apache-2.0
"""One call from a recording to a saved map: read, map, complete the report, save.

>>> from cartoloop.recording_run import map_recording
>>> result = map_recording("intel.clf.gz", out="intel")
>>> result.report.wall_s, result.report.skipped
"""

from __future__ import annotations

import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from cartoloop.arguments import as_path, require_type, shown
from cartoloop.config import Config
from cartoloop.config_file import LoadedConfig, config_hash
from cartoloop.errors import InputError, Interrupted, UsageError
from cartoloop.runtime.process_memory import release_unused_memory
from cartoloop.stop_request import StopRequest

if TYPE_CHECKING:
    from cartoloop.map_output.picture import Layer
    from cartoloop.mapper import Mapper
    from cartoloop.readers import Log, ReadOptions
    from cartoloop.report import Report
    from cartoloop.result import Result
    from cartoloop.sensor.events import SensorEvent


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

    def saved(self, result: Result, failure: Exception | None) -> None:
        """The map was saved, and the report has its final times."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a run ended.

    Attributes
    ----------
    result : the map, or what was mapped until the end of an incomplete run.
    failure : the exception that ended the run early, or None.
    is_complete : whether the last pass was done: neither a failure nor a stop ended the run.
    """

    result: Result
    failure: Exception | None
    is_complete: bool


def map_recording(
    recording: str | PathLike[str] | Sequence[str | PathLike[str]] | Log,
    config: Config | LoadedConfig | None = None,
    out: str | PathLike[str] | None = None,
    *,
    options: ReadOptions | None = None,
    layers: Collection[Layer] | None = None,
    observer: RunObserver | None = None,
    stop: StopRequest | None = None,
) -> Result:
    """Map a recording and save the map; the report has name, times and skipped lines.

    Parameters
    ----------
    recording : path of a recording, of its parts in order, or a log that is open.
    config : by default the defaults.
    out : folder to save in; None: the map is not saved.
    options : how to read the recording; see `cartoloop.readers.open_log`.
    layers : drawn over the picture of the map; by default the trajectory.
    observer : is informed of the progress.
    stop : by which another thread or a signal handler can stop the run. Ctrl-C stops it anyway.

    Raises
    ------
    InputError
        The recording cannot be read, has no scan that can be mapped, or only a part of it could
        be read. What was mapped until then is saved.
    OutputError
        The folder `out` cannot be written; where possible, raised before mapping starts.
    Interrupted
        The run was stopped; what was mapped until then is saved.
    """
    from cartoloop.map_output.picture import DEFAULT_LAYERS, known_layers
    from cartoloop.map_output.save import prepare_folder, save, save_report

    loaded = _loaded(config)
    layers = None if layers is None else known_layers(layers)
    out = None if out is None else as_path(out, "map_recording: out")
    observer, stop = observer or RunObserver(), stop or StopRequest()
    log = _opened(recording, options)
    start = time.perf_counter()
    folder = None if out is None else prepare_folder(out)

    # Loads the kernels: part of the measured time.
    from cartoloop.first_pass import calibrate
    from cartoloop.mapper import Mapper

    observer.started(log.num_scans)
    calibration = calibrate(log, loaded.config, stop)
    outcome = run(log, Mapper(loaded.config, calibration=calibration), observer, stop)
    messages = [problem.message for problem in log.problems]
    result = replace(
        outcome.result,
        report=timed(completed(outcome.result, log.name, log.skipped, messages), start),
    )
    observer.mapped(result, outcome.failure)
    if folder is not None:
        release_unused_memory()
        try:
            chosen = DEFAULT_LAYERS if layers is None else layers
            save(result, folder, layers=chosen, origins=loaded.origins)
        except KeyboardInterrupt as interrupt:
            raise Interrupted(f"stopped at once; files in {folder} may be missing") from interrupt
        result = replace(result, report=timed(result.report, start))
        save_report(result.report, folder)
    observer.saved(result, outcome.failure)
    # A stop during saving is reported too, so that no further step follows.
    is_complete = outcome.is_complete and not stop.made
    _raise_if_incomplete(Outcome(result, outcome.failure, is_complete), log, folder)
    return result


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


def completed(
    result: Result, name: str, also_skipped: Mapping[str, int], problems: Sequence[str] = ()
) -> Report:
    """Return the report of a result, completed by the reader's findings.

    Parameters
    ----------
    result : of the mapper.
    name : of the recording or the live source.
    also_skipped : number of lines or messages that the reader skipped, by reason.
    problems : of the recording, one line each.
    """
    report = result.report
    skipped = dict(report.skipped)
    for reason, count in also_skipped.items():
        skipped[reason] = skipped.get(reason, 0) + count
    extra = dict(report.extra)
    from cartoloop.report import odometry_warning  # loads the kernels

    warning = odometry_warning(report)
    problems = [*problems, warning] if warning else list(problems)
    if problems:
        extra["problems"] = problems
    return replace(
        report,
        input=replace(report.input, name=name),
        skipped=skipped,
        config_hash=config_hash(result.config),
        extra=extra,
    )


def timed(report: Report, start: float) -> Report:
    """Return the report with the time and memory that the run took since `start` [s]."""
    from cartoloop.runtime.process_memory import peak_memory_mb

    wall_s = time.perf_counter() - start
    return replace(
        report,
        wall_s=wall_s,
        cpu_s=time.process_time(),
        peak_memory_mb=peak_memory_mb(),
        real_time_factor=report.input.duration_s / wall_s,
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
) -> Log:
    from cartoloop.readers import open_logs

    if isinstance(recording, str | PathLike):
        return open_logs([Path(recording)], options)
    if isinstance(recording, Sequence):
        if not recording:
            raise UsageError("map_recording: recording is an empty list: give at least one path")
        return open_logs(recording, options)
    if not hasattr(recording, "num_scans"):
        raise UsageError(
            f"map_recording: recording is {shown(recording)}: give a path, a list of paths, or "
            "what cartoloop.open_log returns"
        )
    return recording


def _raise_if_incomplete(outcome: Outcome, log: Log, folder: Path | None) -> None:
    """Raise the error of a run that did not map the whole recording."""
    where = "" if folder is None else f" in {folder}"
    report = outcome.result.report
    if outcome.failure is not None:
        raise outcome.failure
    if not outcome.is_complete:
        kept = f"; the map of these is{where}" if where else "; their map was not saved"
        raise Interrupted(f"stopped after {len(outcome.result.stamps)} scans{kept}")
    if report.nodes == 0:
        raise InputError(
            f"{log.name}: no scan has enough returns to be mapped, the map{where} is empty; "
            "`cartoloop doctor` shows what the recording contains"
        )
    if lost := next((p.message for p in log.problems if p.severity == "error"), None):
        raise InputError(f"the map{where} covers a part of the recording: {lost}")
