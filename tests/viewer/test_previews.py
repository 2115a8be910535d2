# SPDX-License-Identifier: Apache-2.0
"""Previews show in small what submaps show."""

from __future__ import annotations

import numpy as np

from cartoloop.config import SubmapConfig
from cartoloop.map_output.evidence_sum import cell_log_odds
from cartoloop.map_output.picture import floor_and_wall
from cartoloop.submaps.finished_grid import FinishedGrid, quantize_probabilities
from cartoloop.viewer.previews import SHRINK, Preview, shrink
from tests.viewer.page_twin import Page

LOG_ODDS = cell_log_odds(SubmapConfig())


def test_pixels_are_means_of_their_cells():
    rng = np.random.default_rng(1)
    cells = rng.integers(0, 256, (17, 30)).astype(np.uint8)
    cells[:8, :12] = 0

    pixels = shrink(cells, LOG_ODDS)

    assert pixels.shape == (5, 8)
    assert not pixels[:2, :3].any()
    floor, wall = floor_and_wall(1.0 / (1.0 + np.exp(-2.0 * LOG_ODDS)))
    for row, col in np.ndindex(pixels.shape):
        square = cells[SHRINK * row : SHRINK * (row + 1), SHRINK * col : SHRINK * (col + 1)]
        known = square[square != 0]
        assert abs((pixels[row, col] & 15) - 15.0 * floor[known].sum() / 16.0) < 0.6
        assert abs((pixels[row, col] >> 4) - 15.0 * wall[known].sum() / 16.0) < 0.6


def test_a_page_knows_where_pixels_lie():
    cells = quantize_probabilities(np.full((8, 12), 0.9, np.float32))
    page = Page()

    message, token = Preview(3, FinishedGrid(cells, 1.0, -2.0, 0.05), LOG_ODDS).news(None)
    page.receive(message)

    preview = page.previews[3]
    assert (preview["x"], preview["y"]) == (1.075, -1.925)
    assert preview["resolution"] == 0.2
    assert preview["cells"].tolist() == [[0xF0] * 3] * 2
    assert Preview(3, FinishedGrid(cells, 1.0, -2.0, 0.05), LOG_ODDS).news(token)[0] == b""


def test_a_submap_without_cells_has_an_empty_preview():
    assert shrink(np.zeros((0, 0), np.uint8), LOG_ODDS).shape == (0, 0)
