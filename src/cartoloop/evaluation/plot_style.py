# SPDX-License-Identifier: Apache-2.0
"""What all plots share: their look, their file formats, and that the same plot is the same bytes.

Matplotlib comes with ``pip install 'cartoloop[plot]'``. Its state for the whole process stays as
it was: neither ``pyplot`` nor the user's style is used.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from cartoloop.errors import ConfigError, OutputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure

ImageFormat = Literal["png", "svg"]
Format = TypeVar("Format", bound=str)

# From the palette of Okabe and Ito, distinguishable with any sort of colour vision.
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
    chosen: ImageFormat = format_by_suffix(path, {".png": "png", ".svg": "svg"})
    require_matplotlib()
    return chosen


def format_by_suffix(path: str | PathLike[str], formats: Mapping[str, Format]) -> Format:
    """Return the format of an image by the suffix of its file.

    Parameters
    ----------
    path : of the image.
    formats : by suffix, in small letters and with the point.

    Raises
    ------
    ConfigError
        The suffix is none of them.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in formats:
        *others, last = formats
        raise ConfigError(
            f"{path}: cannot be drawn in such a format: give a name that ends in "
            f"{', '.join(others)} or {last}"
        )
    return formats[suffix]


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


def set_title(figure: Figure, title: str) -> None:
    """Write the title above all, if there is one."""
    if title:
        figure.suptitle(title, fontsize=10.5)


def name_axes(axes: Axes, x: str, y: str) -> None:
    """Write what the axes show, with the unit."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
