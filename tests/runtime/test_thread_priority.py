# SPDX-License-Identifier: Apache-2.0
"""Priorities of background threads and of the threads that they start."""

from __future__ import annotations

import os
import sys
from threading import Thread, get_native_id

import pytest

from cartoloop.mapper import Mapper
from cartoloop.runtime.thread_priority import BACKGROUND_NICENESS, lower_thread_priority

pytestmark = pytest.mark.skipif(
    sys.platform != "linux", reason="only Linux has priorities of threads"
)


def niceness():
    return os.getpriority(os.PRIO_PROCESS, get_native_id())


def in_thread(task):
    thread = Thread(target=task)
    thread.start()
    thread.join()


def test_the_priority_of_a_thread_and_its_children_is_lowered():
    before, found = niceness(), []

    def child():
        found.append(niceness())

    def parent():
        lower_thread_priority()
        found.append(niceness())
        in_thread(child)

    in_thread(parent)

    assert found == [min(before + BACKGROUND_NICENESS, 19)] * 2
    assert niceness() == before


def test_a_system_that_forbids_priorities_is_no_error(monkeypatch):
    def forbidden(*_):
        raise PermissionError

    monkeypatch.setattr(os, "setpriority", forbidden)
    before = niceness()

    lower_thread_priority()

    assert niceness() == before


def test_the_graph_thread_of_live_mapping_has_low_priority():
    mapper, found = Mapper(live=True), []
    mapper.run_on_graph_thread(lambda: found.append(niceness()))
    mapper.finish()

    assert found == [min(niceness() + BACKGROUND_NICENESS, 19)]
