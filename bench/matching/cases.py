# SPDX-License-Identifier: Apache-2.0
"""Pairs of scan and submap to match: revisits, and scans from elsewhere in the building."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from bench.matching.programs import Problem, Window, branch_and_bound
from cartoloop.arrays import FloatArray, IntArray
from cartoloop.config import AdaptiveVoxelFilterConfig, Config
from cartoloop.global_slam.closure_search import mean_score
from cartoloop.global_slam.pose_graph import ConstraintKind
from cartoloop.mapper import Mapper
from cartoloop.readers import read
from cartoloop.scan_matching.branch_and_bound import SubmapMatcher
from cartoloop.sensor.events import LaserScan, SensorEvent
from cartoloop.sensor.pose import Pose, relative, transform_points
from cartoloop.sensor.range_filter import RangeFilter, thin
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.submaps.finished_grid import FinishedGrid

LOGS = ("mit-csail", "intel", "aces")
SIMULATED = "simulated office"

REVISIT_NODES = 60
"""Least distance in nodes between a revisit and all nodes of the submap."""

NEAR_M, ELSEWHERE_M = 4.0, 20.0
"""Distance from the submap's nearest node: at most for a hit, at least for a miss [m]."""

FITTING_SCORE = 0.6
"""Least score of a revisit's scan at its true pose."""

OFFSET = 0.8
"""Largest offset of an estimate, as a share of the window."""


@dataclass(slots=True)
class Place:
    """The map of one recording.

    Attributes
    ----------
    source : its name.
    grids : the submaps' grids; `matchers` : branch and bound in each.
    submap_poses, node_poses : shapes (m, 3), (n, 3), map frame, optimised.
    own_nodes : int64, by submap, the nodes that were inserted into it.
    returns : by node, shape (k, 2) [m], tracking frame, as filtered for insertion.
    """

    source: str
    grids: list[FinishedGrid]
    submap_poses: FloatArray
    node_poses: FloatArray
    own_nodes: list[IntArray]
    returns: list[FloatArray]
    matchers: list[SubmapMatcher] = field(init=False)

    def __post_init__(self) -> None:
        self.matchers = [SubmapMatcher(grid) for grid in self.grids]

    def cloud(self, node: int, num_points: int) -> FloatArray:
        """Return `num_points` points of a node's scan, evenly spaced; later scans fill up.

        The scans of the following nodes are placed by the poses of the graph.
        """
        scans: list[FloatArray] = []
        for other in (*range(node, len(self.returns)), *range(node - 1, -1, -1)):
            pose = relative(
                Pose(*self.node_poses[node].tolist()), Pose(*self.node_poses[other].tolist())
            )
            scans.append(transform_points(pose, self.returns[other]))
            if sum(map(len, scans)) >= num_points:
                break
        points = np.concatenate(scans)
        kept = np.linspace(0, len(points) - 1, min(num_points, len(points))).astype(np.int64)
        return np.ascontiguousarray(points[kept])

    def pose_in_submap(self, submap: int, node: int) -> Pose:
        """Return tf_submap_node as optimised."""
        return relative(
            Pose(*self.submap_poses[submap].tolist()), Pose(*self.node_poses[node].tolist())
        )


@dataclass(frozen=True, slots=True)
class Pair:
    """A scan to search for in a submap.

    Attributes
    ----------
    place, submap, node : the recording, the submap, and the node of the scan.
    points : float64, shape (n, 2), scan frame [m].
    centre : the scan's pose in the submap; for a miss, a wrong pose in it.
    offset : of the estimate from the centre, as shares of the window: x, y, theta.
    """

    place: Place
    submap: int
    node: int
    points: FloatArray
    centre: Pose
    offset: Pose

    def problem(
        self,
        window: Window,
        estimate_window: Window | None = None,
        points: FloatArray | None = None,
    ) -> Problem:
        """Return the problem of finding the scan in a window around the estimate.

        Parameters
        ----------
        window : to search.
        estimate_window : the estimate is within the inner part of this one; by default of `window`.
        points : to search for instead of the pair's own.
        """
        reach = estimate_window or window
        x, y, theta = self.offset
        estimate = Pose(
            self.centre.x + x * reach.linear,
            self.centre.y + y * reach.linear,
            self.centre.theta + theta * reach.angular,
        )
        return Problem(
            self.place.matchers[self.submap],
            self.place.grids[self.submap],
            self.points if points is None else points,
            estimate,
            window,
        )


