# SPDX-License-Identifier: Apache-2.0
"""What a map's own scans show: how scans usually fit, and which walls are seen through.

Glass and railings are walls to some beams, and others pass. Were that not known, beams would
contradict the map where it is right.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from cartoloop.arrays import IntArray
from cartoloop.localisation.fit import Fit, FitJudge
from cartoloop.map_data import MapData
from cartoloop.map_output.main_part import main_nodes
from cartoloop.sensor.scan_points import ScanPoints

NUM_LEARNT_SCANS = 3000
"""Number of the map's own scans, at most, from which it is learnt which walls are seen through."""

NUM_JUDGED_SCANS = 300
"""Number of them whose median fit is the usual one."""

STRETCH = 10
"""Number of scans in turn that are left out together when one of them is compared with the map:
what other scans see through, a scan may pass."""

LOW_QUANTILE = 0.1
"""Share of the map's own scans that agree less with it than its low agreement, or are less
distinct than its low distinctness."""


class OwnFits:
    """How a map's own scans fit to it.

    Attributes
    ----------
    usual : the medians.
    low_score, low_agreement, low_distinctness : those that nine of ten reach.
    """

    def __init__(self, fits: list[Fit]) -> None:
        values = np.array([fit[:3] for fit in fits])
        score, agreement, distinctness = np.median(values, axis=0).tolist()
        low = np.quantile(values, LOW_QUANTILE, axis=0)
        self.usual = Fit(score, agreement, distinctness, len(fits))
        self.low_score, self.low_agreement, self.low_distinctness = low.tolist()


def learn_from_own_scans(judge: FitJudge, data: MapData) -> OwnFits | None:
    """Let a judge know which walls are seen through; return how scans fit, None if none counts.

    Scans are compared with the map as if each second stretch of them did not show what is seen
    through, as scans of another day do not.

    Parameters
    ----------
    judge : of the map, whose grid lies in the map frame.
    """
    nodes = main_nodes(data)
    nodes = nodes[nodes < len(data.node_points)]
    learnt = nodes[:: len(nodes) // NUM_LEARNT_SCANS + 1]
    is_second = (np.arange(len(learnt)) // STRETCH) % 2 == 1
    halves = (learnt[~is_second], learnt[is_second])
    passes = [_passes(judge, data, half) for half in halves]
    step = len(learnt) // NUM_JUDGED_SCANS + 1
    fits: list[Fit] = []
    for half, others in zip(halves, reversed(passes), strict=True):
        judge.set_passes(others)
        fits += _fits(judge, data, half[::step].tolist())
    judge.set_passes(passes[0] + passes[1])
    fits = [fit for fit in fits if not math.isnan(fit.distinctness)]
    return OwnFits(fits) if fits else None


def _passes(judge: FitJudge, data: MapData, nodes: IntArray) -> IntArray:
    scans = ScanPoints.of([data.node_points[node] for node in nodes.tolist()])
    return judge.passes(scans, np.zeros((len(nodes), 2)), data.graph.node_poses[nodes])


def _fits(judge: FitJudge, data: MapData, nodes: Iterable[int]) -> list[Fit]:
    origin = np.zeros((1, 2))
    return [
        judge.fit(
            ScanPoints.of([data.node_points[node]]), origin, data.graph.node_poses[node][None]
        )
        for node in nodes
    ]
