# SPDX-License-Identifier: Apache-2.0
"""``cartoloop evaluate relations``: a result against verified relative poses."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from cartoloop.evaluation.plot_style import ImageFormat
    from cartoloop.evaluation.relations import MeanStd, RelationsError

_NAME_WIDTH, _COLUMN_WIDTH = 31, 25


def relations_command(
    trajectory: Annotated[
        Path, typer.Argument(metavar="TRAJECTORY", help="Trajectory in TUM format.")
    ],
    relations: Annotated[
        Path, typer.Argument(metavar="RELATIONS", help="File of verified relative poses.")
    ],
    tolerance: Annotated[
        float,
        typer.Option(metavar="SECONDS", help="Largest difference of stamps that are matched [s]."),
    ] = 5e-3,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    before: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Trajectory before loop closure, to evaluate as well."),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw histograms: .png or .svg.")
    ] = None,
) -> None:
    """Compare a trajectory with verified relative poses (table II of the paper)."""
    import json

    from cartoloop.evaluation import relations as metric
    from cartoloop.evaluation.plot_style import image_format
    from cartoloop.evaluation.trajectories import read_tum

    plot_format = image_format(plot) if plot is not None else None
    expected = metric.read_relations(relations)
    paths = [trajectory] if before is None else [trajectory, before]
    errors = [metric.evaluate_relations(read_tum(path), expected, tolerance) for path in paths]
    if plot is not None and plot_format is not None:
        _plot(errors, plot, plot_format, f"{relations.name}: {errors[0].num_relations} relations")
    if as_json:
        found = errors[0].to_dict()
        if before is not None:
            found["before"] = errors[1].to_dict()
        typer.echo(json.dumps(found, indent=2))
    else:
        typer.echo(_table(errors))
        for path, error in zip(paths, errors, strict=True):
            _print_missing(path, error)


def _print_missing(path: Path, error: RelationsError) -> None:
    if not error.num_missing:
        return
    stamps = ", ".join(f"{stamp:.6f}" for stamp in error.missing_stamps[:5])
    more = ", ..." if len(error.missing_stamps) > 5 else ""
    typer.echo(
        f"cartoloop: {error.num_missing} relations do not count: the trajectory has no pose "
        f"at {stamps}{more} ({path})",
        err=True,
    )


def _table(errors: list[RelationsError]) -> str:
    from cartoloop.evaluation.error_statistics import PERCENTILES

    columns = [_column(error) for error in errors]
    names = [
        "Relations",
        "Absolute translational error",
        "Squared translational error",
        "Absolute rotational error",
        "Squared rotational error",
        *(f"{level} % within" for level in PERCENTILES),
        "All within",
    ]
    if len(errors) > 1:
        names.insert(0, "")
        columns[0].insert(0, "After loop closure")
        columns[1].insert(0, "Before")
    lines = zip(names, *columns, strict=True)
    return "\n".join(
        (f"{name:<{_NAME_WIDTH}}" + "".join(f"{cell:<{_COLUMN_WIDTH}}" for cell in cells)).rstrip()
        for name, *cells in lines
    )


def _column(error: RelationsError) -> list[str]:
    def cell(value: MeanStd, digits: int, unit: str) -> str:
        return f"{value.mean:.{digits}f} +- {value.std:.{digits}f} {unit}"

    rotational = error.absolute_rotational_deg_percentiles
    return [
        f"{error.num_relations}, {error.num_missing} missing",
        cell(error.absolute_translational, 4, "m"),
        cell(error.squared_translational, 4, "m^2"),
        cell(error.absolute_rotational_deg, 3, "deg"),
        cell(error.squared_rotational_deg2, 3, "deg^2"),
        *(
            f"{bound:.4f} m, {rotational[level]:.3f} deg"
            for level, bound in error.absolute_translational_percentiles.items()
        ),
    ]


def _plot(errors: list[RelationsError], path: Path, image_format: ImageFormat, title: str) -> None:
    from cartoloop.evaluation.plots import ErrorSeries, error_histogram
    from cartoloop.map_output.save import write_apart

    labels = ["all"] if len(errors) == 1 else ["after loop closure", "before"]
    series = [
        ErrorSeries(label, error.translations, error.rotations_deg)
        for label, error in zip(labels, errors, strict=True)
    ]
    write_apart(path, error_histogram(series, title=title, image_format=image_format))
