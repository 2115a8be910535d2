# SPDX-License-Identifier: Apache-2.0
"""``cartoloop demo``: everything once, without a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cartoloop.cli.options import SetOption, ThreadsOption, settings_with_threads


def demo_command(
    out: Annotated[
        Path, typer.Option("-o", "--out", metavar="OUT", help="Folder for the map.")
    ] = Path("cartoloop-demo"),
    seed: Annotated[int, typer.Option(min=0, help="Of the office and of all noise.")] = 0,
    settings: SetOption = None,
    threads: ThreadsOption = None,
) -> None:
    """Simulate a robot's drive through an office floor, and map it."""
    from cartoloop.cli.mapping import compilation_told, map_recording
    from cartoloop.config_file import load_config
    from cartoloop.evaluation.trajectories import absolute_trajectory_error, read_tum
    from cartoloop.map_output.picture import DEFAULT_LAYERS
    from cartoloop.map_output.save import prepare_folder
    from cartoloop.readers import open_log
    from cartoloop.simulation import make_world, simulate

    loaded = load_config(settings=settings_with_threads(settings, threads))
    prepare_folder(out)
    typer.echo("simulating a drive through an office floor", err=True)
    with compilation_told():
        recording = simulate(make_world("office", seed), seed=seed)
    recording.write_carmen(out / "office.log.gz")
    recording.write_truth(out / "truth.tum")
    log = open_log(out / "office.log.gz")
    typer.echo(log.profile.describe())
    result = map_recording(log, loaded, out, DEFAULT_LAYERS)
    truth = read_tum(out / "truth.tum")
    rows = truth.find(result.stamps, tolerance=1e-3)
    error = absolute_trajectory_error(result.trajectory[rows >= 0], truth.poses[rows[rows >= 0]])
    typer.echo(f"error          {error.mean():.3f} m in the mean, {error.max():.3f} m at most")
