# SPDX-License-Identifier: Apache-2.0
"""What happened while mapping: counts, times and findings, written as ``report.json``."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import cartoloop
from cartoloop.global_slam.loop_closure import NO_CLOSURES, Closures
from cartoloop.global_slam.pose_adjustment import constraint_residuals
from cartoloop.global_slam.pose_graph import (
    TRUE_ROTATION_RAD,
    TRUE_TRANSLATION_M,
    ConstraintKind,
    PoseGraph,
)
from cartoloop.runtime.stage_timer import StageSummary
from cartoloop.sensor.pose import FloatArray, relative_all, wrap_angles

if TYPE_CHECKING:
    from cartoloop.global_slam.global_slam import AdjustmentRun


@dataclass(frozen=True, slots=True)
class InputSummary:
    """What was mapped.

    Attributes
    ----------
    name : file name of the recording, empty for a live source.
    scans : number of scans read, with and without a pose.
    duration_s : time between the first and the last scan [s].
    path_length_m : length of the optimised trajectory [m], in strides.
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
    loop_closure : loop closures in the graph.
    searched : pairs of scan and finished submap that were searched.
    precision : share of the loop closures, those rejected in the end among them, within 20 cm and
        1 degree of the optimised poses (table IV), None where there are no loop closures.
    rejected : loop closures taken out of the graph in the end, because the rest contradicted them.
    found : closures that the searches found; in the end, matches made anew take their place.
    found_precision : the same share of these.
    """

    intra_submap: int = 0
    loop_closure: int = 0
    searched: int = 0
    precision: float | None = None
    rejected: int = 0
    found: int = 0
    found_precision: float | None = None


@dataclass(frozen=True, slots=True)
class AdjustmentSummary:
    """How the pose graph was solved: every run, and their means.

    Attributes
    ----------
    runs : number of runs.
    mean_iterations : linear systems solved in a run, in the mean.
    mean_ms, last_ms : time of a run in the mean, and of the last [ms].
    each : the runs in order, with the size that the graph had.
    """

    runs: int = 0
    mean_iterations: float = 0.0
    mean_ms: float = 0.0
    last_ms: float = 0.0
    each: tuple[AdjustmentRun, ...] = ()

    @classmethod
    def of_runs(cls, runs: Sequence[AdjustmentRun]) -> AdjustmentSummary:
        """Return the summary of all runs of a map."""
        if not runs:
            return cls()
        return cls(
            runs=len(runs),
            mean_iterations=float(np.mean([run.iterations for run in runs])),
            mean_ms=float(np.mean([run.ms for run in runs])),
            last_ms=runs[-1].ms,
            each=tuple(runs),
        )


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


def summarize_constraints(
    graph: PoseGraph, searched: int, found: Closures = NO_CLOSURES, rejected: int = 0
) -> ConstraintSummary:
    """Return the counts of a graph's constraints, and how many closures agree with its poses.

    Parameters
    ----------
    graph : with optimised poses.
    searched : pairs of scan and finished submap that were searched.
    found : what the searches found.
    rejected : loop closures taken out of the graph.
    """
    closures = graph.kinds == ConstraintKind.LOOP_CLOSURE
    translation, rotation = constraint_residuals(graph)
    errors = found["tf_submap_node"] - relative_all(
        graph.submap_poses[found["submap"]], graph.node_poses[found["node"]]
    )
    return ConstraintSummary(
        intra_submap=int(np.count_nonzero(graph.kinds == ConstraintKind.INTRA_SUBMAP)),
        loop_closure=int(np.count_nonzero(closures)),
        searched=searched,
        precision=_precision(translation[closures], rotation[closures], rejected),
        rejected=rejected,
        found=len(found),
        found_precision=_precision(
            np.hypot(errors[:, 0], errors[:, 1]), np.abs(wrap_angles(errors[:, 2]))
        ),
    )


def _precision(
    translation_error: FloatArray, rotation_error: FloatArray, rejected: int = 0
) -> float | None:
    """Return the share of closures violated by no more than 20 cm and 1 degree (table IV)."""
    good = (translation_error <= TRUE_TRANSLATION_M) & (rotation_error <= TRUE_ROTATION_RAD)
    total = len(good) + rejected
    return float(np.count_nonzero(good)) / total if total else None


def peak_memory_mb() -> float:
    """Return the most memory that this process ever held [MB]; 0 where the system does not tell."""
    if sys.platform == "win32":
        return 0.0
    status = Path("/proc/self/status")
    if status.exists():  # getrusage would tell of the process, too, that this one was forked from
        for line in status.read_text(encoding="utf-8").splitlines():
            if line.startswith("VmHWM:"):
                return float(line.split()[1]) * 1024 / 1e6
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1e6 if sys.platform == "darwin" else peak * 1024 / 1e6
