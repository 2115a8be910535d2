# SPDX-License-Identifier: Apache-2.0
"""What happened while mapping: counts, times and findings, written as ``report.json``."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

import cartoloop
from cartoloop.global_slam.pose_adjustment import constraint_residuals
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.stage_timer import StageSummary


@dataclass(frozen=True, slots=True)
class InputSummary:
    """What was mapped.

    Attributes
    ----------
    name : file name of the recording, empty for a live source.
    scans : number of scans read, with and without a pose.
    duration_s : time between the first and the last scan [s].
    path_length_m : length of the optimised trajectory [m].
    """

    name: str = ""
    scans: int = 0
    duration_s: float = 0.0
    path_length_m: float = 0.0


@dataclass(frozen=True, slots=True)
class ConstraintSummary:
    """How the pose graph is tied.

    Attributes
    ----------
    intra_submap : constraints of scans to the submaps they were inserted into.
    loop_closure : accepted loop closures.
    searched : pairs of scan and finished submap that were searched.
    precision : share of the loop closures within 20 cm and 1 degree of the optimised poses
        (table IV), None where there are no loop closures.
    """

    intra_submap: int = 0
    loop_closure: int = 0
    searched: int = 0
    precision: float | None = None


@dataclass(frozen=True, slots=True)
class AdjustmentSummary:
    """How the pose graph was solved: runs, their mean iterations, mean and last time [ms]."""

    runs: int = 0
    mean_iterations: float = 0.0
    mean_ms: float = 0.0
    last_ms: float = 0.0


@dataclass(frozen=True, slots=True)
class Report:
    """The keys of ``report.json``; names and meaning are stable.

    Attributes
    ----------
    input, constraints, adjustment : see their classes.
    wall_s, cpu_s : time taken by the run, and processor time of all its threads [s].
    peak_memory_mb : most memory that the process ever held [MB].
    real_time_factor : `input.duration_s` / `wall_s`.
    nodes, submaps : size of the pose graph.
    stages : durations by stage.
    skipped : number of lines, scans or events that were skipped, by reason.
    version, config_hash : which program with which parameters made the result.
    extra : further keys of the top level, such as ``findings``; values must be JSON.
    """

    input: InputSummary = InputSummary()
    wall_s: float = 0.0
    cpu_s: float = 0.0
    peak_memory_mb: float = 0.0
    real_time_factor: float = 0.0
    nodes: int = 0
    submaps: int = 0
    constraints: ConstraintSummary = ConstraintSummary()
    adjustment: AdjustmentSummary = AdjustmentSummary()
    stages: dict[str, StageSummary] = field(default_factory=dict)
    skipped: dict[str, int] = field(default_factory=dict)
    version: str = cartoloop.__version__
    config_hash: str = ""
    extra: dict[str, Any] = field(default_factory=dict)

    def to_json(self) -> str:
        """Return the report as the text of ``report.json``."""
        keys = asdict(self)
        extra = keys.pop("extra")
        return json.dumps(keys | extra, indent=2, allow_nan=False) + "\n"


def summarize_constraints(graph: PoseGraph, searched: int) -> ConstraintSummary:
    """Return the counts of a graph's constraints, and how many closures agree with its poses.

    Parameters
    ----------
    graph : with optimised poses.
    searched : pairs of scan and finished submap that were searched.
    """
    closures = graph.kinds == ConstraintKind.LOOP_CLOSURE
    num_closures = int(np.count_nonzero(closures))
    translation, rotation = constraint_residuals(graph)
    good = closures & (translation <= 0.2) & (rotation <= np.radians(1.0))  # table IV
    return ConstraintSummary(
        intra_submap=int(np.count_nonzero(graph.kinds == ConstraintKind.INTRA_SUBMAP)),
        loop_closure=num_closures,
        searched=searched,
        precision=int(np.count_nonzero(good)) / num_closures if num_closures else None,
    )


def peak_memory_mb() -> float:
    """Return the most memory that this process ever held [MB]; 0 where the system does not tell."""
    if sys.platform == "win32":
        return 0.0
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1e6 if sys.platform == "darwin" else peak * 1024 / 1e6
