# SPDX-License-Identifier: Apache-2.0
"""Pages that look while a robot is localised: what they are sent, and the poses that they give."""

from __future__ import annotations

import json
import math
import threading

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed

from cartoloop.localisation.answer import State
from cartoloop.localisation.known_map import known_map_of_image
from cartoloop.sensor.pose import Pose, compose
from cartoloop.viewer import map_blocks
from cartoloop.viewer.locate_feed import LocateFeed
from cartoloop.viewer.locate_readings import LocateReadings
from cartoloop.viewer.locate_state import LocateState
from cartoloop.viewer.protocol import MessageType
from cartoloop.viewer.server import ViewServer
from tests.limits import LIMIT_S
from tests.localisation.rooms import BOX, ROOM, START, apart, events, image
from tests.viewer.locating import locating
from tests.viewer.page_twin import ask, join, look


def localisation(page):
    return page.json[MessageType.LOCALISATION]


def sees(answer):
    """Return whether a page has seen an answer."""
    return lambda page: page.is_complete and localisation(page)["stamp"] == answer.stamp


def shown(one, connection, page=None):
    """Receive until the page has seen the last answer."""

    def is_seen(page):
        one.view.idle()
        return page.is_complete and localisation(page)["stamp"] == one.answers[-1].stamp

    return look(connection, page, is_seen)


def test_a_page_sees_the_map_before_any_scan():
    with locating(ROOM, START) as one, join(one.url) as connection:
        page = look(connection)

        assert page.hello["mode"] == "locating"
        assert page.readings["text"] == "waiting for the first scan"
        assert localisation(page)["state"] is None
        assert MessageType.CONSTRAINTS not in page.order
        assert page.order.index(MessageType.SUBMAP_PREVIEW) < page.order.index(MessageType.SUBMAP)


@pytest.mark.parametrize("origin", [Pose(0.0, 0.0, 0.0), Pose(-2.0, -3.0, 0.3)])
def test_the_map_lies_where_it_is(monkeypatch, origin):
    monkeypatch.setattr(map_blocks, "BLOCK_CELLS", 64)  # several blocks
    known = known_map_of_image(image(ROOM, origin=origin))
    server = ViewServer(
        LocateState("room", known, LocateReadings(None, None), lambda asked: None), port=0
    )
    try:
        with join(server.url) as connection:
            page = look(connection)
    finally:
        server.close()

    assert len(page.submaps) > 4
    picture, _ = page.compose((0, 0), (240, 240))
    grey = picture.mean(axis=2)
    assert grey[round(3.4 / 0.05), round(4.7 / 0.05)] > 240.0  # in the room
    wall = grey[17:24, 40:160].min(axis=0)  # across blocks
    assert np.mean(wall < 150.0) > 0.9
    assert abs(grey[round(8.0 / 0.05), round(3.0 / 0.05)] - page.hello["palette"][256][0]) < 5.0


def test_a_page_follows_a_robot_that_is_located():
    with locating(ROOM, START) as one, join(one.url) as connection:
        answer = one.go(20)
        page = shown(one, connection)

        now = localisation(page)
        assert now["state"] == "located" == page.readings["state"]
        assert np.allclose(now["map"], answer.tf_map_tracking, atol=1e-3)
        assert np.allclose(page.scan["pose"], answer.tf_map_tracking)
        assert len(page.scan["points"]) > 50
        assert 0.5 < now["agreement"] <= 1.0
        assert now["usual_agreement"] == 0.9
        assert 0.0 < now["sigma_m"] < 0.1
        assert page.json[MessageType.STATES]["runs"][-1][1] == "located"
        path = page.tables["path"]
        assert path[0, 2] == 1.0
        assert len(path) > 5
        assert apart(one.pose, now["map"])[0] < 0.1

        late = []
        one.go(10)
        shown(one, connection, page)
        with join(one.url) as other:
            late = look(other)
        assert np.array_equal(late.tables["path"], page.tables["path"])
        assert late.json[MessageType.STATES] == page.json[MessageType.STATES]


def test_places_are_sent_while_several_fit():
    with locating(BOX, START) as one, join(one.url) as connection:
        answer = one.go(5)
        page = shown(one, connection)

        assert answer.state is State.AMBIGUOUS
        now = localisation(page)
        assert (now["state"], now["map"], now["sigma_m"]) == ("ambiguous", None, None)
        assert len(now["places"]) == 2
        assert 0.0 < sum(place["probability"] for place in now["places"]) <= 1.0
        assert min(apart(one.pose, place["map"])[0] for place in now["places"]) < 0.15
        assert np.allclose(page.scan["pose"], now["places"][0]["map"], atol=1e-3)
        assert page.readings["text"] == "2 places fit"


