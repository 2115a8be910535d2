# SPDX-License-Identifier: Apache-2.0
"""``cartoloop simulate``: a recording with known truth."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from cartoloop.errors import ConfigError


def simulate_command(
    world: Annotated[
        str, typer.Argument(metavar="WORLD", help="office, corridor, ring, museum or flat.")
    ],
    out: Annotated[
        Path,
        typer.Option(
            "-o", "--out", metavar="LOG", help="CARMEN log, .gz compresses it; .bag: a ROS 1 bag."
        ),
    ],
    seed: Annotated[int, typer.Option(min=0, help="Of the world and of all noise.")] = 0,
    lidar: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="sick, sick-180, wide, backpack or lds instead of the world's own scanner.",
        ),
    ] = None,
    odometry: Annotated[
        bool | None,
        typer.Option(
            "--odometry/--no-odometry",
            show_default=False,
            help="With wheel odometry or without; museum and flat have none by default.",
        ),
    ] = None,
    tilt_deg: Annotated[
        float,
        typer.Option(metavar="DEG", help="Carried by a walker who sways so far; needs a .bag."),
    ] = 0.0,
    distort: Annotated[
        bool,
        typer.Option("--distort", help="Measure beam by beam while moving; needs a .bag."),
    ] = False,
    duration: Annotated[
        float | None, typer.Option(metavar="SECONDS", help="Instead of all of the way.")
    ] = None,
    truth: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the true poses as a TUM file.")
    ] = None,
    relations: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write true relative poses, as 'evaluate' reads them."),
    ] = None,
    lines: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Write true distances from wall to wall, 'x1 y1 x2 y2 length' in the map.",
        ),
    ] = None,
) -> None:
    """Simulate a robot's drive: scans, and odometry, with noise."""
    paths = [path.resolve() for path in (out, truth, relations, lines) if path is not None]
    if twice := sorted(path for path in set(paths) if paths.count(path) > 1):
        raise ConfigError(f"{twice[0]}: cannot hold two outputs: give each a name of its own")

    from cartoloop.simulation import carry, make_lidar, make_world, simulate
    from cartoloop.simulation.recording import log_format

    file_format = log_format(out)
    place = make_world(world, seed)
    scanner = None if lidar is None else make_lidar(lidar)
    if file_format == "bag":
        recording = carry(
            place,
            scanner,
            tilt=math.radians(tilt_deg),
            distort=distort,
            with_odometry=odometry,
            seed=seed,
            duration=duration,
        )
    else:
        if tilt_deg or distort:
            raise ConfigError(
                f"{out}: a CARMEN log holds no IMU and no time of beams: give --out a name that "
                "ends in .bag"
            )
        recording = simulate(place, scanner, with_odometry=odometry, seed=seed, duration=duration)
    written: list[Path] = []
    for path, write in (
        (lines, recording.write_tape_lines),  # first, as not every world has any
        (out, recording.write_log),
        (truth, recording.write_truth),
        (relations, recording.write_relations),
    ):
        if path is not None:
            write(path)
            written.append(path)
    seconds = recording.stamps[-1] - recording.stamps[0]
    typer.echo(f"{len(recording.stamps)} scans, {seconds:.0f} s: {', '.join(map(str, written))}")
