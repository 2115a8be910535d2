# SPDX-License-Identifier: Apache-2.0
"""What a surveyor does with a finished map in a real browser: measures, judges, compares."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from cartoloop.evaluation.lines import measure_lines, read_lines
from cartoloop.evaluation.map_image import read_map
from cartoloop.global_slam.pose_graph import ConstraintKind
from cartoloop.map_output.map_facts import map_facts
from cartoloop.viewer.feed import poses_before, rejected_closures
from cartoloop.viewer.view import serve_result
from tests.viewer.real_page import SIZE, opened

WIDTH, CELL = 2.08, 0.05
"""Between the walls of the ring's corridors, and edge of a cell [m]."""


@pytest.fixture
def page(shared):
    """The page as it was opened, with nothing measured."""
    keyboard = shared.page.keyboard
    for _ in range(2):
        keyboard.press("Escape")
    if shared.state["before"]:
        keyboard.press("b")
    keyboard.press("m")
    shared.page.click("#measures-clear")
    shared.page.check("[name=measure][value=length]")
    keyboard.press("Escape")
    keyboard.press("0")
    shared.settle("s.measures.length === 0 && !s.before")
    return shared


def measure(page, kind, points, *, end=False):
    """Put down points [m, map] while measuring."""
    page.page.check(f"[name=measure][value={kind}]")
    for point in points:
        page.page.mouse.click(*page.to_screen(*point))
    if end:
        page.page.keyboard.press("Enter")
    page.settle()


def test_escape_closes_the_help_and_nothing_else(page):
    page.page.keyboard.press("m")
    page.page.keyboard.press("?")
    assert page.page.is_visible("#help")
    page.page.keyboard.press("Escape")
    page.page.locator("#help").wait_for(state="hidden")
    assert page.page.is_visible("#measures")


def test_keys_work_after_a_choice_was_clicked(page):
    page.page.keyboard.press("m")
    page.page.check("[name=measure][value=area]")
    page.page.keyboard.press("g")
    page.page.locator("#grid-step").wait_for()
    page.page.keyboard.press("g")
    page.page.keyboard.press("m")
    assert page.page.is_hidden("#measures")


def test_facts_of_the_map_stand_in_the_panel(page, result):
    rows = page.page.locator("#facts div")
    names, values = (rows.locator(tag).all_text_contents() for tag in ("dt", "dd"))
    shown = dict(zip(names, values, strict=True))

    assert {name: shown[name] for name, _ in map_facts(result).described()} == dict(
        map_facts(result).described()
    )
    assert page.page.is_hidden("#read-time")


def test_a_stopped_run_is_not_shown_in_green(chromium, result):
    server = serve_result(
        replace(result, report=replace(result.report, finished=False)), "ring", port=0
    )
    try:
        with opened(chromium, server.url) as page:
            page.settle()
            assert "stopped" in page.page.text_content("#state")
            stopped, good = page.page.evaluate(
                """() => [getComputedStyle(document.getElementById("state-dot")).backgroundColor,
                    getComputedStyle(document.documentElement).getPropertyValue("--good")]"""
            )
            assert stopped != f"rgb{tuple(int(good[at : at + 2], 16) for at in (1, 3, 5))}"
            assert "stopped" in page.page.text_content("#facts")
    finally:
        server.close()


def test_the_building_fills_the_screen_and_not_stray_rays(page, result):
    extent = map_facts(result).extent
    left, top = page.to_screen(extent.left, extent.top)
    right, bottom = page.to_screen(extent.right, extent.bottom)

    free = (
        288,
        0,
        SIZE[0] - 66,
        SIZE[1] - 74,
    )  # beside the panel and the tools, above the bar of time
    assert free[0] <= left < right <= free[2] and free[1] <= top < bottom <= free[3]
    assert max((right - left) / (free[2] - free[0]), (bottom - top) / (free[3] - free[1])) > 0.9


def test_on_a_phone_the_map_is_in_the_middle(chromium, server, result):
    with opened(chromium, server.url, (390, 844), has_touch=True, is_mobile=True) as page:
        page.settle()
        extent = map_facts(result).extent
        middle = (extent.left + extent.right) / 2.0, (extent.bottom + extent.top) / 2.0
        assert abs(page.to_screen(*middle)[1] - 422.0) < 80.0
        left, right = (page.to_screen(x, 0.0)[0] for x in (extent.left, extent.right))
        assert right - left > 0.85 * 390


def test_on_a_phone_a_card_is_before_the_table(chromium, server):
    with opened(chromium, server.url, (390, 844), has_touch=True, is_mobile=True) as page:
        page.settle()
        page.page.click("#panel-toggle")
        page.page.click("#closures-button")
        page.page.locator("#closures-rows tr[data-row]").first.click()
        page.settle("s.closure !== null")
        assert page.page.is_hidden("#closures")
        page.page.click("#closure-close")
        page.page.click("#closures-close")
        assert page.page.is_hidden("#closures")


