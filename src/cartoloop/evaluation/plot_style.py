# SPDX-License-Identifier: Apache-2.0
"""What all plots share: their look, their file formats, and that the same plot is the same bytes.

Matplotlib comes with ``pip install 'cartoloop[plot]'``. Its state for the whole process stays as
it was: neither ``pyplot`` nor the user's style is used.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from cartoloop.errors import ConfigError, OutputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure

ImageFormat = Literal["png", "svg"]

# Of the palette of Okabe and Ito, which people with any sort of colour vision can tell apart.
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
INK = "#54585e"
REFERENCE_COLOUR = "#9a9da1"

_STYLE: dict[Any, Any] = {
    "font.family": ["DejaVu Sans", "sans-serif"],
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e6e6e3",
    "grid.linewidth": 0.7,
    "xtick.color": INK,
    "ytick.color": INK,
    "text.color": "#21252b",
    "text.parse_math": False,  # names of files may hold dollars
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "lines.solid_capstyle": "round",
    "savefig.facecolor": "white",
    "savefig.dpi": 200,
    # Names of parts are random otherwise; text stays text, that can be searched and read aloud.
    "svg.hashsalt": "cartoloop",
    "svg.fonttype": "none",
}


def image_format(path: str | PathLike[str]) -> ImageFormat:
    """Return the format of a plot by the suffix of its file.

    Raises
    ------
    ConfigError
        The suffix is neither ``.png`` nor ``.svg``.
    OutputError
        Matplotlib is not installed.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in (".png", ".svg"):
        raise ConfigError(f"{path}: plots are PNG or SVG: give a name that ends in .png or .svg")
    require_matplotlib()
    return "png" if suffix == ".png" else "svg"


def require_matplotlib() -> None:
    """Make sure that plots can be drawn.

    Raises
    ------
    OutputError
        Matplotlib is not installed.
    """
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError as error:
        raise OutputError(
            "plots need Matplotlib, which is not installed: pip install 'cartoloop[plot]'"
        ) from error


def render(
    draw: Callable[[Figure], None], size: tuple[float, float], image_format: ImageFormat
) -> bytes:
    """Return a plot as the bytes of an image: the same plot, the same bytes.

    Parameters
    ----------
    draw : fills the figure that it is given.
    size : width and height [inch]; at 8 inches text is well readable 800 pixels wide.
    image_format : ``png`` (200 pixels an inch) or ``svg``.

    Raises
    ------
    OutputError
        Matplotlib is not installed.
    """
    require_matplotlib()
    import matplotlib as mpl
    from matplotlib.figure import Figure

    # Dates and versions would make each image another one.
    metadata = {"Date": None} if image_format == "svg" else {"Software": None}
    buffer = io.BytesIO()
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_STYLE)
        figure = Figure(figsize=size, layout="constrained")
        draw(figure)
        figure.savefig(buffer, format=image_format, metadata=metadata)
    return buffer.getvalue()


def error_colours() -> Colormap:
    """Return the colours of errors, small to large: from blue to orange, all dark on white."""
    import matplotlib as mpl
    from matplotlib.colors import LinearSegmentedColormap

    plasma = mpl.colormaps["plasma"]
    return LinearSegmentedColormap.from_list(
        "error", [plasma(0.85 * step / 15) for step in range(16)]
    )


def name_axes(axes: Axes, x: str, y: str) -> None:
    """Write what the axes show, with the unit."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
