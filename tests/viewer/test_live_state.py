# SPDX-License-Identifier: Apache-2.0
"""Pages are sent the latest state, however much has happened since the last message."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from cartoloop import Config, Mapper
from cartoloop.global_slam.pose_graph import ConstraintKind
from cartoloop.session import MAIN_PART
from cartoloop.simulation import ring, simulate
from cartoloop.viewer.beside import GAP_M
from cartoloop.viewer.closure_details import closure_details
from cartoloop.viewer.feed import Feed, whole
from cartoloop.viewer.live_state import LiveState
from cartoloop.viewer.playback import Playback
from cartoloop.viewer.protocol import MessageType, messages
from cartoloop.viewer.readings import Readings
from tests.viewer.page_twin import Page


@pytest.fixture(scope="module")
def updates_and_result(ring_events):
    """An update after each scan of a drive around a ring, and the finished map."""
    mapper, feed, updates = Mapper(), Feed(), []
    for event in ring_events:
        mapper.add(event)
        feed.after_event(mapper)
        if (update := feed.take()) is not None:
            updates.append(update)
    return updates, mapper.finish()


@pytest.fixture
def state():
    return LiveState(
        "ring", "recording", Config().local_slam.submaps, Readings(None, None), Playback()
    )


def test_a_session_without_a_place_lies_beside_the_map(state, ring_result):
    mapper, feed = Mapper(onto=ring_result), Feed()
    for event in list(simulate(ring(seed=7), seed=2, duration=8.0).events()):
        mapper.add(event)
        feed.after_event(mapper)
        if (update := feed.take()) is not None:
            state.apply(update)
    mapper.close()

    last = state.last
    assert [session.part for session in last.sessions] == [MAIN_PART, 1]
    main, apart = (last.submap_poses[last.submap_parts == part] for part in (MAIN_PART, 1))
    # While mapping, closures bend the chain of submaps further than in the end.
    assert np.allclose(main, ring_result.graph.submap_poses, atol=0.05)
    assert apart[:, 0].min() > main[:, 0].max() + GAP_M
    nodes = state.drawing().trajectory
    assert len(nodes) == ring_result.graph.num_nodes
    assert last.pose.x > main[:, 0].max() + GAP_M


def everything(subscription, state):
    return b"".join(iter(lambda: subscription.bundle(state.parts), b""))


def test_late_page_gets_each_part_once(state, updates_and_result):
    updates, result = updates_and_result
    quick, slow = state.subscribe(), state.subscribe()
    page = Page()
    everything(slow, state)
    page.receive(everything(quick, state))
    num_bytes = 0
    for update in [*updates, whole(result)]:
        state.apply(update)
        state.draw_growing()
        state.refresh()
        assert quick.changed.is_set()
        news = everything(quick, state)
        assert not quick.changed.is_set()
        num_bytes += len(news)
        page.receive(news)

    late = everything(slow, state)

    sent = Counter((kind, payload[:4]) for kind, payload in messages(late))
    assert max(sent.values()) == 1
    assert sum(kind == MessageType.SUBMAP for kind, _ in sent) == result.graph.num_submaps
    assert len(late) < 0.1 * num_bytes
    assert everything(slow, state) == b""


def test_one_that_leaves_is_forgotten(state, updates_and_result):
    subscription = state.subscribe()
    everything(subscription, state)
    state.unsubscribe(subscription)

    state.apply(updates_and_result[0][0])

    assert not subscription.changed.is_set()


def test_state_may_change_between_two_bundles(state, updates_and_result, monkeypatch):
    monkeypatch.setattr("cartoloop.viewer.subscriptions.BUNDLE_BYTES", 1000)
    updates, _ = updates_and_result
    for update in updates[:200]:
        state.apply(update)
    subscription, page = state.subscribe(), Page()
    page.receive(subscription.bundle(state.parts))
    assert not page.is_complete
    for update in updates[200:]:
        state.apply(update)

    page.receive(everything(subscription, state))

    assert page.is_complete
    assert page.order.count(MessageType.COMPLETE) == 1
    assert len(page.tables["nodes"]) == sum(update.node_stamps.size for update in updates)
    assert page.scan["number"] == updates[-1].num_scans


def test_rows_are_appended_until_poses_are_adjusted(state, updates_and_result):
    updates, _ = updates_and_result
    subscription, page = state.subscribe(), Page()
    firsts = []
    for update in updates:
        state.apply(update)
        news = everything(subscription, state)
        page.receive(news)
        firsts += [
            (int.from_bytes(payload[:4], "little"), update.adjusted)
            for kind, payload in messages(news)
            if kind == MessageType.NODES
        ]
    assert any(first > 0 for first, _ in firsts)
    assert all(first == 0 for first, adjusted in firsts if adjusted)
    assert sum(adjusted for _, adjusted in firsts) == updates[-1].num_adjustments > 1
    assert all(first > 0 for first, adjusted in firsts[1:] if not adjusted)


def test_playback_is_sent(state):
    page, subscription = Page(), state.subscribe()
    page.receive(everything(subscription, state))
    assert page.playback["can_pause"]
    assert not page.playback["can_scrub"]

    state.readings.end("finished")
    state.refresh()
    page.receive(everything(subscription, state))

    assert not page.playback["can_pause"]
    assert page.playback["can_scrub"]


@pytest.mark.parametrize("failures", [1, 100])
def test_a_record_that_changes_while_read_ends_no_view(
    state, updates_and_result, monkeypatch, failures
):
    _, result = updates_and_result
    raised = []

    def details(*args):
        if len(raised) < failures:
            raised.append(args)
            raise ValueError("operands could not be broadcast together")  # as NumPy says it
        return closure_details(*args)

    monkeypatch.setattr("cartoloop.viewer.live_state.closure_details", details)

    state.apply(whole(result))

    row = int(np.flatnonzero(result.graph.kinds == ConstraintKind.LOOP_CLOSURE)[0])
    assert raised
    if failures == 1:
        assert state.closure(row)["constraint"] == row
    else:
        with pytest.raises(LookupError, match="try again"):
            state.closure(row)
