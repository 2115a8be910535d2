# SPDX-License-Identifier: Apache-2.0
"""The comparison of the visits of a map, and those that contradict a submap."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.config import QualityConfig
from cartoloop.global_slam.repair import Contradicted, Contradictions
from cartoloop.quality import by_session
from cartoloop.quality.encounters import Encounters, encounters
from cartoloop.quality.pairs import MapContent, Pairs, compared_pairs, path_lengths, scans_of
from cartoloop.quality.verdict import Kind, Quality, Severity
from cartoloop.sensor.pose import Pose
from cartoloop.sensor.scan_points import ScanPoints


class Visits(NamedTuple):
    """Nodes compared with submaps.

    Attributes
    ----------
    met : returns to a submap after a path of ``min_visit_path``.
    seen : the same, of nodes from which the submap is only seen.
    consecutive : pairs with a shorter path between them.
    paths : float64, shape (num_nodes,), path length of each node [m]; sessions are far apart.
    """

    met: Encounters
    seen: Encounters
    consecutive: Pairs
    paths: FloatArray


def compare_visits(content: MapContent, scans: ScanPoints, config: QualityConfig) -> Visits:
    """Return the comparison of all visits.

    Parameters
    ----------
    content : the map.
    scans : the returns of its nodes.
    config : limits.
    """
    paths = by_session.paths_apart(path_lengths(content.graph.node_poses), content.sessions)
    same_part = by_session.same_part(content)
    pairs = compared_pairs(content, scans, config, paths, same_part, config.visit_distance)
    is_apart = pairs.path >= config.min_visit_path
    is_near = pairs.distance < config.nearby
    met = encounters(pairs.take(is_apart & is_near), paths, content, scans, config)
    seen = encounters(pairs.take(is_apart & ~is_near), paths, content, scans, config)
    return Visits(met, seen, pairs.take(~is_apart), paths)


def contradicted_visits(content: MapContent, config: QualityConfig) -> Contradictions:
    """Return the visits of a map that contradict a submap."""
    met, seen, _, paths = compare_visits(content, scans_of(content), config)
    visits = [visit for some in (met, seen) for visit in _contradicted(some)]
    length = sum(float(some.length[some.contradicts].sum()) for some in (met, seen))
    return Contradictions(visits, length, paths)


def is_contradicted(quality: Quality) -> bool:
    """Return whether a map is doubtful or wrong because visits contradict each other."""
    return any(
        place.kind is Kind.CONTRADICTION and place.severity is not Severity.MINOR
        for place in quality.places
    )


def _contradicted(met: Encounters) -> list[Contradicted]:
    rows = np.flatnonzero(met.contradicts)
    pairs = met.pairs.take(met.middle[rows])
    return [
        Contradicted(submap, node, Pose(*pose))
        for submap, node, pose in zip(
            pairs.submap.tolist(), pairs.node.tolist(), pairs.tf_submap_node.tolist(), strict=True
        )
    ]
