# SPDX-License-Identifier: Apache-2.0
"""Places that may be wrong: sent with a finished map, and on the page a layer and a list."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cartoloop.quality.verdict import Kind, Place, Quality, Severity
from cartoloop.viewer.protocol import MessageType
from cartoloop.viewer.view import serve_result
from tests.viewer.page_twin import join, look
from tests.viewer.real_page import opened

WRONG = Place(
    20.0, 0.5, 2.0, 1.0, 9.0, Kind.CONTRADICTION, Severity.WRONG, "walls stand twice", "drive again"
)
QUALITY = Quality("wrong", (WRONG, replace(WRONG, x=0.0, severity=Severity.MINOR)), {"gaps": 0.0})


@pytest.fixture(scope="module")
def doubted(result):
    """Shows the ring, with a place that is called wrong."""
    report = replace(result.report, quality=QUALITY)
    server = serve_result(replace(result, report=report), "ring", port=0)
    yield server
    server.close()
    assert server.failure is None


def test_the_verdict_is_sent_with_a_finished_map(doubted):
    with join(doubted.url) as connection:
        sent = look(connection).json[MessageType.QUALITY]

    assert (sent["verdict"], len(sent["places"])) == ("wrong", 2)
    assert sent["places"][0]["reason"] == "walls stand twice"
    assert sent["places"][0]["severity"] == "wrong"


def test_places_are_listed_and_shown_where_they_are(chromium, doubted):
    with opened(chromium, doubted.url) as page:
        page.settle("s.quality !== null")
        assert page.page.text_content("#read-quality") == "wrong"
        buttons = page.page.locator("#places button")
        assert buttons.all_text_contents() == [
            "wrong: walls stand twice",
            "minor: walls stand twice",
        ]
        page.keep("places")
        buttons.first.click()
        page.wait(
            "Math.hypot(cartoloop.view.x - x[0], cartoloop.view.y - x[1]) < 3.0", [WRONG.x, WRONG.y]
        )


def test_a_wrong_place_is_a_circle_that_can_be_hidden(chromium, doubted):
    with opened(chromium, doubted.url) as page:
        page.settle("s.quality !== null")
        page.look(WRONG.x, WRONG.y, 60.0)
        page.layers(trajectory=False, closures=False, latest=False, scan=False)
        shown = page.pixels().astype(int)
        page.layers(quality=False)
        hidden = page.pixels().astype(int)

        rows, cols = np.nonzero(np.abs(shown - hidden).max(axis=2) > 60)
        x, y = page.to_screen(WRONG.x, WRONG.y)
        apart = np.hypot(cols - x, rows - y)
        assert len(rows) > 200
        assert apart.min() > 0.9 * 60.0 * WRONG.radius
        assert apart.max() < 1.1 * 60.0 * WRONG.radius
