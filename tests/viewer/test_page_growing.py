# SPDX-License-Identifier: Apache-2.0
"""The page in a real browser while a map grows: it is fed step by step, and each step is seen."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest

from cartoloop import Config, Mapper
from cartoloop.viewer.view import LiveView
from tests.limits import LIMIT_S
from tests.viewer.real_page import TIMEOUT_MS, opened

DRIFTING = Config.model_validate(
    {"local_slam": {"least_squares_matcher": {"occupied_space_weight": 0.003}}}
)
"""Scans that hardly count against odometry: else no closure would move so small a map visibly."""


@pytest.fixture(scope="module")
def first_closure(events):
    """How many events are mapped when loop closures have just moved the map visibly."""
    mapper = Mapper(DRIFTING)
    for number, event in enumerate(events, 1):
        before = mapper.global_slam.graph.submap_poses.copy()
        mapper.add(event)
        moved = np.abs(mapper.global_slam.graph.submap_poses[: len(before)] - before)
        if mapper.num_loop_closures and moved.max(initial=0.0) > 0.02:
            mapper.close()
            return number
    raise AssertionError("no closure moves the map")


@pytest.fixture
def mapper():
    mapper = Mapper(DRIFTING)
    yield mapper
    mapper.close()


def add(mapper, view, events):
    for event in events:
        view.before_event(mapper, event, lambda: False)
        mapper.add(event)
        view.after_event(mapper)


def see(page, mapper, view):
    """Wait until the page has drawn all that there is: there is room for one update at a time."""
    while page.state["readings"]["scans"] != mapper.num_scans:
        view.after_event(mapper)
        page.page.wait_for_timeout(20)
    return page.settle("s.counts.nodes === x", mapper.global_slam.graph.num_nodes)


def same_in_the_end(page, other):
    """Wait until both show the same: submaps that still grow may come a little later."""
    end = time.monotonic() + TIMEOUT_MS / 1000.0
    while changed(page.pixels(), other.pixels()):
        assert time.monotonic() < end


def changed(before, after):
    return np.count_nonzero((before != after).any(axis=2))


def test_the_map_grows_and_snaps_shut(chromium, view, mapper, events, first_closure):
    with opened(chromium, view.url) as page:
        page.wait("s.complete")
        assert "waiting" in page.page.text_content("#state")
        empty = page.pixels()

        add(mapper, view, events[: first_closure // 2])
        see(page, mapper, view)
        page.settle("s.counts.submaps === x", mapper.global_slam.graph.num_submaps)
        page.look(-6.0, 10.0, 25.0)
        page.layers(scan=False, trajectory=False)
        before = page.pixels()
        assert changed(empty, before) > 10_000

        add(mapper, view, events[first_closure // 2 : first_closure - 1])
        see(page, mapper, view)
        open_loop, poses = page.pixels(), mapper.global_slam.graph.submap_poses.copy()
        assert changed(before, open_loop) > 10_000
        glides = page.state["glides"]
        page.keep("before-a-closure")

        add(mapper, view, events[first_closure - 1 : first_closure])
        see(page, mapper, view)
        state = page.settle("s.glides > x", glides)
        moved = np.abs(mapper.global_slam.graph.submap_poses[: len(poses)] - poses).max()
        assert moved > 0.01
        assert changed(open_loop, page.pixels()) > 2_000
        assert state["readings"]["loop_closures"] == mapper.num_loop_closures > 0
        assert page.page.text_content("#read-closures") == str(mapper.num_loop_closures)
        page.keep("after-a-closure")


def test_one_that_joins_late_or_again_sees_what_the_others_see(chromium, view, mapper, events):
    add(mapper, view, events[:250])
    with opened(chromium, view.url) as page, opened(chromium, view.url) as other:
        for one in (page, other):
            one.wait("s.complete")
            see(one, mapper, view)
            one.look(0.0, 5.0, 20.0)
        same_in_the_end(page, other)
        page.page.reload()
        page.wait("s.complete")
        see(page, mapper, view)
        same_in_the_end(page, other)


def test_finishing_and_the_finished_map_are_shown(chromium, view, mapper, events):
    with opened(chromium, view.url) as page:
        page.wait("s.complete")
        add(mapper, view, events[:250])
        see(page, mapper, view)
        view.finishing()
        page.page.get_by_text("finishing: closing the last loops").wait_for()
        result = mapper.finish(lambda stage: view.finishing(stage, mapper))
        view.finished(result)
        state = page.settle("s.readings.state === 'finished'")
        assert state["counts"]["submaps"] == result.graph.num_submaps
        assert page.page.is_visible("#scrub")


def test_pausing_and_playing_from_the_page(chromium, view, mapper, events):
    with opened(chromium, view.url) as page:
        page.wait("s.complete")
        page.page.click("#play")
        page.wait("s.readings.state === 'paused'")
        mapping = threading.Thread(target=add, args=(mapper, view, events[:100]))
        mapping.start()
        page.page.get_by_text("paused", exact=True).wait_for()
        assert mapper.num_scans == 0
        page.page.keyboard.press(" ")
        page.wait("s.readings.state !== 'paused'")
        mapping.join(LIMIT_S)
        assert not mapping.is_alive()
        see(page, mapper, view)


def test_pace_from_the_command_line_can_be_chosen(chromium):
    view = LiveView("ring", Config(), speed=7.0, port=0)
    try:
        with opened(chromium, view.url) as page:
            page.page.wait_for_selector("#playback:not([hidden])")
            assert page.page.input_value("#speed") == "7"
            assert page.page.locator("#speed option").all_text_contents()[:5] == [
                "fastest", "1×", "2×", "5×", "7×",
            ]  # fmt: skip
    finally:
        view.close()


def test_the_robot_is_followed(chromium, view, mapper, events):
    with opened(chromium, view.url) as page:
        page.wait("s.complete")
        add(mapper, view, events[:50])
        see(page, mapper, view)
        page.page.keyboard.press("f")
        assert page.page.get_attribute("#follow", "aria-pressed") == "true"
        add(mapper, view, events[50:200])
        see(page, mapper, view)
        x, y, _ = mapper.pose
        page.wait("Math.hypot(cartoloop.view.x - x[0], cartoloop.view.y - x[1]) < 0.1", [x, y])
        scale = page.view["scale"]
        page.page.mouse.move(640, 400)
        page.page.mouse.wheel(0, -300)
        page.page.click("#zoom-in")
        assert page.wait("cartoloop.view.scale > 1.5 * x", scale)["following"]
        page.page.mouse.move(640, 400)
        page.page.mouse.down()
        page.page.mouse.move(700, 400)
        page.page.mouse.up()
        assert page.wait("!s.following")