def test_a_scan_that_fits_nowhere_is_not_drawn():
    hangar = (((0, 0), (40, 0), (40, 40), (0, 40)),)
    start = Pose(20.0, 20.0, 0.0)
    with locating(ROOM, start, inside=hangar) as one, join(one.url) as connection:
        one.go(2)
        page = shown(one, connection)

        assert localisation(page)["state"] == "searching"
        assert len(page.scan["points"]) == 0
        assert page.readings["text"] == "searching: no place fits so far"


def test_a_given_pose_decides_between_places():
    with locating(BOX, START) as one, join(one.url) as connection:
        one.go(5)
        page = shown(one, connection)
        near = compose(one.pose, Pose(0.3, -0.2, 0.1))
        kind, given = ask(connection, page, type="set_pose", id=3, pose=list(near))
        assert (kind, given["number"]) == (MessageType.GIVEN, 1)
        look(connection, page, lambda page: localisation(page)["given"] is not None)
        assert localisation(page)["given"]["fits"] is None

        answer = one.go(2)
        shown(one, connection, page)

        assert localisation(page)["given"]["fits"] is True
        assert localisation(page)["state"] == "located"
        assert apart(one.pose, answer.tf_map_tracking)[0] < 0.1


def test_a_given_pose_that_does_not_fit_changes_nothing():
    with locating(ROOM, START) as one, join(one.url) as connection:
        one.go(10)
        page = shown(one, connection)
        ask(connection, page, type="set_pose", id=3, pose=[7.5, 8.5, 1.0])
        answer = one.go(5)
        shown(one, connection, page)

        assert localisation(page)["given"]["fits"] is False
        assert localisation(page)["state"] == "located"
        assert apart(one.pose, answer.tf_map_tracking)[0] < 0.1


@pytest.mark.parametrize("pose", [[1e4, 0, 0], [0, -1e5, 0], [-5.0, 3.0, 0.0], [5.0, 60.0, 0.0]])
def test_poses_outside_of_the_map_are_refused(pose):
    with locating(ROOM, START) as one, join(one.url) as connection:
        one.go(2)
        page = shown(one, connection)
        kind, problem = ask(connection, page, type="set_pose", id=3, pose=pose)
        one.go(2)
        shown(one, connection, page)

        assert kind == MessageType.PROBLEM
        assert "outside of the map" in problem["text"]
        assert localisation(page)["given"] is None


@pytest.mark.parametrize(
    "sent",
    [
        '{"type": "set_pose", "id": 1}',
        '{"type": "set_pose", "id": 1, "pose": null}',
        '{"type": "set_pose", "id": 1, "pose": [1, 2]}',
        '{"type": "set_pose", "id": 1, "pose": [1, 2, 3, 4]}',
        '{"type": "set_pose", "id": 1, "pose": [1, 2, NaN]}',
        '{"type": "set_pose", "id": 1, "pose": [Infinity, 2, 0]}',
        '{"type": "set_pose", "id": 1, "pose": [1e300, 2, 0]}',
        '{"type": "set_pose", "id": 1, "pose": [1e999, 2, 0]}',
        '{"type": "set_pose", "id": 1, "pose": [1, 2, 1e9]}',
        '{"type": "set_pose", "id": 1, "pose": ["1", "2", "0"]}',
        '{"type": "set_pose", "id": 1, "pose": [true, 2, 0]}',
        '{"type": "set_pose", "id": 1, "pose": [[1], 2, 0]}',
        '{"type": "set_pose", "id": 1, "pose": {"x": 1, "y": 2, "theta": 0}}',
        '{"type": "set_pose", "id": -1, "pose": [1, 2, 0]}',
        '{"type": "set_pose", "id": 1, "pose": [1, 2, 0], "force": true}',
        '{"type": "set_pose", "id": 1, "pose": [1, 2, 0]',
        '{"type": "set_pose", "id": 1, "pose": [' + "1" * 400 + ", 2, 0]}",
    ],
)
def test_nonsense_ends_the_connection_and_not_the_localisation(sent):
    with locating(ROOM, START) as one:
        before = one.go(5)
        with join(one.url) as connection:
            shown(one, connection)
            with pytest.raises(ConnectionClosed) as closed:
                connection.send(sent)
                while True:
                    connection.recv(timeout=LIMIT_S)
        assert closed.value.rcvd.code == 1008
        after = one.go(5)
        with join(one.url) as connection:
            page = shown(one, connection)

        assert before.state is after.state is State.LOCATED
        assert localisation(page)["given"] is None


