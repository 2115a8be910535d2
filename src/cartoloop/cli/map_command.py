# SPDX-License-Identifier: Apache-2.0
"""``cartoloop map``: a recording to a floor plan."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cartoloop.cli.options import ConfigOptions, PictureOptions, ReadingOptions
from cartoloop.cli.view_command import ViewOptions, wait_for_stop
from cartoloop.readers.formats import format_names

if TYPE_CHECKING:
    from cartoloop.config_file import LoadedConfig
    from cartoloop.sensor.pose import Pose

_LOG_HELP = (
    "Recording; several are parts of one, in order. Its format is recognised by its content: "
    f"{', '.join(format_names())}, or a format of an installed package."
)


_WRAPPINGS = ("gz", "bz2", "xz", "zst", "zstd", "lz4", "active")
"""Endings that follow the ending of a recording."""


@dataclass(frozen=True, kw_only=True)
class MapOptions(ViewOptions, ReadingOptions, ConfigOptions, PictureOptions):
    """Options of ``cartoloop map``."""

    logs: Annotated[
        list[Path],
        typer.Argument(metavar="LOG", help=_LOG_HELP),
    ]
    out: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--out",
            metavar="OUT",
            help="Folder for the map; is created. By default it is named after the recording, "
            "x-map for x.bag, in the working directory; with --onto, it is MAP.",
        ),
    ] = None
    onto: Annotated[
        Path | None,
        typer.Option(
            "--onto",
            metavar="MAP",
            help="Add the recording to a map as a session. It finds its place by search; if it "
            "finds none, it is kept apart in the map, and the status is 4.",
        ),
    ] = None
    lifelong: Annotated[
        bool,
        typer.Option(
            "--lifelong",
            help="With --onto: where the recording shows a place again, older submaps and scans "
            "are removed, and furniture that was moved fades; the same as "
            "--set lifelong.enabled=true.",
        ),
    ] = False
    at: Annotated[
        str | None,
        typer.Option(
            "--at",
            metavar="X,Y,DEG",
            help="Where the robot is in MAP at first [m, m, deg], to a metre or two and 20 "
            "degrees; with --onto.",
        ),
    ] = None


def map_command(options: MapOptions) -> None:
    """Map a recording: a text log, a ROS 1 bag or a ROS 2 recording."""
    layers = options.layers
    options.require_view()
    read_options = options.read_options()
    loaded = _loaded(options)
    pose = parse_start(options.at, has_map=options.onto is not None)
    out = options.out or options.onto or default_folder(options.logs[0])

    from cartoloop.readers import open_logs
    from cartoloop.readers.spool import regular_files
    from cartoloop.recording_run import folder_of, is_same_folder

    files = regular_files(options.logs)
    overwrite = options.overwrite or is_same_folder(options.onto, out)
    if options.onto is None or overwrite:
        folder_of(out, files, overwrite=overwrite).check()

    from cartoloop.cli.mapping import compilation_notice, map_log, require_good
    from cartoloop.cli.session_lines import require_joined

    with compilation_notice():
        log = open_logs(files, read_options)
    typer.echo(log.description)
    if options.out is None:
        typer.echo(f"output         {out}")
    if not options.view:
        result = map_log(
            log, loaded, out, layers, overwrite=overwrite, onto=options.onto, pose=pose
        )
        require_joined(result)
        require_good(result.report, options.strict)
        return
    view = options.open_view(log.name, loaded.config, log.num_scans, log.duration)
    try:
        result = map_log(
            log, loaded, out, layers, view, overwrite=overwrite, onto=options.onto, pose=pose
        )
        if view.failure is not None:
            typer.echo(f"warning: the view failed: {view.failure}", err=True)
        else:
            wait_for_stop(f"view           {view.url}")
    finally:
        view.close()
    require_joined(result)
    require_good(result.report, options.strict)


def _loaded(options: MapOptions) -> LoadedConfig:
    """Return the configuration, with what options of their own say."""
    if not options.lifelong:
        return options.load()
    if options.onto is None:
        raise typer.BadParameter(
            "is about a map that is added to: give it with --onto", param_hint="--lifelong"
        )
    settings = [*(options.settings or ()), "lifelong.enabled=true"]
    return replace(options, settings=settings).load()


def default_folder(recording: Path) -> Path:
    """Return the folder for the map of a recording where none is given: x-map for x.bag.

    It is in the working directory, since recordings are often where nothing can be written.
    """
    name = recording.resolve().name if recording.name in ("", "..") else recording.name
    stem, dot, ending = name.rpartition(".")
    if dot and stem and ending.lower() in _WRAPPINGS:
        name = stem
    return Path(f"{Path(name).stem.strip('.-') or 'recording'}-map")


def parse_start(text: str | None, *, has_map: bool) -> Pose | None:
    """Return the pose of --at.

    Raises
    ------
    typer.BadParameter
        It is not three numbers, or there is no map that it is in.
    """
    if text is None:
        return None
    from cartoloop.sensor.pose import Pose

    if not has_map:
        raise typer.BadParameter("is a pose in the map of --onto: give that too", param_hint="--at")
    try:
        values = [float(word) for word in text.split(",")]
    except ValueError:
        values = []
    if len(values) != 3 or not all(map(math.isfinite, values)):
        raise typer.BadParameter(
            f"'{text}' is not X,Y,DEG, like 4.5,-2,90 (m, m, degrees)", param_hint="--at"
        )
    return Pose(values[0], values[1], math.radians(values[2]))
