# SPDX-License-Identifier: Apache-2.0
"""Pages that look while a map grows: late, again, slowly, or not at all."""

from __future__ import annotations

import json
import threading
from contextlib import closing
from itertools import islice

import numpy as np

from cartoloop import Config, Mapper
from cartoloop.submaps.finished_grid import quantize_probabilities
from cartoloop.viewer.protocol import MessageType
from cartoloop.viewer.textures import drawn_cells
from cartoloop.viewer.view import LiveView
from tests.limits import LIMIT_S, wait_until
from tests.viewer.page_twin import join, look


def add(mapper, view, events):
    for event in events:
        view.before_event(mapper, event, lambda: False)
        mapper.add(event)
        view.after_event(mapper)


def same_picture(page, other):
    assert page.submaps.keys() == other.submaps.keys()
    for submap, texture in page.submaps.items():
        assert texture["version"] == other.submaps[submap]["version"]
        assert np.array_equal(texture["cells"], other.submaps[submap]["cells"])
    for name in ("submap_poses", "nodes", "node_times", "constraints"):
        assert np.array_equal(page.tables[name], other.tables[name], equal_nan=True), name


def look_at_all(connection, page, mapper, view):
    """Receive until the page has seen the mapper's last scan, which may take two updates."""

    def has_seen(page):
        view.after_event(mapper)
        return page.is_complete and page.readings["scans"] == mapper.num_scans

    return look(connection, page, has_seen)


def settle(connection, page, mapper):
    """Receive until the page shows the growing submaps as they are: they are drawn less often."""
    cells = {
        submap.index: drawn_cells(quantize_probabilities(submap.grid.cells))
        for submap in mapper.active_submaps
    }

    def shows_all(page):
        return cells.keys() <= page.submaps.keys() and all(
            np.array_equal(page.submaps[submap]["cells"], own) for submap, own in cells.items()
        )

    look(connection, page, shows_all)


def test_early_and_late_pages_see_the_same(view, events):
    mapper = Mapper()
    with join(view.url) as early:
        page = look(early)
        assert page.readings["state"] == "starting"
        assert page.submaps == {}
        add(mapper, view, events)
        look_at_all(early, page, mapper, view)
        settle(early, page, mapper)
        with join(view.url) as late:
            late_page = look(late)

        same_picture(page, late_page)
        assert MessageType.SUBMAP_PATCH not in late_page.order
        assert len(page.tables["nodes"]) == mapper.num_nodes
        assert page.readings["loop_closures"] == mapper.num_loop_closures > 0
        assert page.scan["number"] == mapper.num_scans
        assert np.allclose(page.scan["pose"], mapper.pose)
        assert len(page.scan["points"]) == len(mapper.last_scan.returns)

        view.finishing()
        look(early, page, lambda page: page.readings["state"] == "finishing")
        result = mapper.finish()
        view.finished(result)
        look(early, page, lambda page: page.readings["state"] == "finished")
        with join(view.url) as late:
            same_picture(page, look(late))
        assert all(texture["finished"] for texture in page.submaps.values())
        assert np.array_equal(page.tables["submap_poses"], result.graph.submap_poses)


def test_the_map_is_shown_as_it_is_while_it_is_finished(view, events):
    mapper, stages = Mapper(), []
    with join(view.url) as connection:
        page = look(connection)
        add(mapper, view, events)
        view.finishing()
        look(connection, page, lambda page: page.readings["state"] == "finishing")

        def note(stage):
            view.finishing(stage, mapper)
            graph = mapper.global_slam.graph

            def has_seen(page):
                return (
                    page.readings["text"] == f"finishing: {stage}"
                    and len(page.tables["constraints"]) == graph.num_constraints
                    and np.array_equal(page.tables["submap_poses"], graph.submap_poses)
                )

            look(connection, page, has_seen)
            stages.append((stage, page.tables["submap_poses"]))

        result = mapper.finish(note)
        assert page.hello["mode"] == "recording"
        view.finished(result)
        look(connection, page, lambda page: page.readings["state"] == "finished")
        with join(view.url) as late:
            late_page = look(late)

    assert [stage for stage, _ in stages] == [
        "closing the last loops", "matching again, 1 of 2", "matching again, 2 of 2",
        "last adjustment", "examining the map",
    ]  # fmt: skip
    assert not np.array_equal(stages[0][1], stages[1][1])
    assert not np.array_equal(stages[1][1], stages[2][1])
    assert late_page.hello["mode"] == "finished"
    assert late_page.hello["session"] == page.hello["session"]
    closure = late_page.json[MessageType.LATEST_CLOSURE]
    row = late_page.tables["constraints"][closure["constraint"]]
    assert row[[0, 1, 5]].tolist() == [closure["submap"], closure["node"], 1]


