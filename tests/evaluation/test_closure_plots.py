# SPDX-License-Identifier: Apache-2.0
"""Loop closures drawn."""

from __future__ import annotations

import sys

import pytest
from PIL import Image

from cartoloop.errors import CartoloopError, OutputError
from cartoloop.evaluation.closure_plots import draw_closures, write_figure
from cartoloop.evaluation.finished_run import read_run
from tests.evaluation.hand_made_run import closure, hand_made_result


@pytest.fixture
def run(tmp_path):
    final = [closure(0, 5, 0.15), closure(0, 4)]
    hand_made_result(final, [closure(0, 5, 0.5)], [closure(1, 0, 0.5)]).save(tmp_path / "out")
    return read_run(tmp_path / "out")


def test_closures_are_drawn_the_worst_on_top_and_those_rejected_apart(run):
    pytest.importorskip("matplotlib")

    axes = draw_closures(run).axes

    final, rejected = axes[0].collections
    assert final.get_array().tolist() == pytest.approx([0.0, 0.15])
    assert final.get_segments()[1].tolist() == [[0.0, 0.0], [0.2, 0.1]]
    assert rejected.get_segments()[0].tolist() == [[8.0, 0.0], [0.0, 0.0]]
    labels = [text.get_text() for text in axes[2].get_legend().get_texts()]
    assert labels == ["final (2)", "found (1)"]


@pytest.mark.parametrize(
    ("name", "magic"),
    [("a.png", b"\x89PNG"), ("a", b"\x89PNG"), ("a.svg", b"<?xml"), ("a.pdf", b"%PDF")],
)
def test_the_same_figure_is_the_same_file(run, tmp_path, name, magic):
    pytest.importorskip("matplotlib")
    path = tmp_path / name

    write_figure(draw_closures(run), path)
    first = path.read_bytes()
    write_figure(draw_closures(run), path)

    assert first.startswith(magic)
    assert path.read_bytes() == first


def test_a_run_without_closures_is_drawn_all_the_same(tmp_path):
    pytest.importorskip("matplotlib")
    hand_made_result().save(tmp_path / "out")

    write_figure(draw_closures(read_run(tmp_path / "out")), tmp_path / "a.png")

    with Image.open(tmp_path / "a.png") as picture:
        assert picture.size == (1800, 900)


def test_an_unknown_format_is_told(run, tmp_path):
    pytest.importorskip("matplotlib")

    with pytest.raises(OutputError, match=r"a\.bmp: plots are written as png, svg, pdf"):
        write_figure(draw_closures(run), tmp_path / "a.bmp")


def test_without_matplotlib_it_is_told_how_to_get_it(run, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)

    with pytest.raises(CartoloopError, match=r"pip install 'cartoloop\[plot\]'"):
        draw_closures(run)
