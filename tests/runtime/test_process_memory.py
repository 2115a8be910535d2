# SPDX-License-Identifier: Apache-2.0
"""The C library is told how to deal with large blocks where it can be told."""

from __future__ import annotations

import ctypes
from types import SimpleNamespace

import pytest

from cartoloop.runtime.process_memory import set_malloc_thresholds, release_unused_memory


def test_glibc_is_told_to_set_malloc_thresholds_and_to_keep_a_few_megabytes(monkeypatch):
    told = []
    library = SimpleNamespace(mallopt=lambda option, value: told.append((option, value)))
    monkeypatch.setattr(ctypes, "CDLL", lambda name: library)
    set_malloc_thresholds()
    assert told == [(-1, 16777216), (-3, 2097152)]


def test_glibc_is_told_to_return_what_is_not_used(monkeypatch):
    told = []
    monkeypatch.setattr(ctypes, "CDLL", lambda name: SimpleNamespace(malloc_trim=told.append))
    release_unused_memory()
    assert told == [0]


@pytest.mark.parametrize("error", [AttributeError, OSError, TypeError])
def test_other_systems_are_left_alone(monkeypatch, error):
    def no_such_library(name):
        raise error

    monkeypatch.setattr(ctypes, "CDLL", no_such_library)
    set_malloc_thresholds()
    release_unused_memory()
