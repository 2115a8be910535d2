# SPDX-License-Identifier: Apache-2.0
"""Plots are images, always of the same bytes, and show what they are given."""

from __future__ import annotations

import io
import sys
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from PIL import Image

from cartoloop.errors import ConfigError, OutputError
from cartoloop.evaluation.plot_style import image_format
from cartoloop.evaluation.plots import (
    ErrorSeries,
    TrajectoryLine,
    error_histogram,
    trajectory_error_plot,
    trajectory_plot,
)

pytestmark = pytest.mark.slow

RNG = np.random.default_rng(0)
STAMPS = 1e9 + np.arange(50.0)
PATH = np.column_stack((np.arange(50.0), np.sin(np.arange(50.0) / 9)))
AFTER = ErrorSeries("after", RNG.exponential(0.03, 50), RNG.exponential(0.4, 50), STAMPS)
BEFORE = ErrorSeries("before", RNG.exponential(0.3, 50), RNG.exponential(0.9, 50), STAMPS)
TRUTH = TrajectoryLine("truth", PATH, is_reference=True)
ESTIMATE = TrajectoryLine("estimate", PATH + 0.3, AFTER.translation)

PLOTS = {
    "histogram": lambda **options: error_histogram([AFTER, BEFORE], **options),
    "trajectory": lambda **options: trajectory_plot([TRUTH, ESTIMATE], **options),
    "all": lambda **options: trajectory_error_plot([TRUTH, ESTIMATE], AFTER, **options),
}


def texts_of(svg):
    return {
        "".join(element.itertext())
        for element in ET.fromstring(svg).iter("{http://www.w3.org/2000/svg}text")
    }


@pytest.mark.parametrize("plot", PLOTS.values(), ids=PLOTS)
def test_png_is_an_image_of_size_and_always_the_same(plot):
    first, second = plot(image_format="png"), plot(image_format="png")

    assert first == second
    picture = Image.open(io.BytesIO(first)).convert("RGB")
    assert picture.width >= 1600
    assert len(picture.getcolors(maxcolors=2**24)) > 50


@pytest.mark.parametrize("plot", PLOTS.values(), ids=PLOTS)
def test_svg_holds_the_title_and_is_always_the_same(plot):
    title = "from $HOME to <$PWD> & back"

    first, second = (plot(image_format="svg", title=title) for _ in range(2))

    assert first == second
    assert title in texts_of(first)
    assert b"dc:date" not in first


def test_histogram_marks_mean_and_95_per_cent_in_cm_and_deg():
    errors = np.linspace(0.0, 0.2, 101)

    texts = texts_of(error_histogram([ErrorSeries("mine", errors, errors)], image_format="svg"))

    assert {"mine", "mean: 10 cm", "95 %: 19 cm", "mean: 0.1 deg", "95 %: 0.19 deg"} <= texts
    assert {"translational error [cm]", "rotational error [deg]"} <= texts


@pytest.mark.parametrize("value", [0.0, 0.25])
def test_errors_all_alike_or_none_at_all_can_be_drawn(value):
    same = np.full(3, value)

    assert error_histogram([ErrorSeries("same", same, same)]).startswith(b"\x89PNG")
    assert error_histogram([ErrorSeries("one", same[:1], same[:1])]).startswith(b"\x89PNG")


def test_a_robot_that_never_moved_can_be_drawn():
    assert trajectory_plot([TrajectoryLine("still", np.zeros((4, 2)))]).startswith(b"\x89PNG")
    single = TrajectoryLine("one", np.zeros((1, 3)), errors=np.zeros(1))
    assert trajectory_plot([single]).startswith(b"\x89PNG")


def test_trajectories_are_named_and_a_coloured_one_has_a_scale():
    plain = TrajectoryLine("local", PATH)

    texts = texts_of(trajectory_plot([TRUTH, plain, ESTIMATE], image_format="svg"))

    assert {"truth", "local", "error of estimate [cm]", "x [m]", "y [m]"} <= texts


def test_large_errors_are_in_metres_and_long_times_in_minutes():
    large = ErrorSeries("large", np.full(3, 2.5), np.ones(3), np.array([0.0, 900.0, 300.0]))

    texts = texts_of(trajectory_error_plot([TRUTH], large, image_format="svg"))

    assert {"translational error [m]", "time [min]"} <= texts
    assert "time [s]" in texts_of(trajectory_error_plot([TRUTH], AFTER, image_format="svg"))


def test_long_coloured_trajectories_stay_small_files():
    n = 30_000
    path = np.column_stack((np.linspace(0, 100, n), np.sin(np.linspace(0, 20, n))))

    image = trajectory_plot(
        [TrajectoryLine("long", path, np.linspace(0, 1, n))], image_format="svg"
    )

    assert len(image) < 2_000_000


def test_errors_over_time_need_stamps():
    with pytest.raises(ValueError, match="stamps"):
        trajectory_error_plot([TRUTH], ErrorSeries("none", np.ones(2), np.ones(2)))


def test_the_suffix_chooses_the_format():
    assert image_format("a/b.PNG") == "png"
    assert image_format("b.svg") == "svg"
    with pytest.raises(ConfigError, match=r"b\.pdf: .* ends in \.png or \.svg"):
        image_format("b.pdf")


def test_error_without_matplotlib_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)

    with pytest.raises(OutputError, match=r"pip install 'cartoloop\[plot\]'"):
        image_format("b.svg")
    with pytest.raises(OutputError, match=r"pip install 'cartoloop\[plot\]'"):
        error_histogram([AFTER])


def test_the_style_of_the_process_is_neither_used_nor_changed():
    import matplotlib as mpl

    had_pyplot = "matplotlib.pyplot" in sys.modules
    plain = error_histogram([AFTER])
    with mpl.rc_context({"font.size": 30, "axes.facecolor": "red"}):
        assert error_histogram([AFTER]) == plain
        assert mpl.rcParams["font.size"] == 30
    assert ("matplotlib.pyplot" in sys.modules) == had_pyplot
