# SPDX-License-Identifier: Apache-2.0
"""The inputs of the kernel benchmark: the first minutes of simulated drives in local SLAM."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from cartoloop.arrays import FloatArray
from cartoloop.config import Config
from cartoloop.local_slam.local_slam import LocalSlam, LocalSlamResult
from cartoloop.runtime.stage_timer import StageTimer
from cartoloop.sensor.events import LaserScan, Odometry, SensorEvent
from cartoloop.sensor.pose import Pose
from cartoloop.simulation import make_world, simulate
from cartoloop.simulation.lidar import make_lidar
from cartoloop.submaps.finished_grid import FinishedGrid
from cartoloop.submaps.node import Node
from cartoloop.submaps.submap import Submap

DRIVES = {
    "office, 180 beams": ("office", "sick-180", 120.0),
    "office, 361 beams": ("office", "sick", 120.0),
    "museum, 1079 beams": ("museum", "backpack", 60.0),
}
"""World, scanner and duration [s] of each drive; each finishes at least one submap."""


@dataclass
class Drive:
    """The start of a drive, mapped by local SLAM.

    Attributes
    ----------
    name : one of :data:`DRIVES`.
    events : odometry and scans in turn, the first `num_replayed` of each.
    scans : all of them, with their poses in `poses`, local frame.
    nodes : the scans that were inserted.
    finished : the submaps that are finished, with their grids in `grids`.
    growing : the submap that the last scan was matched against.
    config : the defaults.
    """

    name: str
    num_replayed: int = 50
    events: list[SensorEvent] = field(default_factory=list)
    scans: list[LaserScan] = field(default_factory=list)
    poses: list[Pose] = field(default_factory=list)
    nodes: list[Node] = field(default_factory=list)
    finished: list[Submap] = field(default_factory=list)
    grids: list[FinishedGrid] = field(default_factory=list)
    growing: Submap | None = None
    config: Config = field(default_factory=Config)

    @property
    def points(self) -> FloatArray:
        """The last node's points, as loop closure searches for them, shape (n, 2) [m]."""
        return self.nodes[-1].points


def drive(name: str) -> Drive:
    """Return the drive of a name, by local SLAM with the defaults."""
    world, lidar, duration = DRIVES[name]
    recording = simulate(make_world(world), make_lidar(lidar), duration=duration)
    done = Drive(name)
    events = list(recording.events(with_odometry=True))
    done.events = events[: 2 * done.num_replayed]
    for scan, result in _local_slam(events, done):
        done.scans.append(scan)
        done.poses.append(result.tf_local_tracking)
        if result.node is not None:
            done.nodes.append(result.node)
            if result.node.finished is not None:
                done.finished.append(result.node.finished)
    done.grids = [submap.grid.finish() for submap in done.finished]
    return done


def replay(events: Sequence[SensorEvent]) -> None:
    """Run local SLAM over events."""
    for _ in _local_slam(events, Drive("")):
        pass


def _local_slam(
    events: Iterable[SensorEvent], driven: Drive
) -> Iterator[tuple[LaserScan, LocalSlamResult]]:
    """Yield scans with their results, and leave the submap that grows with the drive."""
    config = driven.config
    node_filter = config.global_slam.constraint_search.adaptive_voxel_filter
    slam = LocalSlam(config.local_slam, config.sensor, node_filter, StageTimer())
    for event in events:
        if isinstance(event, Odometry):
            slam.add_odometry(event)
        elif isinstance(event, LaserScan):
            yield event, slam.add_scan(event)
            driven.growing = slam.active_submaps[0]
