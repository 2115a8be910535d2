# SPDX-License-Identifier: Apache-2.0
"""Corridors: where only what stands out from bare walls shows how far the robot moved."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.kernels.outline_shift import add_shift_costs, open_direction
from cartoloop.local_slam.outline import Outline, outline_of
from cartoloop.quality.odometry_use import has_odometry, num_slips, untrusted_odometry
from cartoloop.quality.pairs import MapContent
from cartoloop.quality.places import stamps_of
from cartoloop.sensor.free_standing import are_free_standing
from cartoloop.sensor.median import median
from cartoloop.sensor.pose import Pose, compose, inverse, relative, relative_all
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

SHIFTS_M: FloatArray = STEP_M * np.arange(-round(REACH_M / STEP_M), round(REACH_M / STEP_M) + 1.0)
"""The same, ascending [m]."""

BEND_NODES, MIN_BEND_M, MIN_AHEAD = 15, 1.0, 0.9
"""The path bends as it does over this number of nodes to either side, if they are so far apart [m],
and if the robot hardly drove back between them: by this share of the path it came ahead."""

MIN_RADIUS_M, MAX_RADIUS_M = 3.0, 100.0
"""Along bends of such radii the next scan is displaced along the arc, too [m]: tighter ones are
turns around corners, wider ones as good as straight."""

LEAST_COST = 15.0
"""Along an arc, smaller differences of costs are none: a return that is on no wall costs 12.5."""

BEND_STRIDE, CLEAR_GAIN = 2, -100.0
"""Along an arc, every such displacement is tried; where the first comparison shows such a gain, the
step is measured without the second one."""

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
    is_by_chords : bool (k,), whether they are by chords along walls: what stands out from walls, or
        noise, may hide it otherwise.
    gains : float64 (k,), by how much less the scan of the next node costs elsewhere along the walls
        than where it is, as a log-likelihood. Negative ones: the step between both is measured;
        large positive ones: the scans contradict it. NaN where they were not compared.
    """

    nodes: IntArray
    is_corridor: BoolArray
    is_by_chords: BoolArray
    gains: FloatArray


CHORD_FACTOR = 3.0
"""What the ratio by chords is multiplied by, since they cut off what stands out from walls."""