def test_zooming_out_ends_while_the_map_can_be_seen(page, result):
    for _ in range(60):
        page.page.keyboard.press("-")
    page.settle()
    extent = map_facts(result).extent
    assert page.view["scale"] * max(extent.width, extent.height) > 0.2 * SIZE[1]
    page.page.keyboard.press("+")
    page.settle()


def test_coordinates_under_the_pointer_are_shown(page):
    page.look(3.0, -2.0, 50.0)
    x, y = SIZE[0] // 2, SIZE[1] // 2
    page.page.mouse.move(x, y)
    assert page.page.text_content("#readout") == "x 3.00  y −2.00 m"
    page.page.mouse.move(x + 100, y - 50)
    assert page.page.text_content("#readout") == "x 5.00  y −1.00 m"
    page.page.mouse.move(100, 100)  # over the panel
    page.page.locator("#readout").wait_for(state="hidden")


def test_the_grid_is_in_whole_metres(page):
    page.layers(trajectory=False, suspects=False, closures=False, ends=False, scan=False)
    page.look(1000.0, 1000.0, 80.0)  # beside the map
    without = page.pixels()
    page.page.keyboard.press("g")
    page.settle()
    changed = (page.pixels() != without).any(axis=2)
    assert page.page.text_content("#grid-step") == "grid 1 m"
    lines = np.flatnonzero(changed.mean(axis=0) > 0.9)
    expected = [page.to_screen(x, 0.0)[0] for x in range(992, 1009)]
    found = lines[np.flatnonzero(np.diff(lines, prepend=-9) > 2)]
    inside = [x for x in expected if 2 < x < SIZE[0] - 2]
    np.testing.assert_allclose(found[(found > 2) & (found < SIZE[0] - 2)], inside, atol=1.5)
    page.page.keyboard.press("g")
    page.layers(trajectory=True, suspects=True, ends=True, scan=True)


def test_start_and_end_of_the_way_are_marked(page, result):
    page.look(*result.trajectory[0, :2], 30.0)
    labels = page.page.locator("#marks-layer text")
    assert labels.all_text_contents() == ["Start", "End"]
    page.layers(ends=False)
    page.settle()
    assert labels.count() == 0
    page.layers(ends=True)


def test_what_was_measured_is_listed_and_can_be_deleted(page):
    page.page.keyboard.press("m")
    page.look(4.0, 0.0, 40.0)
    measure(page, "length", [(3.95, -0.95), (4.05, 1.15)])
    measure(page, "angle", [(1.0, 0.0), (2.0, 0.0), (2.0, 0.8)])
    measure(page, "area", [(0.0, -0.5), (1.5, -0.5), (1.5, 0.5), (0.0, 0.5)], end=True)

    length, angle, area = page.state["measures"]
    assert float(length.removesuffix(" m")) == pytest.approx(WIDTH, abs=0.6 * CELL)
    assert float(angle.removesuffix("°")) == pytest.approx(90.0, abs=1.5)
    assert float(area.removesuffix(" m²")) == pytest.approx(1.5, abs=0.05)
    rows = page.page.locator("#measures-list li")
    assert rows.locator("strong").all_text_contents() == [length, angle, area]
    assert "from wall to wall" in rows.first.text_content()
    page.keep("measurements")

    rows.nth(1).get_by_label("Delete measurement 2").click()
    assert page.state["measures"] == [length, area]


def test_measurements_outlive_the_page(page):
    page.page.keyboard.press("m")
    page.look(4.0, 0.0, 60.0)
    measure(page, "length", [(3.95, -0.95), (4.05, 1.15)])
    before = page.state["measures"]
    page.page.reload()
    page.settle("s.measures.length === 1")
    page.page.keyboard.press("m")
    assert page.settle()["measures"] == before


def test_an_area_ends_at_its_first_corner_and_escape_drops_it(page):
    page.page.keyboard.press("m")
    page.look(4.0, 0.0, 60.0)
    corners = [(3.0, -0.5), (5.0, -0.5), (5.0, 0.5)]
    measure(page, "area", [*corners, (3.02, -0.5)])
    assert len(page.state["measures"]) == 1
    measure(page, "area", corners[:2])
    page.page.keyboard.press("Escape")
    assert page.page.is_visible("#measures")
    page.page.keyboard.press("Enter")
    assert len(page.state["measures"]) == 1


def test_evaluate_lines_reads_what_the_view_saves(page, result, tmp_path):
    page.page.keyboard.press("m")
    page.look(4.0, 0.0, 40.0)
    measure(page, "angle", [(1.0, 0.0), (2.0, 0.0), (2.0, 0.8)])
    page.page.click("#measures-save")
    assert "measure one first" in page.page.text_content("#hint")
    measure(page, "length", [(3.95, -0.95), (4.05, 1.15)])
    measure(page, "length", [(5.95, -0.95), (6.05, 1.15)])
    page.page.get_by_label("Length 2 by a tape").fill("2,08")
    page.page.get_by_label("Length 2 by a tape").press("Tab")
    with page.page.expect_download() as download:
        page.page.click("#measures-save")
    assert download.value.suggested_filename == "ring.lines"
    download.value.save_as(tmp_path / "ring.lines")
    result.save(tmp_path)

    error = measure_lines(read_map(tmp_path / "map.yaml"), read_lines(tmp_path / "ring.lines"))

    assert [line.tape for line in error.lines] == [WIDTH, None]
    for line, shown in zip(error.lines, page.state["measures"][1:], strict=True):
        # The page shows centimetres, and walls are found to a fraction of a cell.
        assert line.length == pytest.approx(float(shown.removesuffix(" m")), abs=0.015)


