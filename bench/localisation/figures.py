# SPDX-License-Identifier: Apache-2.0
"""Figures of the benchmark of localisation."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from bench.localisation import measures
from bench.record import Better, Figure


def driving_figures(runs: Sequence[measures.Followed], *, by_overlap: bool) -> dict[str, Figure]:
    """Return how soon, how often, how well and at which cost a robot was located.

    Parameters
    ----------
    by_overlap : whether only the path counts on which scans overlap the map.
    """
    paths = [run.overlap_path if by_overlap else run.path for run in runs]
    errors = np.concatenate([run.errors for run in runs])
    angles = np.concatenate([run.angles for run in runs])
    located = sum(run.num_located for run in runs)
    decisions = sum(sum(run.states.values()) for run in runs)
    processor = 1e3 * np.concatenate([run.processor for run in runs])
    lost = sum(run.states["lost"] for run in runs)
    figures = {
        "drives": Figure.exact(len(runs), better=None),
        "located within 3 m": share(np.array(paths) <= 3.0, "more"),
        "within 10 m": share(np.array(paths) <= 10.0, "more"),
        "located": Figure.exact(100.0 * located / max(decisions, 1), "%", None),
        "wrong": Figure.exact(100.0 * sum(r.num_wrong for r in runs) / max(decisions, 1), "%"),
        "lost": Figure.exact(100.0 * lost / max(decisions, 1), "%"),
        "rmse": Figure.exact(100.0 * rms(errors), "cm"),
        "heading rmse": Figure.exact(math.degrees(rms(angles)), "deg"),
        "processor time of a scan": Figure(float(np.median(processor)), "ms"),
        "99%": Figure(float(np.quantile(processor, 0.99)), "ms"),
    }
    if by_overlap:
        # A robot that soon leaves what the map shows has little to be located by. It does not
        # count where it was located either: otherwise, of these drives, successes alone would.
        for metres in (3.0, 10.0):
            shown = [run for run in runs if run.whole_overlap >= metres]
            found = np.array([run.overlap_path <= metres for run in shown])
            figures[f"drives with {metres:.0f} m on the map"] = Figure.exact(
                len(shown), better=None
            )
            figures[f"of these located within {metres:.0f} m"] = share(found, "more")
    return figures


def rms(values: np.ndarray[tuple[int], np.dtype[np.float64]]) -> float:
    """Return the root mean square, NaN without any value."""
    return math.sqrt(float(np.square(values).mean())) if len(values) else math.nan


def share(values: np.ndarray[tuple[int], np.dtype[np.bool_]], better: str) -> Figure:
    """Return the share of true values."""
    percent = 100.0 * float(values.mean()) if len(values) else math.nan
    return Figure.exact(percent, "%", "more" if better == "more" else "less")


def percent(part: int, whole: int, better: Better = "more") -> Figure:
    """Return a share as a figure."""
    return Figure.exact(100.0 * part / whole if whole else math.nan, "%", better)
