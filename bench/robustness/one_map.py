# SPDX-License-Identifier: Apache-2.0
"""One recording mapped by the command line, and what can be said of its map."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bench.command_runs import run_command
from bench.robustness.runs import NO_VERDICT
from cartoloop.evaluation.closure_scores import (
    evaluate_closures,
    true_node_poses,
    true_submap_poses,
)
from cartoloop.evaluation.finished_run import FinishedRun, Stage, read_run
from cartoloop.evaluation.trajectories import Trajectory, read_tum
from cartoloop.evaluation.trajectory_error import evaluate_trajectory
from cartoloop.sensor.pose import relative_all

FALSE_JOIN_M = 1.0
"""A final closure that is farther from the truth joins what does not belong together [m]."""


@dataclass(frozen=True, slots=True)
class OneMap:
    """A finished map.

    Attributes
    ----------
    folder : what ``cartoloop map`` wrote.
    command : how.
    cpu_s : processor time of all threads [s].
    report : ``report.json``.
    """

    folder: Path
    command: str
    cpu_s: float
    report: dict[str, Any]

    @property
    def verdict(self) -> str:
        """The map's own verdict in one word, `NO_VERDICT` where it gives none."""
        found = self.report.get("quality", {}).get("verdict") or NO_VERDICT
        return str(found).split()[0]

    @property
    def trajectory(self) -> Trajectory:
        """The poses of all scans."""
        return read_tum(self.folder / "trajectory.tum")

    def figures(self) -> dict[str, float]:
        """Return processor time, path length, and the precision of found closures by the map."""
        found = {"cpu": self.cpu_s, "path": float(self.report["input"]["path_length_m"])}
        precision = self.report["constraints"]["found_precision"]
        if precision is not None:
            found["precision"] = float(precision)
        return found

    def true_figures(self, truth: Path) -> dict[str, float]:
        """Return the errors of trajectory and closures against the truth."""
        true = read_tum(truth)
        error = evaluate_trajectory(self.trajectory, true).absolute.translation
        run = read_run(self.folder)
        found = self.figures() | {
            "error": float(error.mean()),
            "rmse": float(np.sqrt(np.mean(error**2))),
            "largest": float(error.max()),
            "false joins": float(_false_joins(run, true)),
        }
        found.pop("precision", None)
        precision = evaluate_closures(run, true).found.true_precision
        return found if precision is None else found | {"precision": precision}


def map_log(log: Path, out: Path, options: Sequence[str] = ()) -> OneMap:
    """Map a recording with the defaults, or a few other parameters.

    Parameters
    ----------
    log : of any format.
    out : folder for the result.
    options : further arguments of ``cartoloop map``.

    Raises
    ------
    CommandFailed
        It cannot be mapped.
    """
    run = run_command("map", log, "-o", out, "--overwrite", *options)
    report = json.loads((out / "report.json").read_text(encoding="utf-8"))
    words = ["cartoloop map", str(log), "-o", str(out), *options]
    return OneMap(out, " ".join(words), run.cpu_s, report)


def _false_joins(run: FinishedRun, truth: Trajectory) -> int:
    """Return how many of the final closures are off by more than a metre."""
    nodes = true_node_poses(run, truth)
    submaps = true_submap_poses(run, nodes)
    final = run.closures[Stage.FINAL]
    apart = final.tf_submap_node - relative_all(submaps[final.submap], nodes[final.node])
    return int((np.hypot(apart[:, 0], apart[:, 1]) > FALSE_JOIN_M).sum())
