# SPDX-License-Identifier: Apache-2.0
"""A run over a recording that was interrupted goes on, and ends as if it had not been."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from cartoloop.arguments import as_path
from cartoloop.config_file import LoadedConfig
from cartoloop.map_output.output_folder import RunFolder
from cartoloop.runs.journal import (
    InterruptedRun,
    interrupted_run,
    nothing_to_resume,
    resume_journal,
)
from cartoloop.runs.observer import RunObserver
from cartoloop.runs.opening import loaded_config, opened_log
from cartoloop.runs.run import Run, carry_out
from cartoloop.stop_request import StopRequest

if TYPE_CHECKING:
    from cartoloop.config import Config
    from cartoloop.map_data import MapData
    from cartoloop.map_output.picture import Layer
    from cartoloop.readers import Log, ReadOptions
    from cartoloop.result import Result


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
    loaded = None if config is None else loaded_config(config)
    if before is not None:
        loaded, options = _as_before(before, loaded, options)
    overwrite = before is not None and before.header.overwrite
    log = opened_log(recording, options, None, overwrite)
    if before is None:
        folder = RunFolder(path, log.name, log.fingerprint, overwrite)
        return _finished_map(folder, observer)
    before.check_recording(log.name, log.fingerprint)
    if (result := _result_of_ended(before, observer)) is not None:
        return result
    drawn = known_layers(before.header.layers if layers is None else layers)
    base = base_of_resumed_run(before, onto)
    run = Run(log, loaded or before.loaded, drawn, observer, stop, base)
    folder = run.folder(path, overwrite=overwrite)
    folder.check()
    return carry_out(run, folder, resume_journal(before, observer.journal_failed))


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
