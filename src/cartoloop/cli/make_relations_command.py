# SPDX-License-Identifier: Apache-2.0
"""``cartoloop evaluate make-relations``: relations from a run, to score local SLAM."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def make_relations_command(
    out: Annotated[
        Path, typer.Argument(metavar="OUT", help="Folder of a finished map with loops closed.")
    ],
    relations: Annotated[Path, typer.Option("-o", "--out", metavar="FILE", help="File to write.")],
    min_distance: Annotated[
        float,
        typer.Option(
            metavar="METRES", min=0.0, help="Shortest path length between the two scans [m]."
        ),
    ] = 100.0,
    max_translation: Annotated[
        float,
        typer.Option(
            metavar="METRES", min=0.0, help="Leave out closures with a larger residual [m]."
        ),
    ] = 0.15,
    max_rotation: Annotated[
        float,
        typer.Option(
            metavar="RADIANS", min=0.0, help="Leave out closures with a larger residual [rad]."
        ),
    ] = 0.02,
) -> None:
    """Write relations from a run's loop closures, to score local SLAM on your own recording.

    Score OUT/local_trajectory.tum, or other runs of the same recording without loop closure, with
    'cartoloop evaluate relations'. They prove nothing about OUT/trajectory.tum, their source.
    """
    from cartoloop.evaluation import make_relations as generator
    from cartoloop.evaluation.finished_run import read_run
    from cartoloop.map_output.save import write_apart

    made = generator.make_relations(read_run(out), min_distance, max_translation, max_rotation)
    write_apart(relations, generator.relations_text(made))
    typer.echo(f"{len(made.stamps)} relations: {relations}")
    typer.echo(
        f"score local SLAM by them: cartoloop evaluate relations {out / 'local_trajectory.tum'} "
        f"{relations}; that {out / 'trajectory.tum'} agrees with them proves nothing",
        err=True,
    )
