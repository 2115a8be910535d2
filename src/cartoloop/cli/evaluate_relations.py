# SPDX-License-Identifier: Apache-2.0
"""``cartoloop evaluate relations``: a result against verified relative poses."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from cartoloop.evaluation.relations import MeanStd, RelationsError


def relations_command(
    trajectory: Annotated[Path, typer.Argument(help="Trajectory in TUM format.")],
    relations: Annotated[Path, typer.Argument(help="File of verified relative poses.")],
    tolerance: Annotated[
        float, typer.Option(help="Greatest difference of stamps that are the same [s].")
    ] = 5e-3,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Compare a trajectory with verified relative poses (table II of the paper)."""
    import json

    from cartoloop.evaluation import relations as metric
    from cartoloop.evaluation.trajectories import read_tum

    error = metric.evaluate_relations(
        read_tum(trajectory), metric.read_relations(relations), tolerance
    )
    if as_json:
        typer.echo(json.dumps(error.to_dict(), indent=2))
        return
    typer.echo(_table(error))
    if error.num_missing:
        stamps = ", ".join(f"{stamp:.6f}" for stamp in error.missing_stamps[:5])
        more = ", ..." if len(error.missing_stamps) > 5 else ""
        typer.echo(
            f"cartoloop: {error.num_missing} relations do not count: the trajectory has no pose "
            f"at {stamps}{more}",
            err=True,
        )


def _table(error: RelationsError) -> str:
    def row(name: str, value: MeanStd, digits: int, unit: str) -> str:
        return f"{name:<31}{value.mean:.{digits}f} +- {value.std:.{digits}f} {unit}"

    return "\n".join(
        (
            f"{'Relations':<31}{error.num_relations}, {error.num_missing} missing",
            row("Absolute translational error", error.absolute_translational, 4, "m"),
            row("Squared translational error", error.squared_translational, 4, "m^2"),
            row("Absolute rotational error", error.absolute_rotational_deg, 3, "deg"),
            row("Squared rotational error", error.squared_rotational_deg2, 3, "deg^2"),
        )
    )
