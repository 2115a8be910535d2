# SPDX-License-Identifier: Apache-2.0
"""What is looked at, and a browser to look with; where there is none those tests are skipped."""

from __future__ import annotations

from contextlib import ExitStack

import pytest

from bench.browser import NoBrowserError, browser
from cartoloop import Config, Mapper
from cartoloop.map_file.load import load_map
from cartoloop.simulation import ring, simulate
from cartoloop.viewer.view import LiveView, serve_result


@pytest.fixture(scope="module")
def chromium():
    """Chromium, one for all tests of a module."""
    with ExitStack() as stack:
        try:
            started = stack.enter_context(browser())
        except NoBrowserError as none:
            pytest.skip(str(none))
        yield started


@pytest.fixture(scope="session")
def result(tmp_path_factory):
    """A ring of corridors with loops closed, saved and loaded."""
    mapper = Mapper()
    for event in simulate(ring(), seed=1, duration=125.0).events():
        mapper.add(event)
    out = tmp_path_factory.mktemp("ring")
    mapper.finish().save(out)
    return load_map(out)


@pytest.fixture(scope="module")
def server(result):
    """Shows the ring, finished."""
    server = serve_result(result, "ring", port=0)
    yield server
    server.close()
    assert server.failure is None


@pytest.fixture(scope="session")
def events():
    """Once round a ring and on a bit: a loop closes."""
    return list(simulate(ring(), seed=1, duration=150.0).events())


@pytest.fixture
def view():
    """Shows the ring while it is mapped."""
    view = LiveView("ring", Config(), scans_total=750, duration_s=150.0, port=0)
    yield view
    view.close()
    assert view.failure is None
