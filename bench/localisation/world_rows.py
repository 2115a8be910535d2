# SPDX-License-Identifier: Apache-2.0
"""Rows of the benchmark of localisation on simulated worlds."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from bench.localisation import measures
from bench.record import Case, Figure, Row


def live_row(case: Case, runs: Sequence[measures.Followed]) -> Row:
    """Return what the thread spends that adds the scans of robots from nowhere."""
    times = 1e3 * np.concatenate([run.processor for run in runs])
    return Row(
        {"what": "a robot, from nowhere", **case},
        {
            "scans": Figure.exact(len(times), better=None),
            "time of the calling thread": Figure(float(np.median(times)), "ms"),
            "99%": Figure(float(np.quantile(times, 0.99)), "ms"),
            "longest": Figure(float(times.max()), "ms"),
        },
    )


def stranger_row(case: Case, runs: Sequence[measures.Followed]) -> Row:
    """Return how often a robot is located in the map of another building."""
    decisions = sum(sum(run.states.values()) for run in runs)
    located = sum(run.num_located for run in runs)
    return Row(
        {"what": "in the map of another building", **case},
        {
            "drives": Figure.exact(len(runs), better=None),
            "wrong": Figure.exact(100.0 * located / max(decisions, 1), "%"),
            "longest located": Figure.exact(max(run.longest_located_s for run in runs), "s"),
        },
    )


def carried_row(case: Case, found: Sequence[measures.CarriedAway]) -> Row:
    """Return how soon robots notice that they were carried away, and where they are."""
    noticed = np.array([one.noticed_path <= 3.0 or one.noticed_s <= 5.0 for one in found])
    again = np.array([one.found_path <= 10.0 for one in found])
    paths = [one.found_path for one in found if math.isfinite(one.found_path)]
    return Row(
        {"what": "carried away", **case},
        {
            "drives": Figure.exact(len(found), better=None),
            "noticed within 3 m or 5 s": share(noticed, "more"),
            "within 10 m": share(again, "more"),
            "found after": Figure.exact_of_inputs(paths or [math.inf], "m"),
        },
    )


def share(values: np.ndarray[tuple[int], np.dtype[np.bool_]], better: str) -> Figure:
    """Return the share of true values."""
    percent = 100.0 * float(values.mean()) if len(values) else math.nan
    return Figure.exact(percent, "%", "more" if better == "more" else "less")
