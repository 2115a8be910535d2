# SPDX-License-Identifier: Apache-2.0
"""The repair of a finished map whose visits contradict each other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from cartoloop.config import Config
from cartoloop.global_slam.global_slam import GlobalSlam
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.global_slam.repair import Contradictions
from cartoloop.quality.verdict import Quality
from cartoloop.quality.visits import contradicted_visits, is_contradicted
from cartoloop.result import Result


def repair(
    slam: GlobalSlam,
    make: Callable[[], Result],
    config: Config,
    quality: Quality,
    note: Callable[[str], None] | None = None,
) -> bool:
    """Make visits agree where the verdict says that they do not; return whether any now do.

    Parameters
    ----------
    slam : global SLAM of the map, finished; its graph is adjusted again.
    make : returns the map as it is, which takes a while.
    config : of the map.
    quality : the verdict on it.
    note : called with a description of the step as it begins.
    """
    if not (config.global_slam.constraint_search.repair.enabled and is_contradicted(quality)):
        return False
    if note is not None:
        note("searching where visits contradict each other")

    result = make()

    def find(graph: PoseGraph) -> Contradictions:
        return contradicted_visits(replace(result, graph=graph), config.quality)

    return slam.repair(find)
