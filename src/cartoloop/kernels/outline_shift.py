# SPDX-License-Identifier: Apache-2.0
"""How well a scan fits the outline of another one when it is shifted along a direction."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cartoloop._jit import borrowing_kernel, inlined_kernel, kernel
from cartoloop.arrays import FloatArray, IntArray

_SHORTEST_M = 1e-300
"""Two ends at the same place make a line of this length [m], so that nothing is divided by zero."""


@borrowing_kernel
def trace_outline(
    points: FloatArray,
    tf_sensor_points: tuple[float, float, float],
    out_bearings: FloatArray,
    out_ends: FloatArray,
) -> bool:
    """Write points in the frame of a scanner, and where they are seen from there.

    Parameters
    ----------
    points : float64, shape (n, 2) [m].
    tf_sensor_points : x, y [m] and theta [rad].
    out_bearings : float64, shape (n,), directions from the scanner [rad].
    out_ends : float64, shape (n, 2), scanner frame [m].

    Returns
    -------
    whether the bearings ascend, as they do where beams are in order.
    """
    origin_x, origin_y, theta = tf_sensor_points
    cos, sin = math.cos(theta), math.sin(theta)
    ascends = True
    for k in range(points.shape[0]):
        x = origin_x + cos * points[k, 0] - sin * points[k, 1]
        y = origin_y + sin * points[k, 0] + cos * points[k, 1]
        out_ends[k, 0], out_ends[k, 1] = x, y
        out_bearings[k] = math.atan2(y, x)
        if k > 0 and not out_bearings[k] >= out_bearings[k - 1]:
            ascends = False
    return ascends


@borrowing_kernel
def open_direction(bearings: FloatArray, ends: FloatArray, max_gap: float) -> tuple[float, float]:
    """Return how far lines determine a scan along the open direction, and that direction [rad].

    That is the ratio of the eigenvalues of the sum of their normals' squares: 0 between bare walls.
    A line counts by its length, up to a metre: short ones are noise.

    Parameters
    ----------
    bearings, ends, max_gap : the outline, see :func:`best_step`.
    """
    xx, yy, xy = 0.0, 0.0, 0.0
    for line in range(bearings.shape[0] - 1):
        if not bearings[line + 1] - bearings[line] < max_gap:
            continue
        x, y = ends[line + 1, 0] - ends[line, 0], ends[line + 1, 1] - ends[line, 1]
        length = math.hypot(x, y)
        weight = min(length, 1.0) / max(length, _SHORTEST_M) ** 2
        xx += weight * y**2
        yy += weight * x**2
        xy -= weight * x * y
    mean, half = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
    ratio = (mean - half) / (mean + half) if mean > 0.0 else 1.0
    return ratio, 0.5 * math.atan2(2.0 * xy, xx - yy) + 0.5 * math.pi


@kernel
def best_step(
    bearings: FloatArray,
    ends: FloatArray,
    max_gap: float,
    points: FloatArray,
    tf_sensor_points: tuple[float, float, float],
    along: tuple[float, float],
    moved: float,
    steps: FloatArray,
    stride: int,
    reach: int,
    fit: tuple[float, float, float],
    out_costs: FloatArray,
) -> tuple[float, int]:
    """Find the step that costs least: half the sum of squared distances from the lines, in sigmas.

    Parameters
    ----------
    bearings : float64, shape (n,), directions of the outline's points from the scanner, ascending
        [rad].
    ends : float64, shape (n, 2), the outline's points [m], scanner frame; n > 1.
    max_gap : neighbouring points are the ends of a line if their bearings differ by less [rad].
    points : float64, shape (m, 2), the other scan [m].
    tf_sensor_points : x, y [m] and theta [rad], as matched, of the other scan in the scanner frame.
    along : unit vector of the steps, scanner frame.
    moved : the step as matched [m].
    steps : float64, shape (k,), ascending [m].
    stride : above 1, every such step is tried first, and none else if none of them costs less than
        the matched one.
    reach : distance of the outer two of `out_costs` from the best step, as a number of steps.
    fit : standard deviation of a distance [m]; larger distances than the second [m] cost as much as
        that one; share of this cost for points in whose direction there is no line.
    out_costs : float64, shape (5,): of the steps by -reach, -1, 0, 1 and reach from the best one;
        NaN where there is none.

    Returns
    -------
    the cost of the matched step, and the index of the best, of equal ones the first; -1 if, with a
    stride, none was tried that costs less than the matched one.

    Notes
    -----
    As a point is shifted, its direction changes little, so that its line is found from the last.
    Costs only grow from point to point: a step is given up once it costs more than another.
    """
    places, lines = _placed(points, tf_sensor_points)
    directions = _line_directions(bearings, ends, max_gap)
    scan = _Scan(ends, directions, bearings, places, lines)
    matched = _cost_at(scan, 0.0, along, fit, math.inf)
    best, least = -1, matched if stride > 1 else math.inf
    for step in range(0, steps.shape[0], stride):
        cost = _cost_at(scan, steps[step] - moved, along, fit, least)
        if cost < least:
            best, least = step, cost
    if best < 0:
        return matched, best
    for step in range(steps.shape[0]):
        if step % stride == 0:
            continue
        cost = _cost_at(scan, steps[step] - moved, along, fit, least)
        if cost < least or (cost == least and step < best):
            best, least = step, cost
    for k in range(5):
        step = best + (-reach, -1, 0, 1, reach)[k]
        out_costs[k] = math.nan
        if 0 <= step < steps.shape[0]:
            out_costs[k] = _cost_at(scan, steps[step] - moved, along, fit, math.inf)
    return matched, best


@kernel
def add_shift_costs(
    bearings: FloatArray,
    ends: FloatArray,
    max_gap: float,
    points: FloatArray,
    tf_sensor_points: tuple[float, float, float],
    along: tuple[float, float],
    shifts: FloatArray,
    fit: tuple[float, float, float],
    costs: FloatArray,
) -> None:
    """Add what each shift of a scan costs to `costs`, as :func:`best_step` defines it.

    Parameters
    ----------
    shifts : float64, shape (k,), along `along` from the pose as matched [m].
    costs : float64, shape (k,).
    bearings, ends, max_gap, points, tf_sensor_points, along, fit : see :func:`best_step`.
    """
    places, lines = _placed(points, tf_sensor_points)
    directions = _line_directions(bearings, ends, max_gap)
    scan = _Scan(ends, directions, bearings, places, lines)
    for k in range(shifts.shape[0]):
        costs[k] += _cost_at(scan, shifts[k], along, fit, math.inf)


class _Scan(NamedTuple):
    """An outline, and another scan at the matched pose.

    Attributes
    ----------
    ends, directions : float64, (n, 2), (n - 1, 2), the outline's points and lines.
    bearings : float64, (n,).
    places : float64, (m, 2), the points of the scan.
    lines : int64, (m,), in whose direction each was seen last.
    """

    ends: FloatArray
    directions: FloatArray
    bearings: FloatArray
    places: FloatArray
    lines: IntArray


@kernel
def _placed(
    points: FloatArray, tf_sensor_points: tuple[float, float, float]
) -> tuple[FloatArray, IntArray]:
    """Return points in the scanner frame, and that the line of none of them is known."""
    places = np.empty((points.shape[0], 2))
    lines = np.empty(points.shape[0], dtype=np.int64)
    sensor_x, sensor_y, theta = tf_sensor_points
    cos, sin = math.cos(theta), math.sin(theta)
    for k in range(points.shape[0]):
        places[k, 0] = sensor_x + cos * points[k, 0] - sin * points[k, 1]
        places[k, 1] = sensor_y + sin * points[k, 0] + cos * points[k, 1]
        lines[k] = -1
    return places, lines


@borrowing_kernel
def _cost_at(
    scan: _Scan,
    shift: float,
    along: tuple[float, float],
    fit: tuple[float, float, float],
    bound: float,
) -> float:
    """Return the cost of a shift of a scan, or a part of it that is above a bound."""
    sigma, max_distance, outside_share = fit
    limit = 0.5 * (max_distance / sigma) ** 2
    shift_x, shift_y = shift * along[0], shift * along[1]
    num_lines = scan.directions.shape[0]
    cost = 0.0
    for k in range(scan.places.shape[0]):
        x, y = scan.places[k, 0] + shift_x, scan.places[k, 1] + shift_y
        line = _line_towards(scan.bearings, scan.ends, x, y, scan.lines[k])
        scan.lines[k] = line
        if line < 0 or line >= num_lines or math.isnan(scan.directions[line, 0]):
            cost += outside_share * limit
        else:
            across = (x - scan.ends[line, 0]) * scan.directions[line, 1]
            distance = across - (y - scan.ends[line, 1]) * scan.directions[line, 0]
            cost += min(0.5 * (distance / sigma) ** 2, limit)
        if cost > bound:
            break
    return cost


@kernel
def _line_directions(bearings: FloatArray, ends: FloatArray, max_gap: float) -> FloatArray:
    """Return the unit vectors of an outline's lines, shape (n - 1, 2); NaN where there is none."""
    directions = np.empty((bearings.shape[0] - 1, 2))
    for line in range(directions.shape[0]):
        directions[line, 0] = directions[line, 1] = math.nan
        if bearings[line + 1] - bearings[line] < max_gap:
            x, y = ends[line + 1, 0] - ends[line, 0], ends[line + 1, 1] - ends[line, 1]
            length = max(math.hypot(x, y), _SHORTEST_M)
            directions[line, 0], directions[line, 1] = x / length, y / length
    return directions


@inlined_kernel
def _line_towards(bearings: FloatArray, ends: FloatArray, x: float, y: float, line: int) -> int:
    """Return the last outline point whose bearing is not above that of (x, y), -1 without any.

    `line` is a guess; one next to the answer saves time.
    """
    last = bearings.shape[0] - 1
    # Cross products compare directions that are less than half a turn apart.
    if 0 <= line < last and ends[line, 0] * x + ends[line, 1] * y > 0.0:
        while line >= 0 and ends[line, 0] * y - ends[line, 1] * x < 0.0:
            line -= 1
        if line >= 0:
            while line < last and ends[line + 1, 0] * y - ends[line + 1, 1] * x >= 0.0:
                line += 1
        if 0 <= line < last:
            return line
    # By hand: np.searchsorted makes a kernel slow to load from the cache.
    bearing = math.atan2(y, x)
    first, end = 0, bearings.shape[0]
    while first < end:
        middle = (first + end) // 2
        if bearings[middle] <= bearing:
            first = middle + 1
        else:
            end = middle
    return first - 1