def test_a_finished_map_shows_suspects_before_all_closures(chromium, server, result):
    with opened(chromium, server.url) as page:
        state = page.settle()
        num_rejected = len(rejected_closures(result.closures).kinds)
        assert state["suspects"]["rejected"] == num_rejected
        assert state["suspects"]["shown"] == state["suspects"]["violated"] + num_rejected
        page.layers(closures=True)
        assert page.settle()["suspects"]["shown"] > 10 + state["suspects"]["shown"]


def test_closures_in_a_table_are_sorted_filtered_and_opened(page, result):
    graph, rejected = result.graph, rejected_closures(result.closures)
    in_graph = graph.kinds == ConstraintKind.LOOP_CLOSURE
    page.page.keyboard.press("t")
    rows = page.page.locator("#closures-rows tr[data-row]")
    rows.first.wait_for()
    total = int(np.count_nonzero(in_graph)) + len(rejected.kinds)
    assert page.page.text_content("#closures-title") == f"{total} loop closures"

    page.page.get_by_role("button", name="node").click()
    nodes = np.sort(np.concatenate((graph.index_b[in_graph], rejected.index_b)))
    assert column(rows, 1)[:5] == nodes[:5].tolist()
    page.page.get_by_role("button", name="node").click()
    assert column(rows, 1)[:5] == nodes[::-1][:5].tolist()
    page.keep("closures-table")

    node = int(nodes[0])
    page.page.fill("#closures-filter", str(node))
    assert set(column(rows, 1)) | set(column(rows, 0)) >= {node}
    count = np.count_nonzero(
        np.concatenate(
            (
                (graph.index_b[in_graph] == node) | (graph.index_a[in_graph] == node),
                (rejected.index_b == node) | (rejected.index_a == node),
            )
        )
    )
    assert page.page.text_content("#closures-title").startswith(f"{count} of ")
    rows.first.click()
    state = page.settle("s.closure !== null")
    assert state["closure"] == int(rows.first.get_attribute("data-row"))

    page.page.fill("#closures-filter", "no number")
    assert page.page.is_visible("#closures-none")
    page.page.fill("#closures-filter", "")
    page.page.select_option("#closures-which", "rejected")
    assert page.page.text_content("#closures-title").startswith(f"{len(rejected.kinds)} of")
    page.page.select_option("#closures-which", "all")


def column(rows, number):
    texts = rows.locator(f"td:nth-child({number + 1})").all_text_contents()
    return [int(text.replace(",", "")) for text in texts]


def test_the_map_before_loop_closure_can_be_seen(page, result):
    after = page.pixels()
    page.page.keyboard.press("b")
    page.settle("s.before")
    assert page.page.is_visible("#before-note")
    assert np.count_nonzero((page.pixels() != after).any(axis=2)) > 1_000
    page.keep("before")
    row = int(np.flatnonzero(result.graph.kinds == ConstraintKind.LOOP_CLOSURE)[-1])
    x, y = poses_before(result).tf_map_nodes[result.graph.index_b[row], :2]
    shown = page.page.evaluate("row => cartoloop.constraint(row).to", row)
    assert shown == pytest.approx(page.to_screen(x, y), abs=0.1)
    page.page.keyboard.press("b")
    page.settle("!s.before")
    assert np.array_equal(page.pixels(), after)


def test_a_closure_brought_into_sight_is_seen_close(page):
    page.page.keyboard.press("c")
    page.settle("s.closure !== null")
    assert page.view["scale"] > 25.0  # 20 m at most on the free part of the screen
    assert re.fullmatch(r"\d+%", page.page.text_content("#closure-overlap"))
    assert page.page.locator("meter").count() == 0  # each browser has colours of its own for it


def test_name_facts_and_scale_are_in_the_saved_picture(page, result):
    page.look(0.0, 0.0, 50.0)
    page.page.keyboard.press("s")
    with page.page.expect_download() as download:
        page.page.click("#save-view")
    with Image.open(download.value.path()) as picture:
        pixels = np.asarray(picture.convert("RGB")).astype(int)
    foot = pixels[-44:]
    dark = foot.max(axis=2) < 130
    assert (foot.min(axis=2) > 250).mean() > 0.85
    assert dark[:, :200].sum() > 100  # the name
    rows, cols = np.nonzero(dark[:, SIZE[0] - 260 :])
    runs = [np.ptp(cols[rows == row]) for row in np.unique(rows)]
    assert math.isclose(max(dark[:, SIZE[0] - 260 :].sum(axis=1)), 100, abs_tol=8), runs  # 2 m
