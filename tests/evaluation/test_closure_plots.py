# SPDX-License-Identifier: Apache-2.0
"""Loop closures drawn."""

from __future__ import annotations

import io

import pytest
from PIL import Image

from cartoloop.evaluation.closure_plots import closures_plot, draw_closures
from cartoloop.evaluation.finished_run import read_run
from tests.evaluation.hand_made_run import closure, hand_made_result

pytestmark = pytest.mark.slow


@pytest.fixture
def run(tmp_path):
    final = [closure(0, 5, 0.15), closure(0, 4)]
    hand_made_result(final, [closure(0, 5, 0.5)], [closure(1, 0, 0.5)]).save(tmp_path / "out")
    return read_run(tmp_path / "out")


def test_worst_closures_are_drawn_last_rejected_ones_apart(run):
    figure = pytest.importorskip("matplotlib.figure").Figure()
    draw_closures(figure, run)

    place, metres, degrees = figure.axes[:3]
    final, rejected = place.collections
    assert final.get_array().tolist() == pytest.approx([0.0, 0.15])
    assert final.get_segments()[1].tolist() == [[0.0, 0.0], [0.2, 0.1]]
    assert rejected.get_segments()[0].tolist() == [[8.0, 0.0], [0.0, 0.0]]
    labels = [text.get_text() for text in metres.get_legend().get_texts()]
    assert labels == ["final (2)", "found (1)"]
    assert "[m]" in metres.get_xlabel()
    assert "[deg]" in degrees.get_xlabel()


@pytest.mark.parametrize(("image_format", "magic"), [("png", b"\x89PNG"), ("svg", b"<?xml")])
def test_the_same_run_is_the_same_picture(run, image_format, magic):
    pytest.importorskip("matplotlib")

    picture = closures_plot(run, title="by hand", image_format=image_format)

    assert picture.startswith(magic)
    assert picture == closures_plot(run, title="by hand", image_format=image_format)


def test_a_run_without_closures_is_drawn_all_the_same(tmp_path):
    pytest.importorskip("matplotlib")
    hand_made_result().save(tmp_path / "out")

    with Image.open(io.BytesIO(closures_plot(read_run(tmp_path / "out")))) as picture:
        assert picture.size == (2000, 1000)
