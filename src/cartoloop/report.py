# SPDX-License-Identifier: Apache-2.0
"""What happened while mapping: counts, times and findings, written as ``report.json``."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cartoloop.global_slam.closure_residuals import precision, residuals
from cartoloop.global_slam.closure_status import Status
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.pose_adjustment import constraint_residuals
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.quality.odometry_warnings import odometry_warnings, side_warning
from cartoloop.quality.verdict import Quality
from cartoloop.runtime.process_memory import peak_memory_mb
from cartoloop.runtime.stage_timer import StageSummary
from cartoloop.sensor.events import CloudGeometry, ScanGeometry
from cartoloop.version import __version__

if TYPE_CHECKING:
    from cartoloop.global_slam.graph_adjustment import AdjustmentRun


@dataclass(frozen=True, slots=True)
class InputSummary:
    """What was mapped.

    Attributes
    ----------
    name : file name of the recording, or the live source.
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
    """The constraints of the pose graph, and what became of all pairs that were searched.

    Attributes
    ----------
    intra_submap : constraints of nodes to the submaps that they were inserted into.
    loop_closure : loop closures in the graph.
    searched : pairs of node and finished submap that were searched while mapping.
    precision : share of the loop closures, those contradicted among them, within 20 cm and
        1 degree of the optimised poses (table IV), None where there are no loop closures.
    rejected : loop closures removed from the graph at the end, because the others contradict them.
    found : closures that the searches found.
    found_precision : the same share of these.
    fates : number of rows of the record by status; all that are not 0.
    fates_of_searched, fates_of_found : the same of the pairs searched, and of those found: their
        sums are `searched` and `found`.
    """

    intra_submap: int = 0
    loop_closure: int = 0
    searched: int = 0
    precision: float | None = None
    rejected: int = 0
    found: int = 0
    found_precision: float | None = None
    fates: dict[str, int] = field(default_factory=dict)
    fates_of_searched: dict[str, int] = field(default_factory=dict)
    fates_of_found: dict[str, int] = field(default_factory=dict)


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
    quality : the verdict on the map, with places and figures; see docs/quality.md.
    version, config_hash : which program with which parameters made the result.
    finished : whether the run came to its end, with the last pass: neither stopped nor failed.
    fingerprint : 16 hex digits by which the recording is known again (`readers/fingerprint.py`);
        different for each live run; empty of events that a program fed.
    extra : further keys of the top level, such as ``sensors``; values must be JSON.
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
    quality: Quality = field(default_factory=Quality)
    version: str = __version__
    config_hash: str = ""
    finished: bool = False
    fingerprint: str = ""
    extra: dict[str, Any] = field(default_factory=dict)

    def to_json(self) -> str:
        """Return the report as the text of ``report.json``.

        Raises
        ------
        ValueError
            `extra` holds one of the stable keys.
        """
        keys = asdict(self)
        extra = keys.pop("extra")
        if taken := keys.keys() & extra.keys():
            raise ValueError(f"keys of the report cannot be replaced: {', '.join(sorted(taken))}")
        return json.dumps(keys | extra, indent=2, allow_nan=False) + "\n"


class RunClock:
    """Measures time and memory of a run, from its construction on."""

    def __init__(self) -> None:
        self._start, self._cpu_start = time.perf_counter(), time.process_time()

    def timed(self, report: Report) -> Report:
        """Return the report with the time and memory that the run took so far."""
        wall_s, cpu_s = time.perf_counter() - self._start, time.process_time() - self._cpu_start
        return with_times(report, wall_s, cpu_s)


def with_times(report: Report, wall_s: float, cpu_s: float) -> Report:
    """Return the report with the times that a run took [s], and the memory of the process."""
    return replace(
        report,
        wall_s=wall_s,
        cpu_s=cpu_s,
        peak_memory_mb=peak_memory_mb(),
        real_time_factor=report.input.duration_s / wall_s,
    )


def summarize_sensor(geometry: ScanGeometry | CloudGeometry) -> dict[str, Any]:
    """Return what is to be known of a scanner, for the report: JSON, with units in the keys."""
    beams: int | None = None
    field_of_view_deg: float | None = None
    if isinstance(geometry, ScanGeometry):
        beams = int(geometry.num_beams)
        field_of_view_deg = math.degrees(abs(geometry.angle_increment)) * max(beams - 1, 0)
    return {
        "name": geometry.sensor,
        "beams": beams,
        "field_of_view_deg": field_of_view_deg,
        "range_max_m": geometry.range_max if math.isfinite(geometry.range_max) else None,
        "pose": list(geometry.tf_tracking_sensor),
    }


def sensor_warnings(report: Report) -> list[str]:
    """Return a line about each sensor that was not used as it is."""
    odometry = report.extra.get("odometry")
    noise = [
        f"returns of {name} beyond {limit:.1f} m were left out: their noise is too large there; "
        "sensor.max_range sets another limit"
        for name, limit in report.extra.get("useful_range_m", {}).items()
    ]
    side = side_warning(odometry)
    return [*([side] if side else []), *odometry_warnings(odometry), *noise]


def summarize_constraints(graph: PoseGraph, closures: Closures) -> ConstraintSummary:
    """Return the counts of a graph's constraints and of the record of closures.

    Parameters
    ----------
    graph : with optimised poses.
    closures : the record.
    """
    in_graph = graph.kinds == ConstraintKind.LOOP_CLOSURE
    translation, rotation = constraint_residuals(graph, np.flatnonzero(in_graph))
    found = closures.found
    num_contradicted = closures.counts()[Status.CONTRADICTED]
    return ConstraintSummary(
        intra_submap=int(np.count_nonzero(graph.kinds == ConstraintKind.INTRA_SUBMAP)),
        loop_closure=int(np.count_nonzero(in_graph)),
        searched=closures.num_searched,
        precision=precision(translation, rotation, num_contradicted),
        rejected=num_contradicted,
        found=len(found),
        found_precision=precision(*residuals(found, graph.submap_poses, graph.node_poses)),
        fates=_fates(closures.status),
        fates_of_searched=_fates(closures.status[closures.was_searched]),
        fates_of_found=_fates(closures.status[found.row]),
    )


def _fates(statuses: NDArray[np.int8]) -> dict[str, int]:
    counts = np.bincount(statuses, minlength=len(Status)).tolist()
    return {status.text: counts[status] for status in Status if counts[status]}
