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

from cartoloop.version import __version__ as __version__

if TYPE_CHECKING:
    from cartoloop.config import Config as Config
    from cartoloop.errors import CartoloopError as CartoloopError
    from cartoloop.errors import ConfigError as ConfigError
    from cartoloop.errors import InputError as InputError
    from cartoloop.errors import OutputError as OutputError
    from cartoloop.errors import UsageError as UsageError
    from cartoloop.localisation.localizer import Localizer as Localizer
    from cartoloop.map_editing.editor import Editor as Editor
    from cartoloop.mapper import Mapper as Mapper
    from cartoloop.merging import merge as merge
    from cartoloop.readers import open_log as open_log
    from cartoloop.readers import read as read
    from cartoloop.result import Result as Result
    from cartoloop.result import edit as edit
    from cartoloop.result import load_map as load_map
    from cartoloop.runs.recording import map_recording as map_recording
    from cartoloop.runs.resuming import resume_recording as resume_recording
    from cartoloop.runs.update import update_map as update_map
    from cartoloop.sensor.events import CloudGeometry as CloudGeometry
    from cartoloop.sensor.events import Imu as Imu
    from cartoloop.sensor.events import LaserScan as LaserScan
    from cartoloop.sensor.events import Odometry as Odometry
    from cartoloop.sensor.events import PointCloud as PointCloud
    from cartoloop.sensor.events import ScanGeometry as ScanGeometry
    from cartoloop.sensor.pose import Pose as Pose

    load = load_map

_HOME = {
    "CartoloopError": ("errors", "CartoloopError"),
    "CloudGeometry": ("sensor.events", "CloudGeometry"),
    "Config": ("config", "Config"),
    "ConfigError": ("errors", "ConfigError"),
    "Editor": ("map_editing.editor", "Editor"),
    "Imu": ("sensor.events", "Imu"),
    "InputError": ("errors", "InputError"),
    "LaserScan": ("sensor.events", "LaserScan"),
    "Localizer": ("localisation.localizer", "Localizer"),
    "Mapper": ("mapper", "Mapper"),
    "Odometry": ("sensor.events", "Odometry"),
    "OutputError": ("errors", "OutputError"),
    "PointCloud": ("sensor.events", "PointCloud"),
    "Pose": ("sensor.pose", "Pose"),
    "Result": ("result", "Result"),
    "ScanGeometry": ("sensor.events", "ScanGeometry"),
    "UsageError": ("errors", "UsageError"),
    "edit": ("result", "edit"),
    "load": ("result", "load_map"),
    "load_map": ("result", "load_map"),
    "map_recording": ("runs.recording", "map_recording"),
    "merge": ("merging", "merge"),
    "open_log": ("readers", "open_log"),
    "read": ("readers", "read"),
    "resume_recording": ("runs.resuming", "resume_recording"),
    "update_map": ("runs.update", "update_map"),
}
"""Module and name of each public object."""

__all__ = ["__version__", *_HOME]  # noqa: PLE0604 - keys are names


def __dir__() -> list[str]:
    """Return the public names, imported or not."""
    return sorted(__all__)


def __getattr__(name: str) -> object:
    """Import a public name when it is first used, so that the command line starts at once."""
    if name not in _HOME:
        raise AttributeError(f"module 'cartoloop' has no attribute {name!r}")
    module, attribute = _HOME[name]
    return getattr(import_module(f"cartoloop.{module}"), attribute)
