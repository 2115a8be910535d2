# SPDX-License-Identifier: Apache-2.0
"""The first run has a second process compile what it needs later; no kernel is compiled twice."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import cartoloop
from tests.limits import LIMIT_S

pytestmark = pytest.mark.slow

COUNT = """
import sys
import numpy as np
from numba.core import event
import pytest

from cartoloop.kernels.voxel_filter import adaptive_voxel_filter

class Names(event.Listener):
    def on_start(self, event):
        print(event.data["dispatcher"].__name__)

    def on_end(self, event):
        pass

event.register("numba:compile", Names())
points = np.random.default_rng(0).uniform(-5.0, 5.0, (300, 2))
kept = np.zeros_like(points)
print(adaptive_voxel_filter(points, 2.0, 100, 60.0, kept), kept.sum())
"""

SIGNATURES = """
import sys
from cartoloop.compile_ahead import compile_ahead
from cartoloop.live.warm_up import warm_up

def compiled():
    return {
        f"{module}.{name}": set(kernel.signatures)
        for module in list(sys.modules)
        if module.startswith("cartoloop.kernels.")
        for name, kernel in vars(sys.modules[module]).items()
        if getattr(kernel, "signatures", None) and kernel.py_func.__module__ == module
    }

compile_ahead()
ahead = compiled()
warm_up()
print(len(ahead))
for name, signatures in compiled().items():
    if signatures != ahead.get(name):
        print(name.split(".")[2])
"""

DRIVES = """
from cartoloop import Mapper
from cartoloop.simulation import Difficulties, corridor, office, simulate

drives = [
    simulate(office(), seed=1, duration=60.0, difficulties=Difficulties(people=2)),
    simulate(corridor(), seed=1, duration=30.0, with_odometry=False),
]
recorded = [list(drive.events()) for drive in drives]
ready = compiled()
for events in recorded:
    mapper = Mapper()
    for event in events:
        mapper.add(event)
    mapper.finish()
for name, signatures in compiled().items():
    if signatures != ready.get(name):
        print("later", name)
"""

LOCAL_SLAM = {
    "behind_walls",
    "changed_ranges",
    "correlative",
    "free_standing",
    "grid_update",
    "moved_points",
    "near_neighbours",
    "order_statistics",
    "outline_lines",
    "outline_shift",
    "pixel_rows",
    "range_projection",
    "ray_casting",
    "ray_fan",
    "scan_insertion",
    "search_order",
    "search_window",
    "scan_residuals",
    "slanting_walls",
    "sweep_projection",
    "turn_errors",
    "voxel_filter",
    "wall_joints",
    "wall_smoothing",
    "window_bounds",
}
"""The modules of kernels that the first process compiles itself."""


def test_two_processes_at_once_compile_each_kernel_once(tmp_path):
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", COUNT],
            env=os.environ | {"CARTOLOOP_CACHE_DIR": str(tmp_path)},
            stdout=subprocess.PIPE,
            text=True,
        )
        for _ in range(2)
    ]
    outputs = [process.communicate()[0].splitlines() for process in processes]
    assert outputs[0][-1] == outputs[1][-1]
    compiled = [name for lines in outputs for name in lines[:-1]]
    assert compiled.count("adaptive_voxel_filter") == 1
    assert min(map(len, outputs)) == 1


def test_all_kernels_of_global_slam_are_compiled_ahead():
    run = subprocess.run(
        [sys.executable, "-c", SIGNATURES], capture_output=True, text=True, check=True
    )
    num_ahead, *later = run.stdout.split()
    assert int(num_ahead) > 30
    assert set(later) <= LOCAL_SLAM


def test_a_warmed_up_robot_waits_for_no_compiler():
    run = subprocess.run(
        [sys.executable, "-c", SIGNATURES + DRIVES], capture_output=True, text=True, check=True
    )
    assert [line for line in run.stdout.splitlines() if line.startswith("later")] == []


def test_the_second_process_ends_with_the_first(tmp_path):
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", "cartoloop.compile_ahead"],
        env=os.environ
        | {
            "CARTOLOOP_CACHE_DIR": str(tmp_path),
            "PYTHONPATH": str(Path(cartoloop.__file__).parent.parent),
        },
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    assert process.communicate(timeout=LIMIT_S) == (b"", b"")
    assert process.returncode == 0
    assert not list(tmp_path.rglob("ahead-*"))
