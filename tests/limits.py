# SPDX-License-Identifier: Apache-2.0
"""Tests wait for conditions, never for a time: how long until one counts as never met."""

from __future__ import annotations

import time

LIMIT_S = 300.0
"""Longest wait for what takes a second on an idle machine [s]: tests run on busy ones, too."""


def wait_until(condition, period_s=0.01):
    """Return when a condition holds, looked at every `period_s` seconds."""
    end = time.monotonic() + LIMIT_S
    while not condition():
        assert time.monotonic() < end, f"not so within {LIMIT_S:g} s"
        time.sleep(period_s)
