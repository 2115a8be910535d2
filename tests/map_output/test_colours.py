# SPDX-License-Identifier: Apache-2.0
"""What must be distinguished on maps can be: WCAG's ratios of contrast, in light and dark."""

from __future__ import annotations

from itertools import pairwise

import pytest

from cartoloop.map_output.colours import (
    DARK,
    INK,
    LIGHT,
    MIN_CONTRAST,
    MIN_TEXT_CONTRAST,
    PLACE_COLOURS,
    contrast,
    text_colour,
)
from cartoloop.map_output.picture import NEUTRAL, palette

GREYS = [(value, value, value) for value in (0, 60, 120, 180, 255)]


def test_contrast_is_that_of_the_guidelines():
    assert contrast((0, 0, 0), (255, 255, 255)) == pytest.approx(21.0)
    assert contrast((119, 119, 119), (255, 255, 255)) == pytest.approx(4.48, abs=0.005)
    assert all(contrast(a, b) > 1.0 for a, b in pairwise(GREYS))
    assert contrast(GREYS[1], GREYS[3]) == contrast(GREYS[3], GREYS[1])


@pytest.mark.parametrize("colours", [LIGHT, DARK], ids=["light", "dark"])
def test_free_unknown_and_walls_are_distinguished(colours):
    assert contrast(colours.floor, colours.ground) >= MIN_CONTRAST
    assert contrast(colours.wall, colours.floor) >= MIN_TEXT_CONTRAST
    assert contrast(colours.wall, colours.ground) >= MIN_TEXT_CONTRAST


def test_text_of_pictures_can_be_read():
    assert contrast(INK, LIGHT.ground) >= MIN_TEXT_CONTRAST
    for colour in PLACE_COLOURS.values():
        assert contrast(text_colour(colour), colour) >= MIN_TEXT_CONTRAST


def test_free_cells_of_pictures_stand_out_of_unknown_ones():
    """From where a cell counts as free in ``map.yaml``, that is, at most as probable as unknown."""
    table = [tuple(row) for row in palette().tolist()]

    assert table[256] == LIGHT.ground
    assert contrast(table[round(0.196 * 255)], table[256]) >= MIN_CONTRAST
    assert table[255] == LIGHT.wall
    assert table[NEUTRAL] == table[256]
