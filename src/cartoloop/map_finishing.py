# SPDX-License-Identifier: Apache-2.0
"""The last steps of a map, after all loops are closed: trimmed, examined, repaired."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from cartoloop.config import Config
from cartoloop.global_slam.global_slam import GlobalSlam
from cartoloop.lifelong.trim import trimmed
from cartoloop.map_repair import repair
from cartoloop.quality.examine import examine
from cartoloop.result import Result
from cartoloop.runtime.stage_timer import StageTimer


def finished_map(
    slam: GlobalSlam,
    make: Callable[[], Result],
    config: Config,
    timer: StageTimer,
    note: Callable[[str], None] | None = None,
) -> Result:
    """Return a map with the verdict on it in the report, repaired if visits contradict each other.

    Without what the newest session has superseded, if that is on.

    Parameters
    ----------
    slam : global SLAM of the map, finished; it is adjusted again where the map is repaired.
    make : returns the map as it is, which takes a while.
    config : of the map.
    timer : takes the times.
    note : called with a description of each step as it begins.
    """
    announce = note or (lambda _: None)

    def examined() -> Result:
        result = make()
        if config.lifelong.enabled:
            announce("removing what was seen again")
            with timer.measure("trim"):
                result = trimmed(result)
        announce("examining the map")
        with timer.measure("examine"):
            odometry = result.report.extra.get("odometry")
            quality = examine(result, config.quality, odometry)
        report = replace(result.report, quality=quality, stages=timer.summary(), finished=True)
        return replace(result, report=report)

    finished = examined()
    if repair(slam, make, config, finished.quality, note):
        finished = examined()
    return finished