def corridors(
    content: MapContent, max_range: float, odometry: Mapping[str, Any] | None
) -> Corridors:
    """Return where scans hardly measure the distance along the path.

    Parameters
    ----------
    odometry : its calibration, as in the report. Only nodes without it are compared with the next
        one, or all of them if wheels slipped. None without odometry. Then, and if wheels slipped,
        corridors are recognised by chords along walls, too, since noise of the ranges may hide
        which way neighbouring returns face.
    """
    count = len(content.node_points)
    nodes = np.arange(0, count, max(EVERY_NTH_NODE, -(-count // MAX_NODES)))
    alone = untrusted_odometry(stamps_of(content, nodes), odometry)
    points = [content.node_points[node] for node in nodes.tolist()]
    for row in np.flatnonzero(alone).tolist():
        points[row] = _of_walls(points[row])
    ratios = np.array([normal_ratio(each, max_range) for each in points])
    by_chord = CHORD_FACTOR * np.array([chord_ratio(each, max_range) for each in points])
    is_by_chords = _smooth(by_chord) < CORRIDOR_RATIO
    if not has_odometry(odometry) or num_slips(odometry):
        ratios = np.minimum(ratios, by_chord)
    is_corridor = _smooth(ratios) < CORRIDOR_RATIO
    gains = np.full(len(nodes), np.nan)
    for row in np.flatnonzero(is_corridor & alone & (nodes + 1 < count)).tolist():
        gains[row] = gain_elsewhere(content, int(nodes[row]))
    return Corridors(nodes, is_corridor, is_corridor | is_by_chords, gains)


def _smooth(ratios: FloatArray) -> FloatArray:
    """Return the medians over :data:`SMOOTHED_OVER` nodes examined."""
    half = SMOOTHED_OVER // 2
    parts = [ratios[max(i - half, 0) : i + half + 1] for i in range(len(ratios))]
    return np.array([median(part) for part in parts])


def _of_walls(points: FloatArray) -> FloatArray:
    """Return the returns that are not on narrow objects that stand free.

    People hide which way the walls face. So do pillars, but these measure steps, which the
    comparison of scans shows: no returns are left out of it, and none where odometry measures.
    """
    returns = np.ascontiguousarray(points, dtype=np.float64)
    return returns[~are_free_standing(returns, also_hidden=True)]


def gain_elsewhere(content: MapContent, node: int) -> float:
    """Return by how much less the scan of the next node costs elsewhere along the walls.

    That is along a straight line, or where the path bends along its arc if that is more: a round
    corridor fits nowhere along a line. NaN where one of both scans has too few returns.
    """
    first, second = (
        np.ascontiguousarray(content.node_points[row], dtype=np.float64) for row in (node, node + 1)
    )
    if min(len(first), len(second)) < MIN_RETURNS:
        return math.nan
    poses = content.graph.node_poses
    tf_first_second = relative(*(Pose(*poses[row].tolist()) for row in (node, node + 1)))
    outline = outline_of(first, Pose(0.0, 0.0, 0.0))
    _, direction = open_direction(*outline, MAX_GAP_RAD)
    along = (math.cos(direction), math.sin(direction))
    gain = _gain(_costs(outline, second, tf_first_second, along, SHIFTS_M), SHIFTS_M)
    bend = path_bend(poses, node) if gain < MEASURED_GAIN else None
    if bend is None:
        return gain
    return max(gain, _gain_along(bend, outline, first, second, tf_first_second))


def _gain_along(
    bend: Pose, outline: Outline, first: FloatArray, second: FloatArray, tf_first_second: Pose
) -> float:
    """Return the gain elsewhere along an arc, by the comparisons of each scan to the other one.

    What stands at the walls may be out of sight for one of them on one side. 0 where both differ
    by less than :data:`LEAST_COST`.
    """
    outline_second = outline_of(second, Pose(0.0, 0.0, 0.0))
    here, along = np.zeros(1), (1.0, 0.0)
    shifts = SHIFTS_M[::BEND_STRIDE]
    moved = [compose(tf_first_second, _along_bend(bend, shift)) for shift in shifts.tolist()]
    costs = np.array([_costs(outline, second, pose, along, here)[0] for pose in moved])
    if _gain(costs, shifts) < CLEAR_GAIN:
        return CLEAR_GAIN
    costs += [_costs(outline_second, first, inverse(pose), along, here)[0] for pose in moved]
    gain = _gain(costs, shifts)
    return gain if abs(gain) > LEAST_COST else 0.0


def path_bend(poses: FloatArray, node: int) -> Pose | None:
    """Return the bend of the path around a node; None where it is not an arc.

    Parameters
    ----------
    poses : of all nodes, shape (n, 3), map frame.

    Returns
    -------
    how x and y [m] and theta [rad] grow at first per metre of the path, in the node's frame.
    """
    near = poses[max(node - BEND_NODES, 0) : node + 1 + BEND_NODES]
    steps = relative_all(near[:-1], near[1:])
    x, y, turn = steps.sum(axis=0).tolist()
    length, path = math.hypot(x, y), float(np.hypot(steps[:, 0], steps[:, 1]).sum())
    if length < max(MIN_BEND_M, MIN_AHEAD * path):
        return None
    radius = length / max(abs(turn), 1e-9)
    if not MIN_RADIUS_M <= radius <= MAX_RADIUS_M:
        return None
    return Pose(x / length, y / length, turn / length)


def _along_bend(bend: Pose, distance: float) -> Pose:
    """Return where a robot is after a distance along a bend, in the frame in which it began."""
    turn = bend.theta * distance
    ahead, aside = math.sin(turn) / bend.theta, (1.0 - math.cos(turn)) / bend.theta
    return Pose(bend.x * ahead - bend.y * aside, bend.y * ahead + bend.x * aside, turn)


def _costs(
    outline: Outline,
    points: FloatArray,
    tf_outline_points: Pose,
    along: tuple[float, float],
    shifts: FloatArray,
) -> FloatArray:
    """Return what shifts of a scan against an outline cost."""
    costs = np.zeros(len(shifts))
    add_shift_costs(*outline, MAX_GAP_RAD, points, tf_outline_points[:], along, shifts, FIT, costs)
    return costs


def _gain(costs: FloatArray, shifts: FloatArray) -> float:
    """Return by how much less the best of the displacements elsewhere costs than the best here."""
    apart, margin = np.abs(shifts), 0.5 * STEP_M
    here = costs[apart < HERE_M + margin].min()
    return float(here - costs[apart > ELSEWHERE_M - margin].min())
