# SPDX-License-Identifier: Apache-2.0
"""Loop closures drawn: where they are, and by how much the map disagrees with them."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cartoloop.errors import CartoloopError, OutputError
from cartoloop.evaluation.finished_run import Closures, FinishedRun
from cartoloop.global_slam.pose_graph import TRUE_ROTATION_RAD, TRUE_TRANSLATION_M
from cartoloop.map_output.closures_file import Stage
from cartoloop.map_output.save import write_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import LineCollection
    from matplotlib.figure import Figure

_NUM_BINS = 50
_UNDATED: dict[str, dict[str, Any]] = {
    "png": {},
    "svg": {"Date": None},
    "pdf": {"CreationDate": None},
}
_COLOURS = {Stage.FINAL: "tab:blue", Stage.FOUND: "tab:orange", Stage.REJECTED: "tab:red"}


def draw_closures(run: FinishedRun) -> Figure:
    """Return a figure of the closures over the trajectory, and histograms of their residuals.

    The closures of the finished graph are coloured by residual, the worst on top; those rejected
    are red. The histograms show the found ones too.

    Raises
    ------
    CartoloopError
        matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise CartoloopError("plots need matplotlib: pip install 'cartoloop[plot]'") from error
    figure = Figure(figsize=(12.0, 6.0), layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(2, 1))
    axes = figure.add_subplot(grid[:, 0])
    lines = _draw_map(axes, run)
    figure.colorbar(lines, ax=axes, extend="max", label="residual [m]", shrink=0.8)
    for row, unit, limit in (
        (0, "m", TRUE_TRANSLATION_M),
        (1, "deg", float(np.degrees(TRUE_ROTATION_RAD))),
    ):
        _draw_histogram(figure.add_subplot(grid[row, 1]), run, unit, limit)
    return figure


def write_figure(figure: Figure, path: Path) -> None:
    """Write a figure in the format that the name ends with, png without an ending.

    Same figure, same bytes.

    Raises
    ------
    OutputError
        The format is none that plots are written in, or the file cannot be written.
    """
    import matplotlib as mpl

    suffix = path.suffix[1:].lower() or "png"
    if suffix not in _UNDATED:
        raise OutputError(f"{path}: plots are written as {', '.join(_UNDATED)}; name one of these")
    buffer = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "cartoloop"}):
        figure.savefig(buffer, format=suffix, dpi=150, metadata=_UNDATED[suffix])
    write_file(path, buffer.getvalue())


def _draw_map(axes: Axes, run: FinishedRun) -> LineCollection:
    """Draw trajectory and closures; return those that are coloured by residual."""
    from matplotlib.collections import LineCollection

    axes.plot(*run.node_poses[:, :2].T, color="0.6", linewidth=0.8, zorder=1)
    final = run.closures[Stage.FINAL]
    order = np.argsort(final.residual_m, kind="stable")
    lines = LineCollection(
        [*_ends(run, final)[order]],
        array=final.residual_m[order],
        cmap="viridis",
        clim=(0.0, TRUE_TRANSLATION_M),
        linewidths=0.6,
        zorder=2,
    )
    axes.add_collection(lines)
    rejected = LineCollection(
        [*_ends(run, run.closures[Stage.REJECTED])],
        colors=_COLOURS[Stage.REJECTED],
        linewidths=1.2,
        zorder=3,
    )
    axes.add_collection(rejected)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    num_rejected = len(run.closures[Stage.REJECTED])
    axes.set_title(f"{len(final)} loop closures, {num_rejected} rejected (red)")
    return lines


def _draw_histogram(axes: Axes, run: FinishedRun, unit: str, limit: float) -> None:
    edges = np.linspace(0.0, 2.0 * limit, _NUM_BINS + 1)
    for stage in (Stage.FINAL, Stage.FOUND):
        closures = run.closures[stage]
        residual = closures.residual_m if unit == "m" else closures.residual_deg
        # the last bin holds all that is larger
        axes.hist(
            np.minimum(residual, edges[-1]),
            bins=edges.tolist(),
            histtype="step",
            color=_COLOURS[stage],
            label=f"{stage} ({len(closures)})",
        )
    axes.axvline(limit, color="0.4", linestyle="--", linewidth=0.8)
    axes.set_yscale("symlog")
    axes.set_xlabel(f"residual [{unit}]; the last bin holds all beyond")
    axes.set_ylabel("closures")
    axes.legend(fontsize="small")


def _ends(run: FinishedRun, closures: Closures) -> NDArray[np.float64]:
    """Return where the submap and the node of each closure stand, shape (k, 2, 2) [m]."""
    submaps = run.submap_poses[closures.submap, :2]
    return np.stack((submaps, run.node_poses[closures.node, :2]), axis=1)
