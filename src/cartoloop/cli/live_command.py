# SPDX-License-Identifier: Apache-2.0
"""``cartoloop live``: a floor plan while the robot drives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import typer

from cartoloop.cli.commands import GroupedCommand
from cartoloop.cli.options import (
    MESSAGES,
    ConfigOptions,
    LiveSourceOptions,
    PictureOptions,
    folder_of_map,
    parse_pose_deg,
)
from cartoloop.cli.view_command import (
    ViewHostOption,
    ViewOption,
    ViewPortOption,
    require_view,
)

if TYPE_CHECKING:
    from cartoloop.config_file import LoadedConfig


class LiveCommand(GroupedCommand):
    """``cartoloop live``, where --host once meant the messages, and elsewhere the view."""

    renamed: ClassVar[Mapping[str, str]] = {"--host": "--source-host", "--port": "--view-port"}


@dataclass(frozen=True, kw_only=True)
class LiveCommandOptions(ConfigOptions, PictureOptions, LiveSourceOptions):
    """Options of ``cartoloop live``."""

    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE",
            help="- (standard input), tcp://127.0.0.1:PORT, ws://127.0.0.1:PORT, ros2:, or a "
            "CARMEN log that is being written.",
        ),
    ]
    out: Annotated[
        Path | None,
        typer.Option(
            "-o", "--out", metavar="OUT", help="Folder for the map; with --onto, by default MAP."
        ),
    ] = None
    onto: Annotated[
        Path | None,
        typer.Option(
            "--onto",
            metavar="MAP",
            help="Add the drive to a map as a session. The robot is searched for in it; while it "
            "is not found, the session is kept apart. If it never is, the status is 4.",
        ),
    ] = None
    lifelong: Annotated[
        bool,
        typer.Option(
            "--lifelong",
            help="With --onto or --resume: where the drive shows a place again, older submaps and "
            "scans are removed in the end, and furniture that was moved fades.",
        ),
    ] = False
    resume: Annotated[
        Path | None,
        typer.Option(
            "--resume",
            metavar="OUT",
            help="Continue the map in this folder, of a run that ended or was interrupted; the "
            "same as --onto OUT.",
        ),
    ] = None
    at: Annotated[
        str | None,
        typer.Option(
            "--at",
            metavar="X,Y,DEG",
            help="Where the robot is in that map at first [m, m, deg], to a metre or two and 20 "
            "degrees, or end: where it was last.",
        ),
    ] = None
    poses: Annotated[
        str | None,
        typer.Option(
            metavar="FILE",
            help="Write the pose of each scan at once, as JSON; - prints it.",
            rich_help_panel=MESSAGES,
        ),
    ] = None
    view: ViewOption = False
    view_host: ViewHostOption = None
    view_port: ViewPortOption = None


def live_command(options: LiveCommandOptions) -> None:
    """Map the messages of a robot while it drives; their formats are in docs/live.md."""
    layers = options.layers
    require_view(options.view, view_host=options.view_host, view_port=options.view_port)
    messages = options.message_options()
    loaded: LoadedConfig | None = options.load()
    out = _folder(options)
    starts_at_end = options.at == "end"
    start = None if starts_at_end else parse_pose_deg(options.at, "--at")
    onto = options.resume or options.onto
    if onto is not None and not (options.settings or options.config):
        loaded = None

    from cartoloop.cli.live_mapping import map_source, poses_stream
    from cartoloop.cli.mapping import require_good
    from cartoloop.cli.session_lines import require_joined
    from cartoloop.map_file.read import require_map

    if onto is not None:
        require_map(onto)
    source = options.make_source(options.source)
    with poses_stream(options.poses, options.source) as poses:
        from cartoloop.live.live_run import LiveOptions

        result = map_source(
            source,
            loaded,
            out,
            LiveOptions(
                messages,
                poses=poses,
                start=start,
                starts_at_end=starts_at_end,
            ),
            layers,
            (options.view_host, options.view_port) if options.view else None,
            is_quiet=options.poses == "-",
            overwrite=options.overwrite,
            onto=onto,
            lifelong=options.lifelong,
        )
    require_joined(result)
    require_good(result.report, options.strict)


def _folder(options: LiveCommandOptions) -> Path:
    """Return the folder for the map.

    Raises
    ------
    typer.BadParameter
        None is given, or two.
    """
    if options.resume is not None:
        for given, name in ((options.out, "-o"), (options.onto, "--onto")):
            if given is not None and given != options.resume:
                raise typer.BadParameter(
                    f"names the folder of the map already; leave {name} out", param_hint="--resume"
                )
        return options.resume
    if options.onto is None:
        for is_given, name in ((options.at is not None, "--at"), (options.lifelong, "--lifelong")):
            if is_given:
                raise typer.BadParameter(
                    "is about a map that is added to: give it with --onto or --resume",
                    param_hint=name,
                )
    if (out := options.out or folder_of_map(options.onto)) is None:
        raise typer.BadParameter("give the folder for the map", param_hint="--out")
    return out
