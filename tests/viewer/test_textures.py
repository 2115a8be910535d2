# SPDX-License-Identifier: Apache-2.0
"""Growing submaps are sent in patches that add up, whatever a page has missed."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop.config import SubmapConfig
from cartoloop.kernels.map_composition import cell_evidence
from cartoloop.map_output.evidence_sum import cell_log_odds
from cartoloop.submaps.finished_grid import FinishedGrid, quantize_probabilities
from cartoloop.viewer.feed import GrowingCells
from cartoloop.viewer.protocol import MessageType, messages
from cartoloop.viewer.textures import MAX_PATCHES, FinishedTexture, GrowingTexture, drawn_cells
from tests.viewer.page_twin import Page

LOG_ODDS = cell_log_odds(SubmapConfig())


def grid(cells, origin=(0.0, 0.0)):
    return GrowingCells(3, cells, *origin, 0.05)


def kind_of(message):
    return next(messages(message)).type


@pytest.fixture
def cells():
    rng = np.random.default_rng(1)
    cells = rng.uniform(0.1, 0.9, (60, 80)).astype(np.float32)
    cells[rng.random(cells.shape) < 0.5] = 0.0
    return cells


def test_the_evidence_of_drawn_cells_is_that_of_the_map(cells):
    values = np.pad(quantize_probabilities(cells), 1)
    expected = np.empty(values.shape, np.float32)
    cell_evidence(values, LOG_ODDS, expected)

    drawn = drawn_cells(values[1:-1, 1:-1])

    assert np.array_equal(LOG_ODDS[drawn], expected[1:-1, 1:-1])
    assert np.array_equal(drawn != 0, cells != 0.0)


def test_patches_add_up_to_the_whole_whatever_was_missed(cells):
    rng = np.random.default_rng(2)
    texture = GrowingTexture(3)
    pages = {1: Page(), 2: Page(), 7: Page()}
    seen = dict.fromkeys(pages)
    for step in range(1, 60):
        if step == 30:
            cells = np.pad(cells, 5)
        row, col = rng.integers(0, 50, 2)
        cells[row : row + 8, col : col + 8] = rng.uniform(0.1, 0.9, (8, 8))
        origin = (0.0, 0.0) if step < 30 else (-0.25, -0.25)
        assert texture.set(grid(cells, origin))
        for period, page in pages.items():
            if step % period == 0:
                message, seen[period] = texture.news(seen[period])
                page.receive(message)
                values = quantize_probabilities(cells)
                shown = page.submaps[3]["cells"]
                assert np.array_equal(shown, drawn_cells(values)), (step, period)
    assert [kind == MessageType.SUBMAP for kind in pages[1].order].count(True) == 2
    assert pages[7].order.count(MessageType.SUBMAP_PATCH) >= 5
    assert pages[7].submaps[3]["x"] == -0.25


def test_a_patch_is_no_larger_than_the_change(cells):
    texture = GrowingTexture(3)
    texture.set(grid(cells))
    whole, seen = texture.news(None)
    cells[10, 20] = 0.85
    texture.set(grid(cells))

    patch, _ = texture.news(seen)

    payload = next(messages(patch)).payload
    assert np.frombuffer(payload, "<u4", 7).tolist() == [3, 1, 2, 9, 19, 3, 3]
    assert len(patch) < 0.1 * len(whole)


def test_nothing_is_sent_when_nothing_has_changed(cells):
    texture = GrowingTexture(3)
    assert texture.set(grid(cells))
    assert not texture.set(grid(cells))
    _, seen = texture.news(None)

    assert texture.news(seen) == (b"", seen)


def test_one_that_missed_too_much_gets_the_whole(cells):
    texture = GrowingTexture(3)
    texture.set(grid(cells))
    _, seen = texture.news(None)
    for step in range(MAX_PATCHES + 1):
        cells[0, step] = 0.5 if cells[0, step] != 0.5 else 0.6
        texture.set(grid(cells))

    message, _ = texture.news(seen)

    assert kind_of(message) == MessageType.SUBMAP


def test_a_message_is_made_once_for_all_pages(cells):
    texture = GrowingTexture(3)
    texture.set(grid(cells))

    assert texture.news(None)[0] is texture.news(None)[0]


def test_a_finished_submap_is_sent_once(cells):
    finished = FinishedTexture(3, 5, FinishedGrid(quantize_probabilities(cells), 1.0, 2.0, 0.05))

    message, seen = finished.news((0, 4))

    page = Page()
    page.receive(message)
    assert page.submaps[3]["finished"] == 1
    assert (page.submaps[3]["x"], page.submaps[3]["y"]) == (1.0, 2.0)
    assert finished.news(seen) == (b"", seen)


def test_a_submap_may_be_empty():
    empty = FinishedGrid(np.zeros((0, 0), np.uint8), 0.0, 0.0, 0.05)

    page = Page()
    page.receive(FinishedTexture(0, 1, empty).news(None)[0])

    assert page.submaps[0]["cells"].shape == (0, 0)
