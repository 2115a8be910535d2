# SPDX-License-Identifier: Apache-2.0
"""``cartoloop map``: a recording to a floor plan."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cartoloop.cli.options import (
    ConfigOptions,
    PictureOptions,
    ReadingOptions,
    folder_of_map,
    parse_pose_deg,
)
from cartoloop.cli.view_command import ViewOptions, wait_for_stop
from cartoloop.plain_text import one_line
from cartoloop.readers.formats import format_names

if TYPE_CHECKING:
    from cartoloop.config_file import LoadedConfig
    from cartoloop.map_output.output_folder import RunFolder
    from cartoloop.map_output.picture import Layer
    from cartoloop.readers import Log
    from cartoloop.readers.read_options import ReadOptions
    from cartoloop.result import Result
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
    resume: Annotated[
        Path | None,
        typer.Option(
            "--resume",
            metavar="OUT",
            help="Go on with the interrupted run in this folder, with the options that it had.",
        ),
    ] = None

    @property
    def folder(self) -> Path:
        """The folder for the map.

        Raises
        ------
        typer.BadParameter
            Two are given.
        """
        if self.resume is None:
            return self.out or folder_of_map(self.onto) or default_folder(self.logs[0])
        if self.out is not None and self.out != self.resume:
            raise typer.BadParameter(
                "names the folder of the map already; leave -o out", param_hint="--resume"
            )
        return self.resume


def map_command(options: MapOptions) -> None:
    """Map a recording: a text log, a ROS 1 bag or a ROS 2 recording."""
    layers: tuple[Layer, ...] | None = options.layers
    options.require_view()
    read_options = options.read_options()
    loaded = _loaded(options)
    if options.at is not None and options.onto is None and options.resume is None:
        raise typer.BadParameter("is a pose in the map of --onto: give that too", param_hint="--at")
    pose = parse_pose_deg(options.at, "--at")
    out = options.folder

    from cartoloop.map_file.read import require_map
    from cartoloop.readers import open_logs
    from cartoloop.readers.spool import regular_files
    from cartoloop.runs.opening import folder_of

    files = regular_files(options.logs)
    folder = folder_of(out, files, overwrite=options.overwrite)
    if options.resume is None:
        if options.onto is None:  # otherwise when that map is open, whose name the new one shares
            folder.check()
        else:
            require_map(options.onto)
        _note_interrupted(folder)
    else:
        before = _as_before(options, loaded, read_options, folder, pose)
        if before is None:
            typer.echo(
                f"{one_line(str(out))} holds the finished map of this recording: nothing to resume"
            )
            return
        loaded, read_options = before
        layers = None if options.draw == PictureOptions.draw else layers

    from cartoloop.cli.mapping import compilation_notice, map_log, require_good
    from cartoloop.cli.session_lines import require_joined

    with compilation_notice():
        log = open_logs(files, read_options)
    typer.echo(log.description)
    if options.out is None:
        typer.echo(f"output         {one_line(str(out))}")
    run = partial(
        map_log,
        log,
        loaded,
        out,
        layers,
        options=read_options,
        overwrite=options.overwrite,
        resume=options.resume is not None,
        onto=options.onto,
        pose=pose,
    )
    result = _viewed(run, options, log, loaded) if options.view else run()
    require_joined(result)
    require_good(result.report, options.strict)


def _viewed(
    run: Callable[..., Result], options: MapOptions, log: Log, loaded: LoadedConfig
) -> Result:
    """Map with a view, which stays open after the run until the user ends it."""
    view = options.open_view(log.name, loaded.config, log.num_scans, log.duration)
    try:
        result = run(view=view)
        if view.failure is not None:
            typer.echo(f"warning: the view failed: {view.failure}", err=True)
        else:
            wait_for_stop(f"view           {view.url}")
    finally:
        view.close()
    return result


def _as_before(
    options: MapOptions,
    loaded: LoadedConfig,
    read_options: ReadOptions,
    folder: RunFolder,
    pose: Pose | None,
) -> tuple[LoadedConfig, ReadOptions] | None:
    """Return configuration and reading options of the interrupted run; None if it is finished.

    Raises
    ------
    CartoloopError
        There is none, it is of another recording, or it had other options than are given.
    """
    from cartoloop.config_file import LoadedConfig
    from cartoloop.readers.read_options import ReadOptions
    from cartoloop.runs.journal import interrupted_run, nothing_to_resume

    run = interrupted_run(folder.path)
    if run is None:
        if folder.is_finished():
            return None
        raise nothing_to_resume(folder.path)
    run.check_recording(folder.name, folder.fingerprint)
    if options.settings or options.config or options.lifelong:
        run.check_config(loaded)
    if pose is not None:
        run.check_pose(pose)
    if read_options != ReadOptions():
        run.check_options(read_options)
    config = run.header.config
    if options.threads is not None:
        slam = config.global_slam.model_copy(update={"num_threads": options.threads})
        config = config.model_copy(update={"global_slam": slam})
    return LoadedConfig(config, dict(run.header.origins)), run.read_options


def _note_interrupted(folder: RunFolder) -> None:
    """Say that there is a run to be resumed, which a new one replaces."""
    if folder.has_journal:
        path = one_line(str(folder.path))
        typer.echo(
            f"{path} holds an interrupted run, which this one replaces; --resume {path} would go "
            "on with it",
            err=True,
        )


def _loaded(options: MapOptions) -> LoadedConfig:
    """Return the configuration, with what options of their own say."""
    if not options.lifelong:
        return options.load()
    if options.onto is None and options.resume is None:
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
    stem = "".join(sign if sign.isprintable() else "_" for sign in Path(name).stem.strip(".-"))
    return Path(f"{stem or 'recording'}-map")