def map_events(source: str, events: Iterable[SensorEvent], max_scans: int) -> Place:
    """Return the map of the first scans of a recording."""
    config = Config.model_validate({"global_slam": {"num_threads": 1}})
    mapper, range_filter = Mapper(config), RangeFilter(config.sensor)
    returns: list[FloatArray] = []
    for event in events:
        mapper.add(event)
        if mapper.num_nodes > len(returns) and isinstance(event, LaserScan):
            returns.append(range_filter.apply(event).returns)
        if mapper.num_scans >= max_scans:
            break
    result = mapper.finish()
    graph = result.graph
    inserted = graph.kinds == ConstraintKind.INTRA_SUBMAP
    return Place(
        source,
        result.submap_grids,
        graph.submap_poses,
        graph.node_poses,
        [
            np.sort(graph.index_b[inserted & (graph.index_a == submap)])
            for submap in range(graph.num_submaps)
        ],
        returns,
    )


def map_places(data: Path | None, max_scans: int) -> tuple[list[Place], list[str]]:
    """Return the maps of the recordings in a folder, and the names of those that are missing.

    Parameters
    ----------
    data : folder of the recordings; where none of them is in it, an office floor is simulated.
    max_scans : of each recording.
    """
    paths = {name: None if data is None else data / "radish" / f"{name}.clf.gz" for name in LOGS}
    found = {name: path for name, path in paths.items() if path is not None and path.is_file()}
    places = [map_events(name, read(path), max_scans) for name, path in found.items()]
    if not places:
        places.append(simulated_place(max_scans))
    return places, [name for name in LOGS if name not in found]


def simulated_place(max_scans: int) -> Place:
    """Return the simulated office, mapped."""
    from cartoloop.simulation import simulate
    from cartoloop.simulation.office import office

    return map_events(SIMULATED, simulate(office(0)).events(), max_scans)


def hits(place: Place, num_pairs: int, window: Window, min_num_points: int) -> list[Pair]:
    """Return up to `num_pairs` revisits, each of another node, that the search finds correctly.

    Parameters
    ----------
    num_pairs : number of pairs.
    window : the estimates are in its inner part, so that the scan is in the window.
    min_num_points : least number of points that scans are thinned to.
    """
    rng = np.random.default_rng(1)
    found: list[Pair] = []
    for node in rng.permutation(len(place.returns)).tolist():
        offset = Pose(*rng.uniform(-OFFSET, OFFSET, 3).tolist())
        fitting = [
            submap
            for submap, own in enumerate(place.own_nodes)
            if np.min(np.abs(own - node)) >= REVISIT_NODES
            and _distance(place, submap, node) <= NEAR_M
        ]
        if len(found) == num_pairs or not fitting:
            continue
        submap = int(rng.choice(fitting))
        centre = place.pose_in_submap(submap, node)
        points = _thinned(place, node, min_num_points)
        pair = Pair(place, submap, node, points, centre, offset)
        scan = ScanPoints.of([points])
        if mean_score(place.grids[submap], scan, np.array([centre])) < FITTING_SCORE:
            continue
        match = branch_and_bound(pair.problem(window))
        if match is not None and _is_same_place(match.tf_submap_scan, centre):
            found.append(pair)
    return found


def misses(
    place: Place, num_pairs: int, window: Window, min_num_points: int
) -> tuple[list[Pair], int]:
    """Return up to `num_pairs` pairs from elsewhere that do not match, and the number that did.

    The estimate is where one of the submap's own scans was taken, at any heading. Parameters are
    those of :func:`hits`.
    """
    rng = np.random.default_rng(2)
    found: list[Pair] = []
    num_alike = 0
    nodes = rng.permutation(len(place.returns)).tolist()
    for attempt, node in enumerate(nodes):
        submap = attempt % len(place.grids)
        own = int(rng.choice(place.own_nodes[submap]))
        x, y, _ = place.pose_in_submap(submap, own)
        centre = Pose(x, y, float(rng.uniform(-math.pi, math.pi)))
        if len(found) == num_pairs or _distance(place, submap, node) < ELSEWHERE_M:
            continue
        points = _thinned(place, node, min_num_points)
        pair = Pair(place, submap, node, points, centre, Pose(0.0, 0.0, 0.0))
        if branch_and_bound(pair.problem(window)) is None:
            found.append(pair)
        else:
            num_alike += 1
    return found, num_alike


def _thinned(place: Place, node: int, min_num_points: int) -> FloatArray:
    """Return a node's points, thinned by the mapper's filter."""
    config = AdaptiveVoxelFilterConfig(max_length=0.9, min_num_points=min_num_points)
    return np.ascontiguousarray(thin(place.returns[node], config))


def _distance(place: Place, submap: int, node: int) -> float:
    """Return the distance from a node to the nearest node of a submap [m]."""
    offsets = place.node_poses[place.own_nodes[submap], :2] - place.node_poses[node, :2]
    return float(np.hypot(offsets[:, 0], offsets[:, 1]).min())


def _is_same_place(found: Pose, truth: Pose) -> bool:
    """Return whether a match is within 0.3 m and 0.1 rad of the scan's pose in the graph."""
    away = math.hypot(found.x - truth.x, found.y - truth.y)
    return away <= 0.3 and abs(math.remainder(found.theta - truth.theta, math.tau)) <= 0.1
