# SPDX-License-Identifier: Apache-2.0
"""``cartoloop demo``: simulate, map and evaluate, without a recording."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from cartoloop.cli.options import ConfigOptions, OverwriteOption

LOG_NAME = "office.log.gz"
"""File name of the demo's recording, beside its map."""


@dataclass(frozen=True, kw_only=True)
class DemoOptions(ConfigOptions):
    """Options of ``cartoloop demo``."""

    out: Annotated[
        Path, typer.Option("-o", "--out", metavar="OUT", help="Folder for the map; is created.")
    ] = Path("cartoloop-demo")
    overwrite: OverwriteOption = False
    seed: Annotated[
        int, typer.Option(metavar="N", min=0, help="Seed of the office and of all noise.")
    ] = 0


def demo_command(options: DemoOptions) -> None:
    """Simulate a robot's drive through an office floor, and map it."""
    from cartoloop.cli.mapping import compilation_notice, map_log
    from cartoloop.evaluation.trajectories import absolute_trajectory_error, read_tum
    from cartoloop.map_output.output_folder import RunFolder, prepare_folder, saved_map
    from cartoloop.map_output.picture import DEFAULT_LAYERS
    from cartoloop.readers import open_log
    from cartoloop.simulation import make_world, simulate

    loaded, out = options.load(), options.out
    # The map of an earlier demo may be replaced, also where its office was another.
    saved = saved_map(out)
    overwrite = options.overwrite or (saved is not None and saved.name == LOG_NAME)
    RunFolder(out, LOG_NAME, "", overwrite).check()
    prepare_folder(out)
    typer.echo("simulating a drive through an office floor", err=True)
    with compilation_notice():
        recording = simulate(make_world("office", options.seed), seed=options.seed)
    recording.write_carmen(out / LOG_NAME)
    recording.write_truth(out / "truth.tum")
    log = open_log(out / LOG_NAME)
    typer.echo(log.profile.describe())
    result = map_log(log, loaded, out, DEFAULT_LAYERS, overwrite=overwrite)
    truth = read_tum(out / "truth.tum")
    rows = truth.find(result.stamps, tolerance=1e-3)
    error = absolute_trajectory_error(result.trajectory[rows >= 0], truth.poses[rows[rows >= 0]])
    typer.echo(f"error          {error.mean():.3f} m mean, {error.max():.3f} m max")
