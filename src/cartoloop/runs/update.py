# SPDX-License-Identifier: Apache-2.0
"""A recording that was localised in a map is taken over into it, which then shows what has changed.

>>> from cartoloop.runs.update import update_map
>>> result = update_map("office-map", "drive.bag")

The recording becomes a session of the map, mapped in the lifelong mode from where the robot was
located: what it shows again gives way to it. The map before is kept in a folder inside.
"""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from cartoloop.arguments import as_path
from cartoloop.config import Config
from cartoloop.config_file import LoadedConfig
from cartoloop.errors import InputError, Interrupted, OutputError
from cartoloop.localisation.localizer import Localizer
from cartoloop.localisation.run import RunSummary, locate_events
from cartoloop.map_file.schema import FILE_NAME
from cartoloop.map_output.output_folder import MapState, map_state, prepare_folder
from cartoloop.map_output.save import save
from cartoloop.map_output.unfinished_file import unfinished_file
from cartoloop.report import Report
from cartoloop.result import load_map
from cartoloop.runs.base import has_recording
from cartoloop.runs.observer import RunObserver
from cartoloop.runs.recording import map_recording
from cartoloop.sensor.pose import Pose
from cartoloop.session import MAIN_PART
from cartoloop.stop_request import StopRequest

if TYPE_CHECKING:
    from cartoloop.readers import Log, ReadOptions
    from cartoloop.result import Result

BEFORE = "before-update"
"""Folder, inside that of a map, for the map file as it was before the last update."""


def folder_to_update(map_: str | PathLike[str]) -> Path:
    """Return the folder of a map that can be updated.

    Raises
    ------
    InputError
        It is a map of another program, or no map.
    OutputError
        It cannot be written.
    """
    path = Path(as_path(map_, "a map"))
    folder = path.parent if path.name == FILE_NAME else path
    if not (folder / FILE_NAME).is_file():
        raise InputError(
            f"{path}: cannot be updated: it has no {FILE_NAME}, as maps of 'cartoloop map' have"
        )
    return prepare_folder(folder)


def check_is_new(folder: Path, log: Log) -> None:
    """Check that a recording is not in a map yet.

    Raises
    ------
    InputError
        It is, or the map cannot be read.
    """
    if has_recording(load_map(folder), log.fingerprint):
        raise InputError(f"{folder}: cannot be updated by {log.name}: it is in the map already")


def update_map(
    map_: str | PathLike[str],
    recording: str | PathLike[str] | Log,
    config: Config | LoadedConfig | None = None,
    *,
    at: Pose | None = None,
    options: ReadOptions | None = None,
    observer: RunObserver | None = None,
    stop: StopRequest | None = None,
) -> Result:
    """Localise a recording in a map and take over what differs; return the map, which was saved.

    Parameters
    ----------
    map_ : folder of a map of ours.
    recording : path of a recording, or a log that is open.
    config : by default the defaults; the lifelong mode is enabled.
    at : pose of the robot in the map at the first scan, if it was localised already.
    options : how to read the recording.
    observer : is informed of the progress of mapping.
    stop : by which the run can be stopped.

    Raises
    ------
    InputError
        The robot was never located, the recording found no place in the map or is in it already, or
        something cannot be read. The map is as it was.
    OutputError
        The map cannot be written.
    Interrupted
        The run was stopped; the map is as it was.
    """
    folder, stop = folder_to_update(map_), stop or StopRequest()
    loaded = config if isinstance(config, LoadedConfig) else LoadedConfig(config or Config(), {})
    log = _opened(recording, options)
    check_is_new(folder, log)
    if at is None:
        summary = RunSummary()
        for answer in locate_events(Localizer(folder, loaded.config), log, stop):
            summary.add(answer)
        at = summary.first_pose
    if stop.made:
        raise Interrupted(f"stopped: {folder} is as it was")
    if at is None:
        raise InputError(f"{log.name}: the robot was never located in {folder}, which is as it was")
    state = map_state(folder)
    result = mapped_onto(folder, log, loaded, at, observer or RunObserver(), stop)
    if why := why_apart(result):
        raise InputError(f"{folder}: is as it was: {why}")
    replace_map(folder, result, loaded, stop, state)
    return result


def mapped_onto(
    folder: Path,
    log: Log,
    loaded: LoadedConfig,
    at: Pose,
    observer: RunObserver,
    stop: StopRequest,
) -> Result:
    """Return the map in a folder with a recording as its last session; nothing is saved."""
    config = loaded.config
    lifelong = config.lifelong.model_copy(update={"enabled": True})
    config = config.model_copy(update={"lifelong": lifelong})
    return map_recording(
        log,
        LoadedConfig(config, loaded.origins),
        observer=observer,
        stop=stop,
        onto=folder,
        onto_pose=at,
    )


def why_apart(result: Result) -> str:
    """Return why the last session found no place in the map, or "" if it did."""
    if result.sessions[-1].part == MAIN_PART:
        return ""
    joins = result.report.extra.get("joins", [])
    reasons = [join["why_not"] for join in joins if not join["joined"]]
    return f"the recording found no place in it: {reasons[-1] if reasons else 'nothing matched'}"


def replace_map(
    folder: Path, result: Result, loaded: LoadedConfig, stop: StopRequest, state: MapState
) -> None:
    """Save a map over the one it was made of, whose file is kept in `BEFORE`.

    Parameters
    ----------
    state : of the map in the folder, before it was read.

    Raises
    ------
    OutputError
        It cannot be written, or another program has changed the map; that is as it was.
    """

    def complete(report: Report) -> Report:
        if map_state(folder) != state:
            raise OutputError(
                f"{folder}: was changed by another program meanwhile; update it again"
            )
        return report

    kept = prepare_folder(folder / BEFORE) / FILE_NAME
    try:
        content = (folder / FILE_NAME).read_bytes()
    except OSError as error:
        raise OutputError(f"{folder / FILE_NAME}: cannot be read: {error.strerror}") from error
    with unfinished_file(kept) as unfinished:
        unfinished.write_bytes(content)
    save(result, folder, origins=loaded.origins, complete_report=complete, stop=stop)


def _opened(recording: str | PathLike[str] | Log, options: ReadOptions | None) -> Log:
    if not isinstance(recording, str | PathLike):
        return recording
    from cartoloop.readers import open_log

    return open_log(as_path(recording, "update_map: recording"), options)
