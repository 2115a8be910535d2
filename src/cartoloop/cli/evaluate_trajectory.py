# SPDX-License-Identifier: Apache-2.0
"""``cartoloop evaluate trajectory``: a result against the truth."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from cartoloop.evaluation.plot_style import ImageFormat
    from cartoloop.evaluation.trajectory_error import PoseErrors, TrajectoryError


class DeltaUnit(StrEnum):
    """Units of a span."""

    METRES = "m"
    SECONDS = "s"
    FRAMES = "frames"


class PairsFrom(StrEnum):
    """Whose path is measured."""

    ESTIMATE = "estimate"
    TRUTH = "truth"


def trajectory_command(
    estimate: Annotated[Path, typer.Argument(metavar="EST", help="Trajectory in TUM format.")],
    truth: Annotated[Path, typer.Argument(metavar="TRUTH", help="True trajectory in TUM format.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    plot: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Plot both, and the error over time: .png or .svg."),
    ] = None,
    align: Annotated[
        bool, typer.Option(help="First align the estimate with the truth by a rigid transform.")
    ] = True,
    delta: Annotated[float, typer.Option(metavar="SPAN", help="Span of the relative error.")] = 1.0,
    delta_unit: Annotated[
        DeltaUnit, typer.Option(help="Unit of --delta: metres of path, seconds, or poses.")
    ] = DeltaUnit.METRES,
    all_pairs: Annotated[
        bool,
        typer.Option(
            "--all-pairs/--consecutive",
            help="Overlapping spans from every pose, or consecutive spans.",
        ),
    ] = True,
    pairs_from: Annotated[
        PairsFrom, typer.Option(help="Trajectory along which metres are measured.")
    ] = PairsFrom.ESTIMATE,
    max_difference: Annotated[
        float,
        typer.Option(metavar="SECONDS", help="Largest difference of stamps that are matched [s]."),
    ] = 0.01,
) -> None:
    """Compare a trajectory with the true one: absolute (ATE) and relative error (RPE).

    The numbers are those of 'evo_ape tum TRUTH EST -a' and 'evo_rpe tum TRUTH EST -d 1 -u m
    --all_pairs', for the rotation with '-r angle_deg'.
    """
    import json

    from cartoloop.evaluation.plot_style import image_format
    from cartoloop.evaluation.trajectories import read_tum
    from cartoloop.evaluation.trajectory_error import evaluate_trajectory

    plot_format = image_format(plot) if plot is not None else None
    error = evaluate_trajectory(
        read_tum(estimate),
        read_tum(truth),
        aligned=align,
        delta=delta,
        delta_unit=delta_unit.value,
        all_pairs=all_pairs,
        pairs_from=pairs_from.value,
        max_difference=max_difference,
    )
    if plot is not None and plot_format is not None:
        _plot(error, plot, plot_format, f"{_short(estimate)} against {_short(truth)}")
    typer.echo(json.dumps(error.to_dict(), indent=2) if as_json else _table(error))
    if num_missing := error.matched.num_missing:
        fewer = len(error.matched.stamps) + num_missing
        typer.echo(
            f"cartoloop: {num_missing} of {fewer} poses do not count: {estimate} and {truth} have "
            f"no poses within {max_difference:g} s of each other there: of the same recording?",
            err=True,
        )


def _table(error: TrajectoryError) -> str:
    lying = "aligned" if error.aligned else "not aligned"
    span = f"{error.delta:g} {error.delta_unit}"
    return "\n".join(
        (
            f"{f'Absolute error, {lying}':<31}{len(error.absolute.stamps)} poses",
            *_rows(error.absolute),
            f"{f'Relative error over {span}':<31}{len(error.relative.stamps)} pairs",
            *_rows(error.relative),
        )
    )


def _rows(errors: PoseErrors) -> list[str]:
    from cartoloop.evaluation.error_statistics import ErrorStatistics

    translation = ErrorStatistics.of(errors.translation).to_dict()
    rotation_deg = ErrorStatistics.of(errors.rotation_deg).to_dict()
    return [
        f"  {_NAMES[key]:<29}{translation[key]:.4f} m   {rotation_deg[key]:.3f} deg"
        for key in _NAMES
    ]


_NAMES = {
    "rmse": "root mean square",
    "mean": "mean",
    "std": "standard deviation",
    "min": "least",
    "median": "median",
    "p90": "90 % within",
    "p99": "99 % within",
    "max": "greatest",
}


def _short(path: Path) -> Path:
    return Path(*path.parts[-2:])  # all results are named alike, their folders are not


def _plot(error: TrajectoryError, path: Path, image_format: ImageFormat, title: str) -> None:
    from cartoloop.evaluation.plots import ErrorSeries, TrajectoryLine, trajectory_error_plot
    from cartoloop.map_output.save import write_apart

    absolute = error.absolute
    image = trajectory_error_plot(
        [
            TrajectoryLine("truth", error.matched.truth, is_reference=True),
            TrajectoryLine("estimate", error.matched.estimate, absolute.translation),
        ],
        ErrorSeries("estimate", absolute.translation, absolute.rotation_deg, absolute.stamps),
        title=title,
        image_format=image_format,
    )
    write_apart(path, image)
