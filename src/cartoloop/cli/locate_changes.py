# SPDX-License-Identifier: Apache-2.0
"""``cartoloop locate --changes`` and ``--update``: what differs from the map, taken over."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from cartoloop._jit import CompileWatch
    from cartoloop.cli.stop_signals import SignalStop
    from cartoloop.config_file import LoadedConfig
    from cartoloop.localisation.localizer import Localizer
    from cartoloop.readers import Log
    from cartoloop.sensor.pose import Pose

CHANGED = "Changed places"
"""Group of options in the help."""

NEVER_LOCATED_STATUS = 3
"""Exit status of a strict run, or of one that updates the map, if the robot was never located."""


@dataclass(frozen=True, kw_only=True)
class ChangeOptions:
    """Options about what differs from the map."""

    changes: Annotated[
        Path | None,
        typer.Option(
            "--changes",
            metavar="OUT",
            help="Compare the scans with the map: what has appeared and what is gone, as a table, "
            "and as changes.png and changes.json in the folder OUT.",
            rich_help_panel=CHANGED,
        ),
    ] = None
    update: Annotated[
        bool,
        typer.Option(
            "--update",
            help="Take over what differs: add the recording to MAP, as 'map --onto --lifelong' "
            "does, from where the robot was located. The map before is kept in MAP/before-update.",
            rich_help_panel=CHANGED,
        ),
    ] = False

    def check(self, map_: Path, *, is_live: bool) -> None:
        """Check what can be checked before anything is read.

        Raises
        ------
        CartoloopError
            A file cannot be written, or the map cannot be updated.
        typer.BadParameter
            A live source is to update the map.
        """
        if self.update and is_live:
            raise typer.BadParameter(
                "needs a recording: record the drive and localise the recording, or add the live "
                "drive with 'cartoloop live SOURCE --onto MAP --lifelong'",
                param_hint="--update",
            )
        if self.update:
            from cartoloop.runs.update import folder_to_update

            folder_to_update(map_)
        if self.changes is not None:
            from cartoloop.map_output.output_folder import prepare_folder

            prepare_folder(self.changes)

    def check_recording(self, map_: Path, log: Log) -> None:
        """Check that a recording is not in the map that it is to update.

        Raises
        ------
        InputError
            It is, or the map cannot be read.
        """
        if self.update:
            from cartoloop.runs.update import check_is_new, folder_to_update

            check_is_new(folder_to_update(map_), log)

    def report(self, localizer: Localizer, say: Callable[[str], None]) -> None:
        """Print and write what differs, if that is wanted."""
        if self.changes is None:
            return
        from cartoloop.localisation.changes.output import PICTURE, save_changes, table

        changes = localizer.changes()
        save_changes(changes, self.changes)
        say(table(changes))
        say(f"{'picture':<15}{self.changes / PICTURE}")


def update(
    map_: Path,
    log: Log,
    loaded: LoadedConfig,
    at: Pose | None,
    stop: SignalStop,
    compiler: CompileWatch,
    say: Callable[[str], None],
) -> None:
    """Add a recording that was localised to the map.

    Parameters
    ----------
    at : pose of the robot in the map at the first scan; None if it was never located.
    stop, compiler : of this run.
    say : prints a line.

    Raises
    ------
    Interrupted
        The run was stopped.
    typer.Exit
        The robot was never located, or the recording found no place in the map.
    """
    from cartoloop.cli.mapping import UnsavedDisplay
    from cartoloop.cli.session_lines import APART_STATUS, session_lines
    from cartoloop.errors import Interrupted
    from cartoloop.map_output.output_folder import map_state
    from cartoloop.runs.update import BEFORE, folder_to_update, mapped_onto, replace_map, why_apart

    folder = folder_to_update(map_)
    if stop.made:
        raise Interrupted(f"stopped: {folder} is as it was")
    if at is None:
        say(f"{'update':<15}none: the robot was never located; {folder} is as it was")
        raise typer.Exit(NEVER_LOCATED_STATUS)
    with UnsavedDisplay(log, stop, compiler) as display:
        state = map_state(folder)
        result = mapped_onto(folder, log, loaded, at, display, stop)
    if why := why_apart(result):
        say(f"{'update':<15}none: {why}; {folder} is as it was")
        raise typer.Exit(APART_STATUS)
    replace_map(folder, result, loaded, stop, state)
    say("\n".join(session_lines(result)))
    say(f"{'update':<15}{folder}; the map before is in {folder / BEFORE}")
