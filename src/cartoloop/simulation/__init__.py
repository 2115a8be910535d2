# SPDX-License-Identifier: Apache-2.0
"""Worlds, scanners and odometry with known truth.

>>> from cartoloop.simulation import make_world, simulate
>>> recording = simulate(make_world("office"), seed=7)
>>> recording.write_log("office.log.gz")
>>> recording.write_truth("office.truth.tum")
"""

from cartoloop.simulation.campus import campus
from cartoloop.simulation.corridors import bare, corridor, ring
from cartoloop.simulation.difficulties import Difficulties
from cartoloop.simulation.drives import carry, simulate, simulate_rig
from cartoloop.simulation.flat import flat
from cartoloop.simulation.floor_plan import FloorPlan, Opening, World
from cartoloop.simulation.hall import hall
from cartoloop.simulation.lidar import LIDARS, Lidar, make_lidar
from cartoloop.simulation.motion import Motion, Pace, drive
from cartoloop.simulation.museum import large_museum, museum, museum_again
from cartoloop.simulation.odometry import PERFECT_ODOMETRY, OdometryModel
from cartoloop.simulation.odometry_faults import OdometryFault
from cartoloop.simulation.office import office
from cartoloop.simulation.recording import Recording
from cartoloop.simulation.rig import MountedLidar
from cartoloop.simulation.wings import wings
from cartoloop.simulation.worlds import WORLDS, make_world
from cartoloop.simulation.yard import yard

__all__ = [
    "LIDARS",
    "PERFECT_ODOMETRY",
    "WORLDS",
    "Difficulties",
    "FloorPlan",
    "Lidar",
    "Motion",
    "MountedLidar",
    "OdometryFault",
    "OdometryModel",
    "Opening",
    "Pace",
    "Recording",
    "World",
    "bare",
    "campus",
    "carry",
    "corridor",
    "drive",
    "flat",
    "hall",
    "large_museum",
    "make_lidar",
    "make_world",
    "museum",
    "museum_again",
    "office",
    "ring",
    "simulate",
    "simulate_rig",
    "wings",
    "yard",
]
