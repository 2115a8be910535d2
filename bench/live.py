# SPDX-License-Identifier: Apache-2.0
"""``python -m bench live``: the latency of a pose in live mapping, with loop closure running."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from bench.command_runs import run_module
from bench.environment import environment
from bench.live_replay import PaceResult
from bench.museum_log import museum_or
from bench.record import Figure, Record, Row

SHARE_BEFORE = 0.5
"""Share of the recording that is mapped before the measurement, so that loops are closed in it."""


def run(
    paces: Sequence[float],
    seconds: float,
    *,
    log: Path | None = None,
    progress: Callable[[str], None],
    seed: int = 0,
    repeats: int = 1,
) -> Record:
    """Return the latencies of a museum's scans that arrive as from a robot, at several paces.

    Parameters
    ----------
    paces : times real time, one part of the recording each.
    seconds : duration of each part [s].
    log : a recording instead of the museum.
    progress : called with a line on progress.
    seed : of the building, the walk and all noise.
    repeats : of the whole measurement.

    Raises
    ------
    CommandFailed
        The replay ended in an error.
    """
    from cartoloop.readers import open_log

    with tempfile.TemporaryDirectory(prefix="cartoloop-live-") as folder:
        path = museum_or(log, Path(folder), seed, progress)
        num_first = round(SHARE_BEFORE * open_log(path).num_scans)
        runs = []
        for number in range(repeats):
            progress(f"replaying {path.name}, {number + 1} of {repeats}")
            runs.append(_replay(path, num_first, paces, seconds))
    return Record(
        "live", tuple(_row(list(same)) for same in zip(*runs, strict=True)), environment()
    )


def _replay(path: Path, num_first: int, paces: Sequence[float], seconds: float) -> list[PaceResult]:
    parts = [number for pace in paces for number in (pace, seconds)]
    output = run_module(f"replaying {path.name}", "live_replay", path, num_first, *parts)
    return [PaceResult(**part) for part in json.loads(output)]


def _row(same: Sequence[PaceResult]) -> Row:
    """Return the figures of one pace in all repeats."""
    quantiles = np.array([np.quantile(run.latencies, (0.5, 0.99, 1.0)) for run in same]) * 1e3
    pose_cpu = [1e3 * float(np.quantile(run.pose_cpu_s, 0.99)) for run in same]
    cpu = [1e3 * float(np.quantile(run.cpu_s, 0.99)) for run in same]
    joined = [max(run.joined_after, default=0.0) for run in same]
    first = same[0]
    return Row(
        {"times real time": first.pace},
        {
            "scans": Figure.exact(first.scans, better=None),
            "without a pose": Figure.of_samples([run.scans - run.poses for run in same], ""),
            "median latency": Figure.of_samples(quantiles[:, 0].tolist(), "ms"),
            "99% within": Figure.of_samples(quantiles[:, 1].tolist(), "ms"),
            "longest": Figure.of_samples(quantiles[:, 2].tolist(), "ms"),
            "CPU until the pose, 99% within": Figure.of_samples(pose_cpu, "ms"),
            "CPU, 99% within": Figure.of_samples(cpu, "ms"),
            "nodes": Figure.of_samples([run.nodes for run in same], "", None),
            "closures": Figure.of_samples([run.closures for run in same], "", None),
            "closures join within": Figure.of_samples(joined, "periods"),
            "adjustments": Figure.of_samples([run.adjustments for run in same], "", None),
            "searches": Figure.of_samples([run.searched for run in same], "", None),
            "put off": Figure.of_samples([run.put_off for run in same], ""),
            "dropped": Figure.of_samples([run.dropped for run in same], ""),
            "journal_bytes": Figure.of_samples([run.journal_bytes for run in same], "B", None),
        },
    )
