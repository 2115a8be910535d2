# SPDX-License-Identifier: Apache-2.0
"""What is looked at, and a browser to look with; where there is none those tests are skipped."""

from __future__ import annotations

from contextlib import ExitStack

import pytest

from bench.browser import NoBrowserError, browser
from cartoloop import Config
from cartoloop.result import load_map
from cartoloop.simulation import ring, simulate
from cartoloop.viewer.view import LiveView, serve_result
from tests.limits import LIMIT_S
from tests.viewer.page_twin import join, look
from tests.viewer.real_page import opened


@pytest.fixture(scope="module")
def chromium():
    """Chromium, one for all tests of a module."""
    with ExitStack() as stack:
        try:
            started = stack.enter_context(browser())
        except NoBrowserError as none:
            pytest.skip(str(none))
        yield started


@pytest.fixture(scope="session", autouse=True)
def patient_server():
    """On a busy machine a page may answer pings late."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("cartoloop.viewer.server.PING_TIMEOUT_S", LIMIT_S)
        yield


@pytest.fixture(scope="session")
def result(ring_result, shared_files):
    """A ring of corridors with loops closed, saved and loaded."""
    return load_map(shared_files.path("ring_saved", ring_result.save))


@pytest.fixture(scope="module")
def server(result):
    """Shows the ring, finished."""
    server = serve_result(result, "ring", port=0)
    yield server
    server.close()
    assert server.failure is None


@pytest.fixture
def connection(server):
    """A connection to the server of the ring."""
    with join(server.url) as connection:
        yield connection


@pytest.fixture
def page(connection):
    """A page that has received the ring."""
    return look(connection)


@pytest.fixture(scope="module")
def shared(chromium, server):
    """The ring in a browser, opened once for all tests of a module."""
    with opened(chromium, server.url) as page:
        page.settle()
        yield page


@pytest.fixture(scope="session")
def events():
    """Once around a ring and 10 m more: a loop closes, and the map moves visibly."""
    return list(simulate(ring(), seed=1, duration=150.0).events())


@pytest.fixture
def view():
    """Shows the ring while it is mapped."""
    view = LiveView("ring", Config(), scans_total=750, duration_s=150.0, port=0)
    yield view
    view.close()
    assert view.failure is None
