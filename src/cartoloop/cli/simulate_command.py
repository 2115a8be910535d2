# SPDX-License-Identifier: Apache-2.0
"""``cartoloop simulate``: a recording with known truth."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cartoloop.errors import ConfigError

if TYPE_CHECKING:
    from cartoloop.simulation import Recording

TRUTH = "Ground truth"
"""Group of options in the help."""


@dataclass(frozen=True, kw_only=True)
class SimulateOptions:
    """Options of ``cartoloop simulate``."""

    world: Annotated[
        str, typer.Argument(metavar="WORLD", help="office, corridor, ring, museum or flat.")
    ]
    out: Annotated[
        Path,
        typer.Option(
            "-o",
            "--out",
            metavar="LOG",
            help="Recording to write: .log or .clf (CARMEN log, compressed with .gz), or .bag "
            "(ROS 1).",
        ),
    ]
    seed: Annotated[int, typer.Option(min=0, help="Seed of the world and of all noise.")] = 0
    lidar: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Scanner: sick, sick-180, wide, backpack or lds; by default the world's own.",
        ),
    ] = None
    odometry: Annotated[
        bool | None,
        typer.Option(
            "--odometry/--no-odometry",
            show_default=False,
            help="With or without wheel odometry; museum and flat have none by default.",
        ),
    ] = None
    tilt_deg: Annotated[
        float,
        typer.Option(
            metavar="DEG",
            help="Carried by a walking person: largest roll and pitch [deg]; needs a .bag.",
        ),
    ] = 0.0
    distort: Annotated[
        bool,
        typer.Option(
            "--distort", help="Measure the beams one after the other, while moving; needs a .bag."
        ),
    ] = False
    duration: Annotated[
        float | None,
        typer.Option(metavar="SECONDS", help="Duration [s]; by default until the route ends."),
    ] = None
    truth: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Write the true poses as a TUM file.", rich_help_panel=TRUTH
        ),
    ] = None
    relations: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Write true relative poses, for 'evaluate relations'.",
            rich_help_panel=TRUTH,
        ),
    ] = None
    lines: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Write true distances between walls, 'x1 y1 x2 y2 length' [m], map frame; "
            "flat only.",
            rich_help_panel=TRUTH,
        ),
    ] = None


def simulate_command(options: SimulateOptions) -> None:
    """Simulate a robot's drive: scans, and odometry, with noise."""
    files = (options.out, options.truth, options.relations, options.lines)
    paths = [path.resolve() for path in files if path is not None]
    if twice := sorted(path for path in set(paths) if paths.count(path) > 1):
        raise ConfigError(f"{twice[0]}: cannot hold two outputs: give each a name of its own")

    recording = _recording(options)
    written: list[Path] = []
    for path, write in (
        (options.lines, recording.write_tape_lines),  # first, as not every world has any
        (options.out, recording.write_log),
        (options.truth, recording.write_truth),
        (options.relations, recording.write_relations),
    ):
        if path is not None:
            write(path)
            written.append(path)
    seconds = recording.stamps[-1] - recording.stamps[0]
    typer.echo(f"{len(recording.stamps)} scans, {seconds:.0f} s: {', '.join(map(str, written))}")


def _recording(options: SimulateOptions) -> Recording:
    """Return the simulated recording; bags have an IMU as well."""
    from cartoloop.simulation import carry, make_lidar, make_world, simulate
    from cartoloop.simulation.recording import log_format

    file_format = log_format(options.out)
    world = make_world(options.world, options.seed)
    scanner = None if options.lidar is None else make_lidar(options.lidar)
    if file_format == "bag":
        return carry(
            world,
            scanner,
            tilt=math.radians(options.tilt_deg),
            distort=options.distort,
            with_odometry=options.odometry,
            seed=options.seed,
            duration=options.duration,
        )
    if options.tilt_deg or options.distort:
        raise ConfigError(
            f"{options.out}: a CARMEN log holds no IMU and no time of beams: give --out a name "
            "that ends in .bag"
        )
    return simulate(
        world,
        scanner,
        with_odometry=options.odometry,
        seed=options.seed,
        duration=options.duration,
    )
