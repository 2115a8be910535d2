# SPDX-License-Identifier: Apache-2.0
"""The page in a real browser, with a finished map: what it shows, and what hands do to it."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from PIL import Image

from cartoloop.global_slam.pose_adjustment import constraint_residuals
from cartoloop.global_slam.pose_graph import ConstraintKind
from cartoloop.map_output.occupancy_map import compose_map
from cartoloop.map_output.picture import palette
from cartoloop.viewer.feed import rejected_closures
from cartoloop.viewer.view import serve_result
from tests.viewer.real_page import SIZE, opened

WIDTH, CELL = 2.08, 0.05
"""Between the walls of the ring's corridors [m], and the map's x axis is in the middle of one,
and edge of a cell of the map, which is as exact as it can be measured."""


@pytest.fixture
def page(shared):
    """The page as it is when it was opened."""
    shared.page.keyboard.press("Escape")
    shared.layers(
        trajectory=True, scan=True, nodes=False, closures=True, constraints=False, latest=True,
        suspects=True, ends=True, grid=False,
    )  # fmt: skip
    shared.page.keyboard.press("0")
    shared.settle()
    return shared


def test_it_loads_without_a_complaint_under_its_own_policy(chromium, server, result):
    with opened(chromium, server.url, bypass_csp=False) as page:
        page.page.get_by_text("finished", exact=True).wait_for()
        page.page.locator("body[data-connection=connected]").wait_for()
        assert page.page.title()
        assert page.page.text_content("#name") == "ring"
        scans = int(page.page.text_content("#read-scans").split("/")[0].replace(",", ""))
        assert scans == result.report.input.scans
        for key in ("t", "Escape", "m", "Escape", "g", "b", "c"):
            page.page.keyboard.press(key)
        page.page.locator("#before-note").wait_for()
        page.page.locator("#closure").wait_for()


def test_all_submaps_appear(page, result):
    assert page.state["counts"]["submaps"] == result.graph.num_submaps
    num_rejected = len(rejected_closures(result.closures).kinds)
    assert page.state["counts"]["constraints"] == result.graph.num_constraints + num_rejected
    pixels = page.pixels()
    assert np.count_nonzero(pixels.min(axis=2) > 245) > 5_000  # floor
    assert np.count_nonzero(pixels.max(axis=2) < 90) > 500  # walls
    page.keep("finished")


def test_the_screen_shows_the_exported_map(page, result):
    """At one pixel a cell, both being of the same lattice."""
    exported = compose_map(
        result.submap_grids, result.graph.submap_poses, result.config.local_slam.submaps
    )
    level = np.where(exported.probability < 0.0, 256, np.rint(exported.probability * 255.0))
    expected = palette()[level.astype(int)].astype(int)[::-1]  # row 0 on top
    rows, cols = level.shape
    assert cols <= SIZE[0] and rows <= SIZE[1]
    page.layers(trajectory=False, closures=False, suspects=False, ends=False, scan=False)
    edge = exported.resolution
    # the middle of the screen is a corner of cells
    middle = exported.origin_x + cols // 2 * edge, exported.origin_y + (rows - rows // 2) * edge
    page.look(*middle, 1.0 / edge)

    pixels = page.pixels().astype(int)

    top, left = SIZE[1] // 2 - rows // 2, SIZE[0] // 2 - cols // 2
    shown = pixels[top : top + rows, left : left + cols]
    difference = np.abs(shown - expected).max(axis=2)
    # Submaps that are not turned have cells exactly between two others, at their rims.
    assert (difference > 2).mean() < 0.005
    assert (difference > 2)[level != 256].mean() < 0.01
    assert (difference == 0).mean() > 0.9
    assert len(np.unique(expected[..., 0])) > 50


def test_the_tape_measures_from_wall_to_wall_within_a_cell(page):
    """Twice across a corridor, at some angle to it, and with the map turned."""
    page.page.click("#tape")
    for rotation in (0.0, 0.7):
        page.look(4.0, 0.0, 60.0, rotation)
        for x, y in ((3.95, -0.95), (4.05, 1.15)):
            page.page.mouse.click(*page.to_screen(x, y))
        tape = page.settle("s.tape?.onWalls === 2")["tape"]
        assert abs(tape["metres"] - WIDTH) < 0.6 * CELL
        assert f"{tape['metres']:.2f} m" in page.page.text_content("#tape-layer")
    page.keep("tape")
    page.page.keyboard.press("Escape")
    assert page.state["tape"] is None


def test_a_tape_is_in_the_picture_that_is_saved(page):
    page.look(0.0, 0.0, 40.0)
    page.page.keyboard.press("m")
    middle = SIZE[1] // 2
    for x in (340, 540):
        page.page.mouse.click(x, middle)
    page.page.keyboard.press("s")
    with page.page.expect_download() as download:
        page.page.click("#save-view")
    page.page.keyboard.press("Escape")
    with Image.open(download.value.path()) as picture:
        around = np.asarray(picture.convert("RGB"))[middle - 20 : middle + 20, 400:480]
    assert np.count_nonzero((around == (0, 114, 178)).all(axis=2)) > 500  # its label


def test_key_opens_the_newest_closure(page, result):
    page.page.keyboard.press("c")
    state = page.wait("s.closure !== null")
    kinds = np.asarray(result.graph.kinds)
    assert state["closure"] == np.flatnonzero(kinds == ConstraintKind.LOOP_CLOSURE)[-1]
    page.page.keyboard.press("Escape")
    page.wait("s.closure === null")


def test_tape_measures_between_points_without_walls(page):
    page.page.click("#tape")
    page.look(4.0, 0.0, 100.0)
    for x, y in ((3.0, 0.1), (5.0, 0.1)):
        page.page.mouse.click(*page.to_screen(x, y))
    tape = page.settle("s.tape")["tape"]
    assert tape["onWalls"] == 0
    assert abs(tape["metres"] - 2.0) < 2.0 / 100.0


def test_click_on_a_closure_opens_its_card(page, result):
    graph = result.graph
    row = int(np.flatnonzero(graph.kinds == ConstraintKind.LOOP_CLOSURE)[0])
    x, y = graph.node_poses[graph.index_b[row], :2]
    page.look(x, y, 200.0)
    page.page.mouse.click(*page.page.evaluate("row => cartoloop.constraint(row).to", row))
    row = page.settle("s.closure !== null")["closure"]
    assert graph.kinds[row] == ConstraintKind.LOOP_CLOSURE
    card = {
        name: page.page.text_content(f"#closure-{name}")
        for name in ("title", "score", "runner", "residual", "verdict")
    }
    assert card["title"] == f"Node {graph.index_b[row]} in submap {graph.index_a[row]}"
    closures, place = result.closures, graph.closure_rows[row]
    if closures.score[place] > 0.0:
        assert number(card["score"]) == pytest.approx(closures.score[place], abs=0.006)
    if closures.runner_up[place] > 0.0:
        assert number(card["runner"]) == pytest.approx(closures.runner_up[place], abs=0.006)
    metres, radians = constraint_residuals(graph, np.array([row]))
    unit = 0.01 if " cm" in card["residual"] else 0.001 if " mm" in card["residual"] else 1.0
    assert unit * number(card["residual"]) == pytest.approx(metres[0], rel=0.1, abs=2e-4)
    assert number(card["residual"].split(",")[1]) == pytest.approx(
        np.degrees(radians[0]), abs=0.006
    )
    assert number(page.page.text_content("#closure-fit")) == pytest.approx(
        closures.residual[place], abs=0.006
    )
    assert scans_drawn(page) > 200
    page.keep("closure")
    page.page.click("#closure-next")
    assert page.wait("s.closure !== null && s.closure !== x", row)["closure"] > row
    page.page.keyboard.press("Escape")
    assert page.wait("s.closure === null")


def test_a_click_beside_closures_opens_nothing(page):
    page.look(100.0, 100.0, 50.0)
    page.page.mouse.click(*page.to_screen(100.0, 100.0))
    assert page.settle()["closure"] is None
    assert page.page.is_hidden("#closure")


@pytest.mark.parametrize(
    "layer", ["trajectory", "nodes", "closures", "constraints", "grid", "ends"]
)
def test_layers_can_be_shown_and_hidden(page, layer):
    page.layers(**{layer: False})
    without = page.pixels()
    page.layers(**{layer: True})
    shown = page.pixels()
    assert np.count_nonzero((without != shown).any(axis=2)) > 50
    page.layers(**{layer: False})
    assert np.array_equal(page.pixels(), without)


def test_constraints_can_be_coloured_by_residual(page):
    page.layers(constraints=True)
    by_kind = page.pixels()
    page.page.click("#layers-button")
    page.page.check("[name=colouring][value=residual]")
    page.keep("layers")
    page.page.click("#layers-button")
    assert np.count_nonzero((page.pixels() != by_kind).any(axis=2)) > 50
    page.page.click("#layers-button")
    page.page.check("[name=colouring][value=kind]")
    page.page.click("#layers-button")
    assert np.array_equal(page.pixels(), by_kind)


def test_it_is_dark_when_it_is_wanted_dark(page):
    light = page.pixels()
    page.page.keyboard.press("d")
    page.settle("s.theme === 'dark'")
    assert page.pixels().mean() < light.mean() / 2.0
    page.keep("dark")
    page.page.keyboard.press("d")
    page.settle("s.theme === 'light'")
    assert np.array_equal(page.pixels(), light)


def test_mouse_and_keys_move_the_map(page):
    page.look(5.0, 5.0, 20.0)
    mouse, (x, y) = page.page.mouse, (SIZE[0] // 2, SIZE[1] // 2)
    mouse.move(x, y)
    mouse.down()
    mouse.move(x + 60, y)
    mouse.move(x + 100, y - 50)
    mouse.up()
    view = page.settle() and page.view
    assert (view["x"], view["y"]) == (pytest.approx(0.0), pytest.approx(2.5))
    under = page.page.evaluate("cartoloop.toMap([700, 240])")
    mouse.move(700, 240)
    mouse.wheel(0, -300)
    page.wait("cartoloop.view.scale > 25")
    assert page.page.evaluate("cartoloop.toMap([700, 240])") == pytest.approx(under)
    page.page.keyboard.press("]")
    page.wait("cartoloop.view.rotation !== 0")
    page.page.keyboard.press("n")
    page.wait("Math.abs(cartoloop.view.rotation) < 1e-9")


def test_reloading_brings_back_what_was_seen(page, result):
    page.look(3.0, 2.0, 40.0, 0.3)
    page.page.wait_for_url("**#view=3.000,2.000,40.000,*")
    before = page.pixels()
    page.page.reload()
    page.settle("s.counts.submaps === x", result.graph.num_submaps)
    view = page.view
    assert [view[name] for name in ("x", "y", "scale")] == [3.0, 2.0, 40.0]
    assert view["rotation"] == pytest.approx(0.3, abs=1e-3)
    changed = (np.abs(page.pixels().astype(int) - before) > 8).any(axis=2)
    assert changed.mean() < 0.02  # the angle in the address is rounded
    page.look(0.0, 0.0, 20.0)


def test_a_second_viewer_sees_the_same(page, chromium, server):
    page.look(2.0, 2.0, 15.0)
    with opened(chromium, server.url) as other:
        other.settle()
        other.layers(closures=True)
        other.look(2.0, 2.0, 15.0)
        assert np.array_equal(other.pixels(), page.pixels())


def test_a_finished_map_can_be_looked_at_as_of_any_time(page, result):
    page.layers(trajectory=False, closures=False, suspects=False, ends=False, scan=False)
    now = page.pixels()
    page.page.fill("#scrub", "300")
    time = page.settle("s.time !== null")["time"]
    stamps = result.stamps
    assert stamps[0] <= time <= stamps[-1]
    assert abs((time - stamps[0]) / (stamps[-1] - stamps[0]) - 0.3) < 0.05
    then = page.pixels()
    assert np.count_nonzero(then.min(axis=2) > 245) < np.count_nonzero(now.min(axis=2) > 245)
    page.page.fill("#scrub", "1000")
    page.settle("s.time === null")
    assert np.array_equal(page.pixels(), now)


def test_the_map_can_be_saved(page, result):
    page.page.keyboard.press("s")
    with page.page.expect_download() as download:
        page.page.click("#save-map")
    with Image.open(download.value.path()) as picture:
        assert picture.format == "PNG"
        assert min(picture.size) > 400
    page.page.keyboard.press("s")
    with page.page.expect_download() as download:
        page.page.click("#save-view")
    with Image.open(download.value.path()) as picture:
        assert picture.size == SIZE
        assert np.asarray(picture.convert("RGB")).std() > 3.0


def test_lost_server_is_reported_and_found_again(chromium, result):
    server = serve_result(result, "ring", port=0)
    port = server.port
    with opened(chromium, server.url) as page:
        page.settle()
        session = page.state["session"]
        server.close()
        page.page.locator("#banner").wait_for()
        assert "No connection" in page.page.text_content("#banner")
        assert page.state["counts"]["submaps"] == result.graph.num_submaps  # still to be seen
        page.keep("no-connection")
        server = serve_result(result, "ring", port=port)
        try:
            assert server.port == port
            page.settle("s.session !== x", session)
            page.page.locator("#banner").wait_for(state="hidden")
            assert page.state["counts"]["submaps"] == result.graph.num_submaps
        finally:
            server.close()


def test_fingers_move_zoom_and_turn_the_map_on_a_phone(chromium, server):
    with opened(
        chromium, server.url, (390, 844), has_touch=True, is_mobile=True, device_scale_factor=2
    ) as page:
        page.settle()
        page.keep("phone")
        page.look(5.0, 5.0, 20.0)
        fingers = Fingers(page)
        fingers.move([(200, 500)], [(240, 480)])
        page.settle("Math.abs(cartoloop.view.x - 3) < 0.26")
        assert page.view["y"] == pytest.approx(4.0, abs=0.26)

        page.look(5.0, 5.0, 20.0)
        under = page.page.evaluate("cartoloop.toMap([195, 450])")
        fingers.move([(145, 450), (245, 450)], [(95, 450), (295, 450)])
        page.settle("cartoloop.view.scale > 35")
        assert page.view["scale"] == pytest.approx(40.0, rel=0.05)
        assert page.view["rotation"] == 0.0
        assert page.page.evaluate("cartoloop.toMap([195, 450])") == pytest.approx(under, abs=0.1)

        page.look(5.0, 5.0, 20.0)
        fingers.move([(95, 450), (295, 450)], [(195, 350), (195, 550)])
        page.settle("Math.abs(cartoloop.view.rotation) > 1")
        assert abs(page.view["rotation"]) == pytest.approx(math.pi / 2, abs=0.3)


class Fingers:
    """Fingers on a screen."""

    def __init__(self, page):
        self.session = page.page.context.new_cdp_session(page.page)

    def move(self, first, last, steps=10):
        """Put down fingers, move them and lift them."""
        self._send("touchStart", first)
        for step in range(1, steps + 1):
            share = step / steps
            self._send(
                "touchMove",
                [
                    (a + share * (c - a), b + share * (d - b))
                    for (a, b), (c, d) in zip(first, last, strict=True)
                ],
            )
        self._send("touchEnd", [])

    def _send(self, kind, places):
        points = [{"x": x, "y": y, "id": number} for number, (x, y) in enumerate(places)]
        self.session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})


def number(text):
    """Return the first number in a text."""
    return float(re.search(r"[\d.]+", text)[0])


def scans_drawn(page):
    """Return how many pixels of the card's picture of both scans are drawn."""
    return page.page.evaluate(
        """() => {
            const canvas = document.getElementById("closure-scans");
            const { width, height } = canvas;
            const { data } = canvas.getContext("2d").getImageData(0, 0, width, height);
            return data.filter((value, i) => i % 4 === 3 && value > 0).length;
        }"""
    )
