# SPDX-License-Identifier: Apache-2.0
"""The options of the C library that are set, where it has them."""

from __future__ import annotations

import ctypes
from types import SimpleNamespace

import pytest

from cartoloop.runtime.process_memory import (
    PeriodicRelease,
    peak_memory_mb,
    release_unused_memory,
    set_malloc_thresholds,
)


def test_malloc_thresholds_of_glibc_are_set(monkeypatch):
    calls = []
    library = SimpleNamespace(mallopt=lambda option, value: calls.append((option, value)))
    monkeypatch.setattr(ctypes, "CDLL", lambda name: library)
    set_malloc_thresholds()
    assert calls == [(-1, 16777216), (-3, 2097152)]


def test_glibc_returns_unused_memory(monkeypatch):
    calls = []
    monkeypatch.setattr(ctypes, "CDLL", lambda name: SimpleNamespace(malloc_trim=calls.append))
    release_unused_memory()
    assert calls == [0]


def test_memory_is_released_periodically(monkeypatch):
    calls = []
    monkeypatch.setattr(ctypes, "CDLL", lambda name: SimpleNamespace(malloc_trim=calls.append))
    release = PeriodicRelease(period=3)
    counts = []
    for _ in range(7):
        release.after_scan()
        counts.append(len(calls))
    assert counts == [0, 0, 1, 1, 1, 2, 2]


@pytest.mark.parametrize("error", [AttributeError, OSError, TypeError])
def test_other_c_libraries_are_left_as_they_are(monkeypatch, error):
    def no_such_library(name):
        raise error

    monkeypatch.setattr(ctypes, "CDLL", no_such_library)
    set_malloc_thresholds()
    release_unused_memory()


def test_peak_memory_is_measured():
    assert 10 < peak_memory_mb() < 1e5