def test_latest_closure_has_its_search_window(view, events):
    mapper = Mapper()
    with join(view.url) as connection:
        page = look(connection)
        add(mapper, view, events)
        look_at_all(connection, page, mapper, view)
        closure = page.json[MessageType.LATEST_CLOSURE]

        closures = mapper.global_slam.closures
        row = closures.find(closure["submap"], closure["node"])
        assert closure["window"]["linear_m"] == closures.linear_window[row]
        assert closure["window"]["angular_rad"] == closures.angular_window[row]
        assert closure["window"]["tf_submap_node"] == closures.predicted[row].tolist()
        assert len(closure["points"]) == len(mapper.global_slam.node_points[closure["node"]])
        assert 0.0 < closure["score"] < 1.0
    mapper.close()


def test_patches_and_pieces_add_up_to_what_is_sent_whole(events):
    view = LiveView("ring", Config(), speed=1000.0, port=0)  # not flat out: drawn more often
    mapper = Mapper()
    with closing(view), join(view.url) as connection:
        page = look(connection)
        for first in range(0, 300, 20):
            add(mapper, view, islice(events, first, first + 20))
            look_at_all(connection, page, mapper, view)
            settle(connection, page, mapper)
        with join(view.url) as other:
            same_picture(page, look(other))
        assert page.order.count(MessageType.SUBMAP_PATCH) >= 5
        own = {submap.index: submap.grid.finish() for submap in mapper.active_submaps}
        for submap, grid in own.items():
            known = page.submaps[submap]["cells"] != 0
            assert np.count_nonzero(known) == np.count_nonzero(grid.cells)
    mapper.close()


def test_page_that_reads_nothing_delays_no_other(view, events):
    mapper = Mapper()
    with join(view.url, max_queue=1, ping_interval=None) as frozen, join(view.url) as quick:
        frozen_page, page = look(frozen), look(quick)
        for first in range(0, len(events), 100):
            add(mapper, view, islice(events, first, first + 100))
            look_at_all(quick, page, mapper, view)  # is not delayed by the other one
        view.finished(mapper.finish())
        look(quick, page, lambda page: page.readings["state"] == "finished")
        look(frozen, frozen_page, lambda page: page.readings["state"] == "finished")
        same_picture(page, frozen_page)


def test_pausing_stops_mapping_and_playing_goes_on(view, events):
    mapper = Mapper()
    with join(view.url) as connection:
        page = look(connection)
        assert page.playback["can_pause"]
        connection.send('{"type": "pause"}')
        look(connection, page, lambda page: page.playback["paused"])
        mapping = threading.Thread(target=add, args=(mapper, view, events[:100]))
        mapping.start()
        wait_until(lambda: view.paused_s >= 0.3)
        assert mapper.num_scans == 0
        connection.send('{"type": "speed", "value": 1000.0}')
        look(connection, page, lambda page: page.playback["speed"] == 1000.0)
        assert mapper.num_scans == 0
        connection.send('{"type": "play"}')
        mapping.join(LIMIT_S)
        assert not mapping.is_alive()
        look(connection, page, lambda page: not page.playback["paused"])
        assert view.paused_s >= 0.3
    mapper.close()


def test_ten_pages_come_and_go(view, events):
    mapper = Mapper()
    mapping = threading.Thread(target=add, args=(mapper, view, events))
    mapping.start()
    for _ in range(10):
        with join(view.url) as connection:
            page = look(connection)
            connection.send(json.dumps({"type": "ping", "id": 1}))
            look(connection, page, lambda page: page.answers)
    mapping.join(LIMIT_S)
    assert mapper.num_scans == sum(hasattr(event, "ranges") for event in events)
    mapper.close()
