# SPDX-License-Identifier: Apache-2.0
"""Compilation of kernels is reported, and happens once."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

pytestmark = pytest.mark.slow

PROGRAM = """
import numpy as np
import pytest

from cartoloop._jit import watch_compilation
from cartoloop.kernels.voxel_filter import voxel_filter

points = np.zeros((3, 2))
with watch_compilation(lambda: print("compiles")) as watch:
    for _ in range(2):
        voxel_filter(points, 3, 0.1, points)
print(watch.seconds > 0.0)
"""


def test_compilation_is_reported_once_and_timed(tmp_path):
    def run():
        return subprocess.run(
            [sys.executable, "-c", PROGRAM],
            env=os.environ | {"CARTOLOOP_CACHE_DIR": str(tmp_path)},
            capture_output=True,
            text=True,
            check=True,
        ).stdout.split()

    assert run() == ["compiles", "True"]
    assert run() == ["False"]
