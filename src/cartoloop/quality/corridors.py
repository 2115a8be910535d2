# SPDX-License-Identifier: Apache-2.0
"""Corridors: where only what stands out from bare walls shows how far the robot moved."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.kernels.outline_shift import add_shift_costs, open_direction
from cartoloop.local_slam.outline import outline_of
from cartoloop.quality.pairs import MapContent
from cartoloop.sensor.pose import Pose, relative
from cartoloop.sensor.wall_normals import CORRIDOR_RATIO, chord_ratio, normal_ratio

EVERY_NTH_NODE, MAX_NODES, SMOOTHED_OVER = 3, 600, 11
"""Nodes examined: one in three, but not more than 600 in all; whether they are in a corridor is
decided by the median over 11 of them."""

MAX_GAP_RAD = math.radians(3.0)
"""Between neighbouring returns of a wall [rad]."""

FIT = (0.02, 0.1, 0.35, math.nan, math.nan)
"""What distances from an outline cost, see :func:`cartoloop.kernels.outline_shift.best_step`: the
noise of walls and the largest distance [m], as local SLAM has them."""

REACH_M, STEP_M = 1.0, 0.05
"""Displacements of the next scan that are tried [m]."""

HERE_M, ELSEWHERE_M = 0.1, 0.25
"""Displacements up to the first are none, those from the second are elsewhere [m]."""

MIN_RETURNS = 20
"""Scans with fewer are not compared."""


MEASURED_GAIN = 0.0
"""The step to the next scan is measured where that costs more elsewhere, by more than this."""


class Corridors(NamedTuple):
    """Where scans hardly measure the distance along the path.

    Attributes
    ----------
    nodes : int64 (k,), the nodes that were examined.
    is_corridor : bool (k,), whether walls around a node are parallel and nothing else.
    gains : float64 (k,), by how much less the scan of the next node costs elsewhere along the walls
        than where it is, as a log-likelihood. Negative ones: the step between both is measured;
        large positive ones: the scans contradict it. NaN where they were not compared.
    """

    nodes: IntArray
    is_corridor: BoolArray
    gains: FloatArray


CHORD_FACTOR = 3.0
"""What the ratio by chords is multiplied by, since they cut off what stands out from walls."""


def corridors(content: MapContent, max_range: float, *, by_chords: bool) -> Corridors:
    """Return where scans hardly measure the distance along the path.

    Parameters
    ----------
    by_chords : whether corridors are recognised by chords along walls, too: noise of the ranges may
        hide which way neighbouring returns face.
    """
    count = len(content.node_points)
    nodes = np.arange(0, count, max(EVERY_NTH_NODE, -(-count // MAX_NODES)))
    points = [content.node_points[node] for node in nodes.tolist()]
    ratios = np.array([normal_ratio(each, max_range) for each in points])
    if by_chords:
        by_chord = np.array([chord_ratio(each, max_range) for each in points])
        ratios = np.minimum(ratios, CHORD_FACTOR * by_chord)
    half = SMOOTHED_OVER // 2
    smooth = np.array(
        [np.median(ratios[max(i - half, 0) : i + half + 1]) for i in range(len(ratios))]
    )
    is_corridor = smooth < CORRIDOR_RATIO
    gains = np.full(len(nodes), np.nan)
    for row in np.flatnonzero(is_corridor).tolist():
        if nodes[row] + 1 < count:
            gains[row] = gain_elsewhere(content, int(nodes[row]))
    return Corridors(nodes, is_corridor, gains)


def gain_elsewhere(content: MapContent, node: int) -> float:
    """Return by how much less the scan of the next node costs elsewhere along the walls.

    NaN where one of both has too few returns.
    """
    first, second = (
        np.ascontiguousarray(content.node_points[row], dtype=np.float64) for row in (node, node + 1)
    )
    if min(len(first), len(second)) < MIN_RETURNS:
        return math.nan
    tf_map_first, tf_map_second = (
        Pose(*content.graph.node_poses[row].tolist()) for row in (node, node + 1)
    )
    outline = outline_of(first, Pose(0.0, 0.0, 0.0))
    _, direction = open_direction(*outline, MAX_GAP_RAD)
    count = round(REACH_M / STEP_M)
    shifts = STEP_M * np.arange(-count, count + 1, dtype=np.float64)
    costs = np.zeros(len(shifts))
    add_shift_costs(
        *outline,
        MAX_GAP_RAD,
        second,
        relative(tf_map_first, tf_map_second)[:],
        (math.cos(direction), math.sin(direction)),
        shifts,
        FIT,
        costs,
    )
    margin = 0.5 * STEP_M
    here = costs[np.abs(shifts) < HERE_M + margin].min()
    return float(here - costs[np.abs(shifts) > ELSEWHERE_M - margin].min())
