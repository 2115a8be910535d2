# SPDX-License-Identifier: Apache-2.0
"""Plots of errors and trajectories, as the bytes of a PNG or SVG image.

All functions raise :class:`~cartoloop.errors.OutputError` where Matplotlib, the extra ``plot``, is
not installed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cartoloop.arrays import FloatArray
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

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_NUM_BINS = 40
_SMALLEST_SHARE = 1e-3  # errors below this part of the greatest are drawn as if they were that
_MOST_COLOURED_POINTS = 5000  # each is a path of its own in an SVG


@dataclass(frozen=True)
class ErrorSeries:
    """Errors of one result.

    Attributes
    ----------
    label : name in the legend.
    translation : float64 (n,), distances [m], n > 0.
    rotation_deg : float64 (n,), absolute angles [deg].
    stamps : float64 (n,), when each occurred [s]; only :func:`trajectory_error_plot` asks for them.
    """

    label: str
    translation: FloatArray
    rotation_deg: FloatArray
    stamps: FloatArray | None = None


@dataclass(frozen=True)
class TrajectoryLine:
    """A trajectory to draw.

    Attributes
    ----------
    label : name in the legend.
    positions : float64 (n, >= 2), x, y [m], all lines in one frame.
    errors : float64 (n,) [m], to colour the line by; otherwise each line has a colour of its own.
    is_reference : whether others are compared with it: drawn in grey, beneath them.
    """

    label: str
    positions: FloatArray
    errors: FloatArray | None = None
    is_reference: bool = False


def error_histogram(
    series: Sequence[ErrorSeries], *, title: str = "", image_format: ImageFormat = "png"
) -> bytes:
    """Return histograms of the errors: translation [cm] and rotation [deg] side by side.

    Parameters
    ----------
    series : results to compare, the most important first: it is filled, the others are outlined.
        Of each the mean and the bound of 95 % of its errors are marked.
    title : above both.
    image_format : ``png`` or ``svg``.

    Notes
    -----
    The axis of the errors is logarithmic, for few large errors would squeeze all others into the
    first bin otherwise.
    """

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2)
        _draw_histogram(left, [(one.label, 100.0 * one.translation) for one in series], "cm")
        _draw_histogram(right, [(one.label, one.rotation_deg) for one in series], "deg")
        name_axes(left, "translational error [cm]", "share of errors [%]")
        name_axes(right, "rotational error [deg]", "")
        set_title(figure, title)

    return render(draw, (8.0 + 2.5 * max(len(series) - 2, 0), 4.0), image_format)


def trajectory_plot(
    lines: Sequence[TrajectoryLine], *, title: str = "", image_format: ImageFormat = "png"
) -> bytes:
    """Return trajectories drawn over each other, one metre as long in x as in y.

    Parameters
    ----------
    lines : what to draw, the lowest first.
    title : above the plot.
    image_format : ``png`` or ``svg``.
    """

    def draw(figure: Figure) -> None:
        _draw_trajectories(figure.subplots(), lines)
        set_title(figure, title)

    width, height = np.ptp(np.vstack([line.positions[:, :2] for line in lines]), axis=0)
    shape = float(np.clip(height / max(width, 1e-9), 0.35, 0.9))
    return render(draw, (8.0, 1.2 + 6.4 * shape), image_format)


def trajectory_error_plot(
    lines: Sequence[TrajectoryLine],
    errors: ErrorSeries,
    *,
    title: str = "",
    image_format: ImageFormat = "png",
) -> bytes:
    """Return a trajectory over the true one, and beside them its errors over time.

    Parameters
    ----------
    lines : as for :func:`trajectory_plot`.
    errors : those of the trajectory, with stamps, in any order; drawn against the time since the
        first of them, translation above rotation.
    title : above all.
    image_format : ``png`` or ``svg``.

    Raises
    ------
    ValueError
        The errors have no stamps.
    """

    def draw(figure: Figure) -> None:
        axes = figure.subplot_mosaic([["path", "translation"], ["path", "rotation"]])
        _draw_trajectories(axes["path"], lines)
        _draw_over_time((axes["translation"], axes["rotation"]), errors)
        set_title(figure, title)

    return render(draw, (9.0, 4.2), image_format)


def _draw_histogram(axes: Axes, series: Sequence[tuple[str, FloatArray]], unit: str) -> None:
    from matplotlib.ticker import LogLocator, NullFormatter

    greatest = max(float(errors.max()) for _, errors in series) or 1.0
    marks = [(float(errors.mean()), float(np.percentile(errors, 95))) for _, errors in series]
    least = max(
        min(float(np.percentile(errors, 0.5)) for _, errors in series), _SMALLEST_SHARE * greatest
    )
    bins = np.geomspace(least, greatest * 1.0001, _NUM_BINS + 1)
    axes.set_xscale("log")
    decades = np.log10(greatest / least)
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if decades < 3.0 else (1.0,)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.grid(visible=False, axis="x")
    for number, (label, errors) in enumerate(series):
        colour = COLOURS[number % len(COLOURS)]
        axes.hist(
            np.clip(errors, least, greatest),
            bins=bins.tolist(),
            weights=np.full(len(errors), 100.0 / len(errors)),
            histtype="stepfilled" if number == 0 else "step",
            color=colour,
            alpha=0.45 if number == 0 else 1.0,
            label=label,
        )
        mean, bound = marks[number]
        axes.axvline(mean, color=colour, label=f"mean: {mean:.3g} {unit}")
        axes.axvline(bound, color=colour, linestyle="--", label=f"95 %: {bound:.3g} {unit}")
    axes.margins(x=0.01)
    _legend_above(axes, columns=len(series))


def _draw_trajectories(axes: Axes, lines: Sequence[TrajectoryLine]) -> None:
    from matplotlib.collections import LineCollection
    from matplotlib.colors import Normalize

    greatest = max(
        (float(line.errors.max()) for line in lines if line.errors is not None), default=0
    )
    factor, unit = _length_unit(greatest)
    norm = Normalize(0.0, factor * greatest or 1.0)
    colours = iter(COLOURS * len(lines))
    coloured = None
    for line in lines:
        x, y = line.positions[:, 0], line.positions[:, 1]
        if line.errors is None:
            colour = REFERENCE_COLOUR if line.is_reference else next(colours)
            axes.plot(
                x, y, color=colour, linewidth=2.4 if line.is_reference else 1.2, label=line.label
            )
            continue
        stride = -(-len(x) // _MOST_COLOURED_POINTS)
        points = np.column_stack((x, y))[::stride]
        coloured = LineCollection(
            list(np.stack((points[:-1], points[1:]), axis=1)),
            array=factor * line.errors[::stride][1:],
            norm=norm,
            cmap=error_colours(),
            linewidth=1.6,
            capstyle="round",
        )
        axes.add_collection(coloured)
        axes.autoscale_view()
    axes.set_aspect("equal", adjustable="datalim")
    name_axes(axes, "x [m]", "y [m]")
    if coloured is not None:
        label = next(line.label for line in lines if line.errors is not None)
        bar = axes.figure.colorbar(coloured, ax=axes, shrink=0.7, aspect=30, pad=0.02)
        bar.set_label(f"error of {label} [{unit}]", color=INK)
        bar.outline.set_visible(False)
    if axes.get_legend_handles_labels()[0]:
        _legend_above(axes, columns=4)


def _draw_over_time(panels: Sequence[Axes], errors: ErrorSeries) -> None:
    if errors.stamps is None:
        raise ValueError("errors over time need their stamps")
    order = np.argsort(errors.stamps, kind="stable")
    time = errors.stamps[order] - errors.stamps.min()
    in_minutes = float(time[-1]) > 600.0
    if in_minutes:
        time = time / 60.0
    factor, unit = _length_unit(float(errors.translation.max()))
    for axes, values in zip(
        panels, (factor * errors.translation, errors.rotation_deg), strict=True
    ):
        axes.plot(time, values[order], color=COLOURS[0], linewidth=1.0)
        axes.set_ylim(bottom=0.0)
        axes.margins(x=0.01)
    name_axes(panels[0], "", f"translational error [{unit}]")
    name_axes(panels[1], "time [min]" if in_minutes else "time [s]", "rotational error [deg]")
    panels[1].sharex(panels[0])
    panels[0].tick_params(labelbottom=False)


def _legend_above(axes: Axes, columns: int) -> None:
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns, columnspacing=1.4)


def _length_unit(greatest: float) -> tuple[float, str]:
    return (1.0, "m") if greatest >= 1.0 else (100.0, "cm")
