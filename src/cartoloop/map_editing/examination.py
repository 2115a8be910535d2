# SPDX-License-Identifier: Apache-2.0
"""The verdict on an edited map."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.map_editing.apply import AnyMap, Applied
from cartoloop.quality.examine import examine
from cartoloop.quality.verdict import VERDICTS, Kind, Place, Quality, Severity


def examined(applied: Applied[AnyMap]) -> Applied[AnyMap]:
    """Return an edited map with a new verdict; that on a map as mapped stands."""
    edited = applied.map
    if edited.original is None:
        return applied
    report = edited.report
    quality = examine(edited, edited.config.quality, report.extra.get("odometry"))
    forgotten = np.delete(edited.original.stamps, applied.kept.scans)
    report = replace(report, quality=_without_gaps(quality, forgotten))
    return replace(applied, map=replace(edited, report=report))


def _without_gaps(quality: Quality, forgotten: FloatArray) -> Quality:
    """Return a verdict that does not count gaps of forgotten scans: these measured the motion.

    Parameters
    ----------
    forgotten : stamps of the scans that are left out.
    """
    places = tuple(place for place in quality.places if not _is_gap_of(place, forgotten))
    num_gaps = len(quality.places) - len(places)
    if num_gaps == 0:
        return quality
    figures = dict(quality.figures)
    if "gaps" in figures:
        figures["gaps"] = max(figures["gaps"] - num_gaps, 0.0)
    worst = places[0].severity if places else Severity.MINOR
    return Quality(VERDICTS[worst], places, figures)


def _is_gap_of(place: Place, forgotten: FloatArray) -> bool:
    is_inside = (forgotten >= place.from_stamp) & (forgotten <= place.to_stamp)
    return place.kind in {Kind.GAP, Kind.JUMP} and bool(is_inside.any())
