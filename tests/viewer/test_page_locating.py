# SPDX-License-Identifier: Apache-2.0
"""The page in a real browser while a robot is localised: what is seen, and poses given by hand."""

from __future__ import annotations

import math
from contextlib import contextmanager

import numpy as np
import pytest

from cartoloop.sensor.pose import Pose, compose
from tests.localisation.rooms import BOX, ROOM, START, apart
from tests.viewer.locating import go, locating
from tests.viewer.real_page import SIZE, opened

HANGAR = (((0, 0), (40, 0), (40, 40), (0, 40)),)


@contextmanager
def looking(chromium, polygons, start=START, size=SIZE, **options):
    """Yield a localisation and a page that looks at it."""
    with (
        locating(polygons, start, **options) as one,
        opened(chromium, one.url, size) as page,
    ):
        page.settle()
        yield one, page


def drag(page, pose, length=60.0):
    """Press where a pose is, drag to where it faces, and let go."""
    page.page.mouse.move(*page.to_screen(pose.x, pose.y))
    page.page.mouse.down()
    tip = compose(pose, Pose(length / page.view["scale"], 0.0, 0.0))
    page.page.mouse.move(*page.to_screen(tip.x, tip.y), steps=4)


def changed(page, layer):
    """Return where the picture is another one without a layer, rows and columns."""
    before = page.pixels().astype(int)
    page.layers(**{layer: False})
    after = page.pixels().astype(int)
    page.layers(**{layer: True})
    return np.nonzero(np.abs(before - after).max(axis=2) > 60)


def test_the_robot_its_scan_and_its_path_are_shown(chromium):
    with looking(chromium, ROOM) as (one, page):
        assert page.page.text_content("#state") == "waiting for the first scan"
        go(one, page, 40)
        state = page.state

        assert page.page.text_content("#state") == "located"
        assert state["localisation"]["state"] == "located"
        assert page.page.text_content("#read-agreement").endswith("%")
        assert page.page.text_content("#read-sigma").startswith("± ")
        assert "located for 0:03" in page.page.get_attribute("#states-bars", "aria-label")
        assert state["path"] > 10
        page.look(one.pose.x, one.pose.y, 80.0)
        page.keep("locate-located")
        rows, cols = changed(page, "scan")
        assert len(rows) > 300
        walls = [page.to_screen(x, y) for x, y in ((1.0, 3.4), (4.0, 1.0))]
        for x, y in walls:
            assert np.hypot(cols - x, rows - y).min() < 8.0
        rows, cols = changed(page, "trajectory")
        x, y = page.to_screen(*one.answers[10].tf_map_tracking[:2])
        assert np.hypot(cols - x, rows - y).min() < 4.0


def test_places_are_drawn_and_listed_while_several_fit(chromium):
    with looking(chromium, BOX) as (one, page):
        answer = go(one, page, 6)

        assert page.page.text_content("#state") == "2 places fit"
        rows = page.page.locator("#candidates button")
        assert rows.count() == 2
        assert "%" in rows.first.text_content()
        assert page.page.locator("#marks-layer text").count() == 2
        page.keep("locate-ambiguous")
        drawn_rows, drawn_cols = changed(page, "candidates")
        for place in answer.places:
            x, y = page.to_screen(*place.tf_map_tracking[:2])
            assert np.hypot(drawn_cols - x, drawn_rows - y).min() < 6.0
        x, y = answer.places[1].tf_map_tracking[:2]
        rows.nth(1).click()
        page.wait("Math.hypot(cartoloop.view.x - x[0], cartoloop.view.y - x[1]) < 3", [x, y])


def test_a_robot_elsewhere_is_searched_for_and_lost(chromium):
    with looking(chromium, ROOM, Pose(20.0, 20.0, 0.0), inside=HANGAR) as (one, page):
        go(one, page, 3)
        assert page.page.text_content("#state") == "searching: no place fits so far"
        assert page.page.locator("#candidates").is_hidden()
        page.keep("locate-searching")


def test_a_pose_is_given_with_a_drag(chromium):
    with looking(chromium, BOX, size=(1280, 800)) as (one, page):
        go(one, page, 5)
        page.page.keyboard.press("p")
        page.page.locator("#pose").wait_for()
        near = compose(one.pose, Pose(0.3, -0.2, 0.1))
        view = page.view
        drag(page, near)
        page.keep("locate-drag")
        assert page.view == view  # the map stays
        assert apart(page.state["given"], near)[0] < 0.05
        page.page.mouse.up()
        page.wait("s.localisation.given?.number === 1")
        answer = go(one, page, 2)
        page.settle("s.localisation.state === 'located' && s.given === null")

        assert apart(one.pose, answer.tf_map_tracking)[0] < 0.1
        page.page.locator("#pose").wait_for(state="hidden")
        assert page.page.text_content("#hint") == "The scan fits there: the robot is located."


