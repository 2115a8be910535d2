# SPDX-License-Identifier: Apache-2.0
"""Kernels come out of the cache without the compiler, and can still be compiled into others."""

from __future__ import annotations

import os
import subprocess
import sys

PROGRAM = """
import sys
import numpy as np
from cartoloop._jit import watch_compilation
from cartoloop.kernels.voxel_filter import adaptive_voxel_filter, voxel_filter

points = np.random.default_rng(0).uniform(-5.0, 5.0, (300, 2))
kept = np.zeros_like(points)
with watch_compilation(lambda: print("compiles")):
    print(voxel_filter(points, len(points), 0.5, kept), kept.sum())
    print("compiler ready:", "numba.np.arraymath" in sys.modules)
    print(adaptive_voxel_filter(points, 2.0, 100, 60.0, kept), kept.sum())
"""


def _run(cache):
    return subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env=os.environ | {"CARTOLOOP_CACHE_DIR": str(cache)},
        capture_output=True,
        text=True,
        check=True,
    ).stdout.splitlines()


def test_kernels_from_the_cache_work_without_the_compiler(tmp_path):
    compiles, once, ready, adaptive = _run(tmp_path)
    assert (compiles, ready) == ("compiles", "compiler ready: True")
    assert _run(tmp_path) == [once, "compiler ready: False", adaptive]


def test_kernels_from_the_cache_are_compiled_into_a_new_one(tmp_path):
    _, once, _, adaptive = _run(tmp_path)
    caller = [file for file in tmp_path.rglob("*") if "adaptive_voxel_filter" in file.name]
    assert caller
    for file in caller:
        file.unlink()
    assert _run(tmp_path) == [once, "compiler ready: False", "compiles", adaptive]
