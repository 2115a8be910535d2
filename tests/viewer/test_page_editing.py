# SPDX-License-Identifier: Apache-2.0
"""The page in a real browser: sessions by colour, and closures dropped and undone."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

import cartoloop
from cartoloop.viewer.view import serve_result
from tests.viewer.real_page import opened
from tests.viewer.test_editing_pages import closure_of, in_two_parts


@pytest.fixture
def folder(result, ring_result, shared_files, tmp_path):
    return shutil.copytree(shared_files.path("ring_saved", ring_result.save), tmp_path / "ring")


@pytest.fixture
def editable(chromium, folder):
    editor = cartoloop.edit(folder)
    server = serve_result(editor.map, "ring", port=0, editor=editor)
    try:
        with opened(chromium, server.url) as page:
            page.settle()
            yield page
    finally:
        server.close()
    assert server.failure is None


def test_a_closure_is_dropped_and_undone_in_its_card(editable, folder, result):
    page = editable
    page.page.keyboard.press("c")  # the card of the newest
    button = page.page.locator("#closure-edit")
    button.get_by_text("Drop this closure").wait_for()
    page.keep("closure-to-edit")
    button.click()
    page.settle("s.edits?.edits.length === 1")
    button.get_by_text("Undo edit 0").wait_for()
    assert page.page.text_content("#closure-verdict") == "Removed by an edit of the map."
    assert cartoloop.load(folder).graph.num_loop_closures == result.graph.num_loop_closures - 1
    page.keep("closure-removed")

    button.click()
    page.settle("s.edits?.edits[0].is_undone === true")
    button.get_by_text("Drop this closure").wait_for()
    assert cartoloop.load(folder).graph.num_loop_closures == result.graph.num_loop_closures
    assert page.complaints == []


def test_edits_are_undone_and_redone_in_the_list(editable, folder):
    page = editable
    page.page.keyboard.press("c")
    page.page.click("#closure-edit")
    page.settle("s.edits?.edits.length === 1")
    page.page.keyboard.press("Escape")
    page.page.click("#edits-list button")
    page.settle("s.edits?.edits[0].is_undone === true")
    page.page.locator("#edits-list .undone").wait_for()
    page.page.get_by_role("button", name="Redo edit 0").click()
    page.settle("s.edits?.edits[0].is_undone === false")

    assert not cartoloop.load(folder).edits[0].is_undone


def test_the_table_shows_what_was_removed(editable):
    page = editable
    page.page.keyboard.press("c")
    page.page.click("#closure-edit")
    page.settle("s.edits?.edits.length === 1")
    page.page.keyboard.press("Escape")
    page.page.keyboard.press("t")
    page.page.select_option("#closures-which", "removed")
    page.page.locator("#closures-rows [data-fate=removed]").wait_for()


def test_a_page_that_may_not_edit_offers_nothing(chromium, server, result):
    with opened(chromium, server.url) as page:
        page.settle()
        page.page.keyboard.press("c")
        page.page.locator("#closure").wait_for()

        assert page.page.locator("#closure-edit").is_hidden()
        assert page.page.locator("#edits").is_hidden()


@pytest.fixture
def two_parts(chromium, result):
    server = serve_result(in_two_parts(result), "ring", port=0)
    try:
        with opened(chromium, server.url) as page:
            page.settle()
            yield page
    finally:
        server.close()


def _inks(page):
    page.layers(closures=False, suspects=False, ends=False, scan=False, quality=False)
    pixels = page.pixels().astype(int)
    blue = np.abs(pixels - (0, 114, 178)).max(axis=2) < 30
    orange = np.abs(pixels - (213, 94, 0)).max(axis=2) < 30
    return np.argwhere(blue), np.argwhere(orange)


def test_sessions_have_colours_and_parts_lie_apart(two_parts):
    page = two_parts
    page.page.keyboard.press("0")
    page.settle()
    page.keep("sessions-apart")
    first, second = _inks(page)

    assert len(first) > 200 and len(second) > 200
    assert second[:, 1].min() > first[:, 1].max()  # to the right of it
    assert page.page.locator("#sessions li").count() == 2
    assert "evening: apart from the map" in page.page.text_content("#sessions")


def test_the_pair_is_found_again_after_an_edit(editable, result):
    submap, node = closure_of(result)
    page = editable
    page.page.keyboard.press("c")
    page.page.locator("#closure").wait_for()
    title = page.page.text_content("#closure-title")
    page.page.click("#closure-edit")
    page.settle("s.edits?.edits.length === 1 && s.closure !== null")

    assert page.page.text_content("#closure-title") == title == f"Node {node} in submap {submap}"
