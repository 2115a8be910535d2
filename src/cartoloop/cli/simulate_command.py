# SPDX-License-Identifier: Apache-2.0
"""``cartoloop simulate``: a recording with known truth."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cartoloop.cli.completion import complete_lidar, complete_odometry_fault, complete_world
from cartoloop.errors import ConfigError
from cartoloop.map_file.file_set import require_no_map_file

if TYPE_CHECKING:
    from cartoloop.simulation import Lidar, Recording, World
    from cartoloop.simulation.difficulties import Difficulties

TRUTH, DIFFICULTIES, SCANNERS = "Ground truth", "Difficulties", "Scanners"
"""Groups of options in the help."""

REAR_SCANNER_X = -0.3
"""Where the second scanner is mounted, behind the first one [m]."""


@dataclass(frozen=True, kw_only=True)
class SimulateOptions:
    """Options of ``cartoloop simulate``."""

    world: Annotated[
        str,
        typer.Argument(
            metavar="WORLD",
            autocompletion=complete_world,
            help="office, corridor, bare, ring, museum, flat, hall, wings, campus or yard.",
        ),
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
    seed: Annotated[
        int, typer.Option(metavar="N", min=0, help="Seed of the world and of all noise.")
    ] = 0
    drive: Annotated[
        int,
        typer.Option(
            metavar="N",
            min=1,
            help="N-th drive through the same building, a day after the one before: another "
            "route, furniture moved, doors closed; office only.",
        ),
    ] = 1
    lidar: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            autocompletion=complete_lidar,
            help="Scanner: sick, sick-180, wide, backpack or lds; by default the world's own.",
        ),
    ] = None
    range_noise: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            show_default=False,
            help="Standard deviation of a range [m], instead of the scanner's.",
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
    speed: Annotated[
        float | None,
        typer.Option(
            metavar="M/S",
            min=0.01,
            max=10.0,
            help="Largest speed of the robot [m/s]; by default the world's, in most 1.",
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

    two_scanners: Annotated[
        bool,
        typer.Option(
            "--two-scanners",
            help="A second scanner of the same kind that looks backwards, on the topic 'rear', "
            "and no IMU; needs a .bag.",
            rich_help_panel=SCANNERS,
        ),
    ] = False
    clock_offset: Annotated[
        float,
        typer.Option(
            metavar="SECONDS",
            help="Stamps of the second scanner are so much later than its scans [s].",
            rich_help_panel=SCANNERS,
        ),
    ] = 0.0
    scan_spacing: Annotated[
        float,
        typer.Option(
            metavar="METRES",
            help="Sparse scans: one after each such length of path and each turn of 20 "
            "degrees [m]; odometry stays as it is.",
            rich_help_panel=DIFFICULTIES,
        ),
    ] = 0.0
    pause: Annotated[
        float,
        typer.Option(
            metavar="SECONDS",
            help="Record nothing for so long [s], while the robot turns by up to 90 degrees.",
            rich_help_panel=DIFFICULTIES,
        ),
    ] = 0.0
    missing_returns: Annotated[
        float,
        typer.Option(
            metavar="SHARE",
            help="Share of the beams, at random, that do not come back, 0 to 1.",
            rich_help_panel=DIFFICULTIES,
        ),
    ] = 0.0
    glass: Annotated[
        float,
        typer.Option(
            metavar="SHARE",
            help="Share of the walls that are glass, 0 to 1: beams pass through it, unless they "
            "meet it straight on.",
            rich_help_panel=DIFFICULTIES,
        ),
    ] = 0.0
    people: Annotated[
        int,
        typer.Option(
            metavar="N", help="People who walk near the robot.", rich_help_panel=DIFFICULTIES
        ),
    ] = 0
    odometry_fault: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KIND",
            autocompletion=complete_odometry_fault,
            help="Fault of the odometry: frozen, frozen-later, jump, repeat, nan, slip, veer or "
            "synchro-drive; may be repeated.",
            rich_help_panel=DIFFICULTIES,
        ),
    ] = None
    odometry_delay: Annotated[
        float,
        typer.Option(
            metavar="SECONDS",
            help="The odometry with a stamp is of so much earlier [s].",
            rich_help_panel=DIFFICULTIES,
        ),
    ] = 0.0


def simulate_command(options: SimulateOptions) -> None:
    """Simulate a robot's drive: scans, and odometry, with noise."""
    files = (options.out, options.truth, options.relations, options.lines)
    paths = [path.resolve() for path in files if path is not None]
    for file in paths:
        require_no_map_file(file)
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

    difficulties = _difficulties(options)
    if options.clock_offset and not options.two_scanners:
        raise ConfigError("--clock-offset is that of a second scanner: add --two-scanners")

    file_format = log_format(options.out)
    world = make_world(options.world, options.seed, options.drive)
    if options.speed is not None:
        world = replace(world, pace=world.pace._replace(speed=options.speed))
    scanner = None if options.lidar is None else make_lidar(options.lidar)
    if options.range_noise is not None:
        scanner = replace(scanner or world.lidar, range_noise=options.range_noise)
    if options.two_scanners:
        return _with_two_scanners(options, world, scanner or world.lidar, difficulties)
    if file_format == "bag":
        return carry(
            world,
            scanner,
            tilt=math.radians(options.tilt_deg),
            distort=options.distort,
            with_odometry=options.odometry,
            seed=options.seed,
            duration=options.duration,
            difficulties=difficulties,
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
        difficulties=difficulties,
    )


def _difficulties(options: SimulateOptions) -> Difficulties:
    from cartoloop.simulation.difficulties import Difficulties
    from cartoloop.simulation.odometry_faults import fault_of

    return Difficulties(
        scan_spacing=options.scan_spacing,
        pause=options.pause,
        missing_returns=options.missing_returns,
        glass=options.glass,
        people=options.people,
        odometry_faults=tuple(fault_of(name) for name in options.odometry_fault or ()),
        odometry_delay=options.odometry_delay,
    )


def _with_two_scanners(
    options: SimulateOptions, world: World, lidar: Lidar, difficulties: Difficulties
) -> Recording:
    """Return the recording of a robot on wheels with a scanner in front and one behind."""
    from cartoloop.sensor.pose import Pose
    from cartoloop.simulation import MountedLidar, OdometryModel, simulate_rig
    from cartoloop.simulation.recording import log_format

    if log_format(options.out) != "bag" or options.tilt_deg or options.distort:
        raise ConfigError(
            "--two-scanners is for a robot on wheels and needs a bag: give --out a name that ends "
            "in .bag, without --tilt-deg and --distort"
        )
    rear = replace(lidar, tf_tracking_sensor=Pose(REAR_SCANNER_X, 0.0, math.pi))
    # Scanners that nothing synchronizes measure at different moments.
    scanners = [
        MountedLidar(lidar, "front"),
        MountedLidar(rear, "rear", delay=0.37 / lidar.rate, clock_offset=options.clock_offset),
    ]
    has_odometry = world.has_odometry if options.odometry is None else options.odometry
    return simulate_rig(
        world,
        scanners,
        odometry=OdometryModel() if has_odometry else None,
        seed=options.seed,
        duration=options.duration,
        difficulties=difficulties,
    )
