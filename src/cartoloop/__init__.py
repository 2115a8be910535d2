# SPDX-License-Identifier: Apache-2.0
"""Real-time loop closure in 2D lidar SLAM: laser scans in, floor plans out.

>>> import cartoloop
>>> mapper = cartoloop.Mapper()
>>> for event in cartoloop.read("intel.clf.gz"):
...     mapper.add(event)
>>> mapper.finish().save("out")
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cartoloop.config import Config
    from cartoloop.errors import CartoloopError, ConfigError, InputError, OutputError
    from cartoloop.mapper import Mapper, Result
    from cartoloop.readers import read
    from cartoloop.recording_run import map_recording
    from cartoloop.sensor.events import (
        CloudGeometry,
        Imu,
        LaserScan,
        Odometry,
        PointCloud,
        ScanGeometry,
    )
    from cartoloop.sensor.pose import Pose

__version__ = "0.1.0"

_HOME = {
    "CartoloopError": "errors",
    "CloudGeometry": "sensor.events",
    "Config": "config",
    "ConfigError": "errors",
    "Imu": "sensor.events",
    "InputError": "errors",
    "LaserScan": "sensor.events",
    "Mapper": "mapper",
    "Odometry": "sensor.events",
    "OutputError": "errors",
    "PointCloud": "sensor.events",
    "Pose": "sensor.pose",
    "Result": "mapper",
    "ScanGeometry": "sensor.events",
    "map_recording": "recording_run",
    "read": "readers",
}

__all__ = [
    "CartoloopError",
    "CloudGeometry",
    "Config",
    "ConfigError",
    "Imu",
    "InputError",
    "LaserScan",
    "Mapper",
    "Odometry",
    "OutputError",
    "PointCloud",
    "Pose",
    "Result",
    "ScanGeometry",
    "__version__",
    "map_recording",
    "read",
]


def __getattr__(name: str) -> object:
    """Import a public name when it is first used, so that the command line starts at once."""
    if name not in _HOME:
        raise AttributeError(f"module 'cartoloop' has no attribute {name!r}")
    return getattr(import_module(f"cartoloop.{_HOME[name]}"), name)
