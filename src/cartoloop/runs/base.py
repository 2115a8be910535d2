# SPDX-License-Identifier: Apache-2.0
"""The map that a run adds a session to: opened, checked, and found again when it is resumed."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from cartoloop.arguments import as_path
from cartoloop.config import Config
from cartoloop.errors import InputError, OutputError
from cartoloop.journal.frames import FILE_NAME as JOURNAL
from cartoloop.map_data import MapData
from cartoloop.map_file.file_set import repair_file_set
from cartoloop.map_file.map_digest import map_digest
from cartoloop.map_file.read import map_file_of
from cartoloop.map_file.run_header import BaseOfRun
from cartoloop.map_output.output_folder import MapState, map_state
from cartoloop.map_sessions import earlier_maps
from cartoloop.runs.journal import InterruptedRun
from cartoloop.sensor.pose import Pose


@dataclass(frozen=True, slots=True)
class RunBase:
    """The map that a run adds a session to.

    Attributes
    ----------
    content : the map.
    about : what the journal of the run says about it.
    state : of the file that it was read from, where that is in the folder of the run.
    """

    content: MapData
    about: BaseOfRun
    state: MapState | None = None

    @property
    def is_in_folder(self) -> bool:
        """Whether the map is in the folder of the run, and is replaced in the end."""
        return self.about.path == "."


def base_of_new_run(
    onto: MapData | str | PathLike[str],
    pose: Pose | None,
    out: Path | None,
    config: Config,
    recording: tuple[str, str],
) -> RunBase:
    """Return the map that a run adds to, given it or its path.

    Parameters
    ----------
    pose : where the robot is in it at first, if that is known.
    out : folder of the run, or None.
    config : that the session is mapped with.
    recording : name and fingerprint of what is added.

    Raises
    ------
    InputError
        The map cannot be read.
    OutputError
        It is that of an interrupted run in `out`, whose journal would be replaced.
    UsageError
        It cannot be added to with this configuration.
    """
    path = path_of_base(onto, out)
    state = None if out is None or path != "." else _state_of(out)
    content = _opened(onto, config)
    if path == "." and map_file_of(as_path(onto, "onto")).name == JOURNAL:
        raise OutputError(
            f"{out}: holds an interrupted run and no map yet; go on with that first, or choose "
            "another output folder"
        )
    digest = "" if out is None else map_digest(content)
    return RunBase(content, BaseOfRun(path, digest, recording, pose), state)


def has_recording(content: MapData, fingerprint: str) -> bool:
    """Return whether a recording is in a map already: its scans would be in it twice."""
    return fingerprint != "" and any(each.fingerprint == fingerprint for each in content.sessions)


def base_of_resumed_run(
    run: InterruptedRun, onto: MapData | str | PathLike[str] | None
) -> RunBase | None:
    """Return the map that an interrupted run adds to; None if it makes a new one.

    Parameters
    ----------
    onto : the map, or its path, where it is not where it was; None: it is.

    Raises
    ------
    InputError
        It is not there, or not as it was.
    """
    about = run.header.base
    if about is None:
        if onto is not None:
            raise InputError(
                f"{run.folder}: the interrupted run does not add to a map: leave --onto out"
            )
        return None
    place = about.place(run.folder)
    if onto is None and (place is None or not place.exists()):
        where = "" if place is None else f" ({place})"
        raise InputError(
            f"{run.folder}: the map that the interrupted run adds to{where} is not there any more: "
            "give it with --onto"
        )
    given = place if onto is None else onto
    assert given is not None
    state = _state_of(run.folder)
    content = _opened(given, run.header.config)
    if map_digest(content) != about.digest:
        name = "the map" if isinstance(given, MapData) else given
        journal = run.folder / JOURNAL
        raise InputError(
            f"{run.folder}: {name} is not the map any more that the interrupted run adds to; "
            f"`cartoloop merge {name} {journal} -o NEW` joins what it mapped with it as it is now"
        )
    return RunBase(content, about, state)


def path_of_base(onto: MapData | str | PathLike[str], out: Path | None) -> str:
    """Return where a map that is added to is, as the journal of a run in `out` has it."""
    if isinstance(onto, MapData):
        return ""
    return "." if is_same_folder(onto, out) else str(as_path(onto, "onto").absolute())


def is_same_folder(onto: object, out: str | PathLike[str] | None) -> bool:
    """Return whether a map that is added to is in the folder that the new one is saved in."""
    if out is None or not isinstance(onto, str | PathLike):
        return False
    given: str | PathLike[str] = onto
    path = Path(given)
    return (path.parent if path.is_file() else path).resolve() == Path(out).resolve()


def _state_of(folder: Path) -> MapState:
    """Return the state of the map in a folder, after a replacement that was cut short."""
    repair_file_set(folder)
    return map_state(folder)


def _opened(onto: MapData | str | PathLike[str], config: Config) -> MapData:
    """Return the map that is given; checked, so that nothing is begun that cannot go on."""
    earlier = earlier_maps(onto, config)
    _ = earlier.mapped
    [content] = earlier.maps
    return content
