# SPDX-License-Identifier: Apache-2.0
"""Global SLAM in a thread of its own: in order, nothing lost, failures reported."""

from __future__ import annotations

from threading import Event, get_ident

import pytest

from cartoloop.global_slam.background import BackgroundGlobalSlam


class StandIn:
    """Notes the nodes it is given, and in which thread."""

    def __init__(self):
        self.nodes, self.threads = [], set()
        self.may_go_on = Event()

    def add_node(self, node):
        self.may_go_on.wait(300.0)
        if node == "bad":
            raise RuntimeError("bad node")
        self.nodes.append(node)
        self.threads.add(get_ident())


def test_nodes_are_added_in_order_and_nobody_waits():
    slam = StandIn()
    background = BackgroundGlobalSlam(slam)
    seen = []
    for node in range(10):
        background.add_node(node)
    background.call(lambda: seen.append(list(slam.nodes)))
    background.add_node(10)
    assert slam.nodes == []
    assert background.num_waiting >= 10

    slam.may_go_on.set()
    background.close()

    assert slam.nodes == list(range(11))
    assert seen == [list(range(10))]
    assert get_ident() not in slam.threads


def test_a_failure_reaches_the_mapping_thread():
    slam = StandIn()
    slam.may_go_on.set()
    background = BackgroundGlobalSlam(slam)
    background.add_node("bad")
    background.close()

    with pytest.raises(RuntimeError, match="bad node"):
        background.add_node(1)
