# SPDX-License-Identifier: Apache-2.0
"""The maps that mapping goes on from, as they are given: opened, and checked."""

from __future__ import annotations

from os import PathLike

from cartoloop.arguments import as_path, as_pose
from cartoloop.config import Config
from cartoloop.earlier_sessions import EarlierMaps
from cartoloop.errors import UsageError
from cartoloop.map_data import MapData
from cartoloop.sensor.pose import Pose


def checked_onto_pose(onto: object, pose: object, caller: str) -> Pose | None:
    """Return the pose of a robot in the map that is added to, as a caller gives it.

    Raises
    ------
    UsageError
        It is none, or there is no such map.
    """
    if pose is None:
        return None
    if onto is None:
        raise UsageError(f"{caller}: onto_pose is a pose in the map of onto: give that too")
    return Pose(*as_pose(pose, f"{caller}: onto_pose"))


def earlier_maps(
    onto: MapData | str | PathLike[str] | None, config: Config | None = None
) -> EarlierMaps:
    """Return the map that a session is added to, or none.

    Parameters
    ----------
    onto : the map, or its path.
    config : that the session is mapped with; None: that of the map.

    Raises
    ------
    InputError
        The map cannot be read.
    UsageError
        It cannot be added to with this configuration.
    """
    if onto is None:
        return EarlierMaps()
    content = map_of(onto, "onto")
    require_resolution(content, config or content.config)
    return EarlierMaps([content])


def map_of(given: MapData | str | PathLike[str], name: str) -> MapData:
    """Return a map, given itself or its path as the argument `name`."""
    if isinstance(given, MapData):
        return given
    from cartoloop.map_editing.open_map import open_map

    return open_map(as_path(given, name))


def require_resolution(content: MapData, config: Config) -> None:
    """Check that the submaps of a map and those of a configuration have the same resolution.

    Raises
    ------
    UsageError
        They have not.
    """
    given = config.local_slam.submaps.resolution
    for grid in content.submap_grids:
        if grid.size and abs(grid.resolution - given) > 1e-9:
            raise UsageError(
                f"the submaps of the map have a resolution of {grid.resolution:g} m and the "
                f"new ones {given:g} m; use --set local_slam.submaps.resolution="
                f"{grid.resolution:g}"
            )
