# SPDX-License-Identifier: Apache-2.0
"""Loop closures drawn: where they are, and by how much the map disagrees with them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.evaluation.finished_run import FinishedRun, Stage, StageClosures
from cartoloop.evaluation.plot_style import (
    COLOURS,
    INK,
    REFERENCE_COLOUR,
    ImageFormat,
    error_colours,
    name_axes,
    render,
    set_title,
)
from cartoloop.global_slam.pose_graph import TRUE_ROTATION_RAD, TRUE_TRANSLATION_M

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_NUM_BINS = 50
_REJECTED_COLOUR = "#d40000"


def closures_plot(run: FinishedRun, *, title: str = "", image_format: ImageFormat = "png") -> bytes:
    """Return the closures over the trajectory, and beside them histograms of their residuals.

    The closures of the finished graph are coloured by residual, the worst on top; those rejected
    are red. The histograms show those found while mapping as well.

    Parameters
    ----------
    run : whose closures to draw.
    title : above all.
    image_format : ``png`` or ``svg``.

    Raises
    ------
    OutputError
        Matplotlib is not installed.
    """

    def draw(figure: Figure) -> None:
        draw_closures(figure, run)
        set_title(figure, title)

    return render(draw, (10.0, 5.0), image_format)


def draw_closures(figure: Figure, run: FinishedRun) -> None:
    """Draw what :func:`closures_plot` shows into an empty figure."""
    axes = figure.subplot_mosaic([["map", "m"], ["map", "deg"]], width_ratios=(2, 1))
    _draw_map(axes["map"], run)
    _draw_histogram(axes["m"], run, "m", TRUE_TRANSLATION_M)
    _draw_histogram(axes["deg"], run, "deg", float(np.degrees(TRUE_ROTATION_RAD)))
    axes["m"].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)


def _draw_map(axes: Axes, run: FinishedRun) -> None:
    from matplotlib.collections import LineCollection

    final, rejected = run.closures[Stage.FINAL], run.closures[Stage.REJECTED]
    axes.plot(
        run.node_poses[:, 0], run.node_poses[:, 1], color=REFERENCE_COLOUR, linewidth=1.2, zorder=1
    )
    worst = float(final.residual_m.max(initial=0.0))
    order = np.argsort(final.residual_m, kind="stable")
    lines = LineCollection(
        list(_ends(run, final)[order]),
        array=final.residual_m[order],
        cmap=error_colours(),
        clim=(0.0, min(worst, TRUE_TRANSLATION_M) or TRUE_TRANSLATION_M),
        linewidth=0.6,
        zorder=2,
    )
    axes.add_collection(lines)
    axes.add_collection(
        LineCollection(list(_ends(run, rejected)), colors=_REJECTED_COLOUR, linewidth=1.6, zorder=3)
    )
    axes.autoscale_view()
    axes.set_aspect("equal", adjustable="datalim")
    name_axes(axes, "x [m]", "y [m]")
    if len(rejected):
        axes.set_title(f"{len(final)} loop closures; {len(rejected)} rejected, in red")
    else:
        axes.set_title(f"{len(final)} loop closures")
    bar = axes.figure.colorbar(
        lines,
        ax=axes,
        extend="max" if worst > TRUE_TRANSLATION_M else "neither",
        shrink=0.7,
        aspect=30,
        pad=0.02,
    )
    bar.set_label("residual [m]", color=INK)


def _draw_histogram(axes: Axes, run: FinishedRun, unit: str, limit: float) -> None:
    edges = np.linspace(0.0, 2.0 * limit, _NUM_BINS + 1)
    for stage, colour in zip((Stage.FINAL, Stage.FOUND), COLOURS, strict=False):
        closures = run.closures[stage]
        residual = closures.residual_m if unit == "m" else closures.residual_deg
        axes.hist(
            np.minimum(residual, edges[-1]),
            bins=edges.tolist(),
            histtype="step",
            color=colour,
            label=f"{stage} ({len(closures)})",
        )
    axes.axvline(limit, color=INK, linestyle="--", linewidth=0.8)
    axes.set_yscale("symlog")  # a few bad ones beside thousands of good ones
    axes.yaxis.set_major_formatter("{x:g}")
    name_axes(axes, f"residual [{unit}], last bin: or more", "closures")


def _ends(run: FinishedRun, closures: StageClosures) -> FloatArray:
    """Return where the submap and the node of each closure stand, shape (k, 2, 2) [m]."""
    submaps = run.submap_poses[closures.submap, :2]
    return np.stack((submaps, run.node_poses[closures.node, :2]), axis=1)