def test_a_dragged_pose_that_does_not_fit_is_not_believed(chromium):
    with looking(chromium, ROOM) as (one, page):
        go(one, page, 5)
        page.page.click("#pose-button")
        drag(page, Pose(2.0, 4.5, 2.0))
        page.page.mouse.up()
        page.wait("s.localisation.given?.number === 1")
        assert "next scan" in page.page.text_content("#pose-outcome")
        answer = go(one, page, 3)

        page.page.get_by_text("The pose is not believed").wait_for()
        page.keep("locate-not-believed")
        assert page.state["given"] is None
        assert apart(one.pose, answer.tf_map_tracking)[0] < 0.1
        page.page.keyboard.press("Escape")
        page.page.locator("#pose").wait_for(state="hidden")
        before = page.view
        drag(page, Pose(2.0, 4.5, 2.0))
        page.page.mouse.up()
        assert page.view != before  # drags move the map again
        assert page.state["localisation"]["given"]["number"] == 1


def test_a_pose_is_given_with_the_keyboard_alone(chromium):
    with looking(chromium, BOX) as (one, page):
        go(one, page, 5)
        keys = page.page.keyboard
        keys.press("p")
        page.page.wait_for_function("document.activeElement.id === 'pose-x'")
        for value in (one.pose.x, one.pose.y, math.degrees(one.pose.theta) + 360.0):
            keys.press("Control+a")
            keys.type(f"{value:.2f}".replace(".", ","))
            keys.press("Tab")
        page.wait("s.given !== null")
        keys.press("Enter")  # on the button
        page.wait("s.localisation.given?.number === 1")
        go(one, page, 2)
        page.settle("s.localisation.state === 'located'")
        page.page.locator("#pose").wait_for(state="hidden")
        assert page.page.evaluate("document.activeElement.id") == "pose-button"


def test_what_is_no_pose_in_the_map_is_refused(chromium):
    refused = [
        (("", "", ""), "Fill in three numbers."),
        (("1e9", "3", "0"), "That is outside of the map."),
        (("4", "3", "north"), "Fill in three numbers."),
        (("500", "3", "0"), "x 500 m, y 3 m is outside of the map"),
        (("4", "NaN", "0"), "Fill in three numbers."),
    ]
    with looking(chromium, BOX) as (one, page):
        go(one, page, 2)
        page.page.keyboard.press("p")
        for values, says in refused:  # in an order in which no answer is that of before
            for name, value in zip(("x", "y", "heading"), values, strict=True):
                page.page.fill(f"#pose-{name}", value)
            page.page.click("#pose-give")
            page.page.get_by_text(says).wait_for()
            assert page.state["localisation"]["given"] is None
            assert page.state["connected"]


def test_a_click_says_where_but_gives_no_pose(chromium):
    with looking(chromium, BOX) as (one, page):
        go(one, page, 2)
        page.page.keyboard.press("p")
        page.page.mouse.click(*page.to_screen(3.0, 4.0))
        assert float(page.page.input_value("#pose-x")) == pytest.approx(3.0, abs=0.1)
        assert "Drag to where it faces" in page.page.text_content("#pose-outcome")
        assert page.state["localisation"]["given"] is None


def test_after_the_end_the_page_shows_what_it_came_to(chromium):
    with looking(chromium, ROOM) as (one, page):
        go(one, page, 10)
        page.page.keyboard.press("p")
        one.view.finished()
        page.settle("s.readings.state === 'finished'")
        assert page.page.text_content("#state") == "ended: located"
        page.page.locator("#pose").wait_for(state="hidden")
        assert page.page.locator("#pose-button").is_disabled()
        page.page.keyboard.press("p")
        page.page.get_by_text("No more scans come").wait_for()
        assert page.page.locator("#playback").is_hidden()
        page.keep("locate-ended")


def test_what_only_maps_have_is_not_offered(chromium):
    with looking(chromium, ROOM) as (one, page):
        go(one, page, 3)
        for key in ("b", "c", "t"):
            page.page.keyboard.press(key)
        for name in ("before", "closures", "closure"):
            assert page.page.locator(f"#{name}").is_hidden()
        page.page.keyboard.press("l")
        shown = page.page.locator("#layers label:visible").all_text_contents()
        assert shown == ["Trajectory", "Current scan", "Possible places", "Metric grid"]
        page.page.keyboard.press("s")
        assert page.page.locator("#save-map").is_hidden()


def test_a_page_of_a_map_offers_no_pose(shared):
    assert shared.page.locator("#pose-button").is_hidden()
    shared.page.keyboard.press("p")
    assert shared.page.locator("#pose").is_hidden()
    assert shared.page.locator("#localisation").is_hidden()


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_a_phone_leaves_room_for_the_map(chromium, theme):
    with looking(chromium, BOX, size=(390, 800)) as (one, page):
        if theme == "dark":
            page.page.keyboard.press("d")
        go(one, page, 6)
        page.keep(f"locate-phone-{theme}")
        panel = page.page.locator("#panel").bounding_box()
        assert panel["height"] < 420
        page.page.click("#pose-button")
        card = page.page.locator("#pose").bounding_box()
        panel = page.page.locator("#panel").bounding_box()
        assert card["y"] - panel["y"] - panel["height"] > 250
        near = compose(one.pose, Pose(0.2, 0.1, 0.1))
        page.keep(f"locate-phone-pose-{theme}")
        drag(page, near, 40.0)
        page.page.mouse.up()
        page.wait("s.localisation.given?.number === 1")
        go(one, page, 2)
        page.settle("s.localisation.state === 'located'")
