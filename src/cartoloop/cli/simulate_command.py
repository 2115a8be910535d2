# SPDX-License-Identifier: Apache-2.0
"""``cartoloop simulate``: a recording with known truth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def simulate_command(
    world: Annotated[str, typer.Argument(metavar="WORLD", help="office, corridor or ring.")],
    out: Annotated[
        Path,
        typer.Option("-o", "--out", metavar="LOG", help="CARMEN log; .gz at the end compresses."),
    ],
    seed: Annotated[int, typer.Option(min=0, help="Of the world and of all noise.")] = 0,
    truth: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the true poses as a TUM file.")
    ] = None,
    relations: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write true relative poses, as 'evaluate' reads them."),
    ] = None,
) -> None:
    """Simulate a robot's drive: scans and odometry with noise."""
    from cartoloop.simulation import make_world, simulate

    recording = simulate(make_world(world, seed), seed=seed)
    recording.write_carmen(out)
    written = [out]
    if truth is not None:
        recording.write_truth(truth)
        written.append(truth)
    if relations is not None:
        recording.write_relations(relations)
        written.append(relations)
    duration = recording.stamps[-1] - recording.stamps[0]
    typer.echo(f"{len(recording.stamps)} scans, {duration:.0f} s: {', '.join(map(str, written))}")
