# SPDX-License-Identifier: Apache-2.0
"""Simulated drives and their maps, made once in a session, and the markers of the tests.

Hypothesis tries the same examples in every run of the CI, so that a change is judged by itself.
"""

from __future__ import annotations

import os
import signal

import pytest
from hypothesis import settings

from cartoloop import Mapper
from cartoloop.simulation import ring, simulate
from tests.shared_files import SharedFiles

settings.register_profile("ci", derandomize=True, deadline=None)
settings.register_profile("untimed", deadline=None)
settings.register_profile("few", derandomize=True, max_examples=10, deadline=None)
if os.environ.get("NUMBA_DISABLE_JIT") == "1":
    settings.load_profile("few")  # kernels take a hundred times as long
else:
    settings.load_profile("ci" if os.environ.get("CI") else "untimed")


def pytest_configure():
    """Handle the signals that a background shell or nohup ignores, which programs would inherit."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


def pytest_collection_modifyitems(items):
    """Mark the tests that need Chromium by the fixture that starts it; put long files first.

    So that in the end, processes wait for none of these.
    """
    for item in items:
        if "chromium" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.browser)
    long_files = {
        item.path
        for item in items
        if any(map(item.get_closest_marker, ("slow", "browser", "data")))
    }
    items.sort(key=lambda item: item.path not in long_files)


def mapped(events):
    """Return the result of mapping all events with the default configuration."""
    mapper = Mapper()
    for event in events:
        mapper.add(event)
    return mapper.finish()


@pytest.fixture(scope="session")
def shared_files(tmp_path_factory):
    """Files that several tests read, made once in the session."""
    return SharedFiles(tmp_path_factory.getbasetemp())


@pytest.fixture(scope="session")
def ring_drive():
    """Once around a ring of corridors and 5 m more, so that loops close: 626 scans in 125 s."""
    return simulate(ring(), seed=1, duration=125.0)


@pytest.fixture(scope="session")
def ring_events(ring_drive):
    """The events of :func:`ring_drive`, a list."""
    return list(ring_drive.events())


@pytest.fixture(scope="session")
def ring_log(ring_drive, shared_files):
    """The CARMEN log of :func:`ring_drive`."""
    return shared_files.path("ring.log.gz", ring_drive.write_carmen)


@pytest.fixture(scope="session")
def ring_result(ring_events):
    """The finished map of :func:`ring_drive`."""
    return mapped(ring_events)


@pytest.fixture(scope="session")
def two_rounds():
    """Twice around a ring of corridors 24 m wide, with odometry that slips and drifts."""
    return simulate(ring(), seed=2)


@pytest.fixture(scope="session")
def two_rounds_result(two_rounds):
    """The finished map of :func:`two_rounds`."""
    return mapped(two_rounds.events())