def test_a_hail_of_poses_is_answered_late_and_the_last_one_is_tried():
    with locating(BOX, START) as one, join(one.url) as connection:
        one.go(5)
        page = shown(one, connection)
        poses = [[2.0, 5.0, 2.0]] * 30 + [list(one.pose)]
        for number, pose in enumerate(poses):
            connection.send(json.dumps({"type": "set_pose", "id": number, "pose": pose}))
        look(connection, page, lambda page: len(page.answers) == len(poses))
        one.go(2)
        shown(one, connection, page)

        assert [content["number"] for _, content in page.answers] == list(range(1, 32))
        assert localisation(page)["given"] == {
            "number": 31,
            "map": [round(value, 4) for value in one.poses[4]],
            "fits": True,
        }


def test_after_the_end_the_view_stays_and_takes_no_pose():
    with locating(ROOM, START) as one:
        one.go(10)
        one.view.finished()
        with join(one.url) as connection:
            page = look(connection)
            kind, problem = ask(connection, page, type="set_pose", id=3, pose=list(one.pose))

        assert (page.readings["state"], page.readings["text"]) == ("finished", "ended: located")
        assert localisation(page)["can_give"] is False
        assert localisation(page)["stamp"] == one.answers[-1].stamp
        assert kind == MessageType.PROBLEM
        assert "no more scans" in problem["text"]


def test_an_end_without_a_scan_is_shown():
    with locating(ROOM, START) as one:
        one.view.finished()
        with join(one.url) as connection:
            page = look(connection)

    assert page.readings["text"] == "ended without a scan"


@pytest.mark.parametrize(
    "request_",
    [
        {"type": "closures"},
        {"type": "closure", "constraint": 0},
        {"type": "before"},
        {"type": "node_scan", "node": 0},
        {"type": "picture"},
        {"type": "undo_edit", "edit": 0},
    ],
)
def test_what_only_maps_have_is_a_problem(request_):
    with locating(ROOM, START) as one, join(one.url) as connection:
        page = look(connection)
        kind, problem = ask(connection, page, id=1, **request_)

    assert kind == MessageType.PROBLEM
    assert problem["text"]


def test_a_view_that_shows_no_localisation_takes_no_pose(server):
    with join(server.url) as connection:
        page = look(connection)
        kind, problem = ask(connection, page, type="set_pose", id=1, pose=[0, 0, 0])

    assert kind == MessageType.PROBLEM
    assert "locate --view" in problem["text"]


def test_a_recording_is_paused_and_goes_on():
    with locating(ROOM, START) as one, join(one.url) as connection:
        page = look(connection)
        connection.send('{"type": "pause"}')
        look(connection, page, lambda page: page.playback["paused"])
        taken = []
        drive = threading.Thread(
            target=lambda: taken.extend(
                one.view.paced(list(events(ROOM, one.poses[:3])), lambda: False)
            )
        )
        drive.start()
        connection.send('{"type": "play"}')
        drive.join(LIMIT_S)

        assert len(taken) == 6
        look(connection, page, lambda page: not page.playback["paused"])


def test_a_live_scanner_that_is_silent_is_reported(monkeypatch):
    monkeypatch.setattr("cartoloop.viewer.locate_readings.SILENT_AFTER_S", 0.0)
    with locating(ROOM, START, live=True) as one, join(one.url) as connection:
        one.go(3)
        page = shown(one, connection)
        look(connection, page, lambda page: page.readings["state"] == "silent")

    assert page.playback["can_pause"] is False


def test_an_update_waits_until_the_last_one_was_taken():
    with locating(ROOM, START) as one:
        feed = LocateFeed(one.localizer)
        answers = [one.go(1) for _ in range(6)]
        for answer in answers[:3]:
            feed.after_answer(answer)
        first = feed.take()
        assert feed.take() is None
        for answer in answers[3:]:
            feed.after_answer(answer)
        second = feed.take()
        feed.offer()
        third = feed.take()

    assert first.answer is answers[0]
    assert second.answer is answers[3]
    assert third.answer is answers[5]
    assert feed.take() is None
    assert math.isclose(third.first_stamp, answers[0].stamp)


def test_a_server_that_has_gone_does_not_stop_the_localisation():
    with locating(ROOM, START) as one:
        one.view.close()
        one.go(5)
        one.view.finished()

    assert one.answers[-1].state is State.LOCATED
