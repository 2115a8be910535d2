# SPDX-License-Identifier: Apache-2.0
"""A browser for the tests of the page; where there is none they are skipped."""

from __future__ import annotations

from contextlib import ExitStack

import pytest

from cartoloop.benchmarks.browser import NoBrowserError, browser


@pytest.fixture(scope="module")
def chromium():
    """Chromium, one for all tests of a module."""
    with ExitStack() as stack:
        try:
            started = stack.enter_context(browser())
        except NoBrowserError as none:
            pytest.skip(str(none))
        yield started
