# SPDX-License-Identifier: Apache-2.0
"""``cartoloop evaluate closures``: the loop closures of a run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cartoloop.errors import ConfigError

if TYPE_CHECKING:
    from cartoloop.evaluation.closure_scores import ClosuresScore, StageScore


def closures_command(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Folder of a finished map.")],
    truth: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="True poses (TUM), for the share of true closures."),
    ] = None,
    logs: Annotated[
        list[Path] | None,
        typer.Option(
            "--log", metavar="LOG", help="Recording of OUT (repeat for its parts), for the recall."
        ),
    ] = None,
    overlap: Annotated[
        float,
        typer.Option(
            metavar="SHARE",
            min=0.01,
            max=1.0,
            help="For the recall: least share of a scan's returns in the submap.",
        ),
    ] = 0.6,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw the closures: .png or .svg.")
    ] = None,
) -> None:
    """Count loop closures, and the share of correct ones (table IV of the paper).

    With --truth: the share of true closures. With --log as well: how many were possible.
    """
    if logs and truth is None:
        raise ConfigError("--log: recall is measured against the truth; give --truth as well")

    import json

    from cartoloop.config_file import load_config
    from cartoloop.evaluation.closure_scores import evaluate_closures
    from cartoloop.evaluation.finished_run import read_run
    from cartoloop.evaluation.plot_style import image_format
    from cartoloop.evaluation.trajectories import read_tum
    from cartoloop.readers import open_logs

    plot_format = None if plot is None else image_format(plot)
    run = read_run(out)
    score = evaluate_closures(
        run,
        None if truth is None else read_tum(truth),
        open_logs(logs) if logs else None,
        load_config(out / "config.toml").config if logs else None,
        overlap,
    )
    if plot is not None and plot_format is not None:
        from cartoloop.evaluation.closure_plots import closures_plot
        from cartoloop.map_output.save import write_apart

        write_apart(plot, closures_plot(run, title=out.resolve().name, image_format=plot_format))
    typer.echo(json.dumps(score.to_dict(), indent=2) if as_json else _table(score))


def _table(score: ClosuresScore) -> str:
    """Return rows of figures, a column for each stage; rows without a figure are left out."""
    final, found = _column(score.final), _column(score.found)
    lines = [f"{'':<38}{'final':>12}{'found':>12}"]
    for name, value in final.items():
        if value or found[name]:
            lines.append(f"{name:<38}{value or '-':>12}{found[name] or '-':>12}")
    return "\n".join(lines)


def _column(score: StageScore) -> dict[str, str]:
    recall = score.recall
    return {
        "Loop closures": str(score.constraints),
        "  rejected": str(score.rejected) if score.rejected else "",
        "Precision (20 cm, 1 deg from the map)": _percent(score.precision),
        "Precision (against the truth)": _percent(score.true_precision),
        "  rejected, but true": str(score.true_rejected) if score.true_rejected else "",
        "Pairs that could have been closed": str(recall.pairs) if recall else "",
        "  closed": _percent(recall.of_pairs) if recall else "",
        "Revisits (submap to submap)": str(recall.revisits) if recall else "",
        "  closed at least once": _percent(recall.of_revisits) if recall else "",
    }


def _percent(share: float | None) -> str:
    return "" if share is None else f"{100.0 * share:.1f}%"
