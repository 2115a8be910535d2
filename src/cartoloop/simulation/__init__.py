# SPDX-License-Identifier: Apache-2.0
"""Worlds, scanners and odometry with known truth.

>>> from cartoloop.simulation import make_world, simulate
>>> recording = simulate(make_world("office"), seed=7)
>>> recording.write_log("office.log.gz")
>>> recording.write_truth("office.truth.tum")
"""

from cartoloop.simulation.drives import carry, simulate, simulate_rig
from cartoloop.simulation.flat import flat
from cartoloop.simulation.floor_plan import FloorPlan, Opening, World
from cartoloop.simulation.lidar import LIDARS, Lidar, make_lidar
from cartoloop.simulation.motion import Motion, Pace, drive
from cartoloop.simulation.museum import large_museum, museum, museum_again
from cartoloop.simulation.odometry import PERFECT_ODOMETRY, OdometryModel
from cartoloop.simulation.recording import Recording
from cartoloop.simulation.rig import MountedLidar
from cartoloop.simulation.worlds import WORLDS, corridor, make_world, office, ring

__all__ = [
    "LIDARS",
    "PERFECT_ODOMETRY",
    "WORLDS",
    "FloorPlan",
    "Lidar",
    "Motion",
    "MountedLidar",
    "OdometryModel",
    "Opening",
    "Pace",
    "Recording",
    "World",
    "carry",
    "corridor",
    "drive",
    "flat",
    "large_museum",
    "make_lidar",
    "make_world",
    "museum",
    "museum_again",
    "office",
    "ring",
    "simulate",
    "simulate_rig",
]
