# SPDX-License-Identifier: Apache-2.0
"""How well a scan fits the outline of another one when it is shifted along a direction."""

from __future__ import annotations

import math

import numpy as np

from cartoloop._jit import borrowing_kernel, inlined_kernel, kernel
from cartoloop.arrays import FloatArray
from cartoloop.kernels.outline_lines import (
    SHORTEST_M,
    Outline,
    line_towards,
    lines_of,
    places_in_sectors,
)

_ROUNDING = 1e-9
"""Much more than sums of the same costs in different order differ by [share of the sum]."""

Fit = tuple[float, float, float, float, float]
"""What distances cost, see :func:`best_step`."""

Costs = tuple[float, float, float, float, float]
"""Of steps around the best one, see :func:`best_step`."""

STRETCH_M = 1.0
"""Length of a stretch of returns that fits a step better or worse as a whole [m]: of a door or a
person. Noise makes single returns of the same wall better and worse."""

_NUM_CLASSES = 16
"""Number of classes that points are put into order by: exact sorting takes longer."""


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
        length = math.sqrt(x * x + y * y)
        weight = min(length, 1.0) / max(length, SHORTEST_M) ** 2
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
    below: tuple[float, float],
    reach: int,
    fit: Fit,
) -> tuple[float, int, float, float, Costs]:
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
        `below`.
    below : with a stride, only steps count that cost less than the matched one and, unless that is
        less, than the larger of a share of its cost and a cost for each point.
    reach : distance of the outer two of the returned costs from the best step, as a number of
        steps.
    fit : standard deviation of a distance [m]; larger distances than the second [m] cost as much as
        that one; shares of this cost for points in whose direction there is no line: where the
        outline should show one, beyond what it could show, and beside all of it. The last two may
        be NaN: then points cost as much as they do as matched.

    Returns
    -------
    the cost of the matched step, and the index of the best, of equal ones the first; -1 if, with a
    stride, none was tried that costs less than `below`. The standard deviation of the difference of
    their costs, if noise alone made it. By how much more stretches of returns cost at the best one,
    in all. And the costs of the steps by -reach, -1, 0, 1 and reach from the best one; NaN where
    there is none.

    Notes
    -----
    Costs only grow from point to point: a step is given up once it costs more than another. That is
    soonest with the points first that fit badly, or that are shifted across their lines. Sums in
    that order differ by rounding, so that they only reject what clearly costs more.
    """
    outline = Outline(lines_of(bearings, ends, max_gap), places_in_sectors(ends))
    places, matched_costs = _placed(outline, points, tf_sensor_points, fit)
    decisive = _most_decisive_first(outline, places, matched_costs, along, fit)
    matched = 0.0
    for k in range(matched_costs.shape[0]):
        matched += matched_costs[k]
    best = -1
    least = min(matched, max(below[0] * matched, below[1] * points.shape[0]))
    if stride == 1 and steps.shape[0] > 0:
        # Others probably cost more.
        best = _nearest(steps, moved)
        least = _cost_at(outline, places, steps[best] - moved, along, fit, math.inf)
    nothing = (math.nan, math.nan, math.nan, math.nan, math.nan)
    for is_between in range(1 if stride == 1 else 2):
        for step in range(0, steps.shape[0], stride if is_between == 0 else 1):
            if is_between == 1 and step % stride == 0:
                continue
            shift = steps[step] - moved
            if not _costs_more(outline, decisive, shift, along, fit, least):
                cost = _cost_at(outline, places, shift, along, fit, least)
                if cost < least or (cost == least and step < best):
                    best, least = step, cost
        if best < 0:
            return matched, best, 0.0, 0.0, nothing
    shift = steps[best] - moved
    noise, loss = _noise_and_loss(outline, places, matched_costs, shift, along, fit)
    costs = _costs_around(outline, places, steps, moved, best, reach, along, fit)
    return matched, best, noise, loss, costs


@kernel
def add_shift_costs(
    bearings: FloatArray,
    ends: FloatArray,
    max_gap: float,
    points: FloatArray,
    tf_sensor_points: tuple[float, float, float],
    along: tuple[float, float],
    shifts: FloatArray,
    fit: Fit,
    costs: FloatArray,
) -> None:
    """Add what each shift of a scan costs to `costs`, as :func:`best_step` defines it.

    Parameters
    ----------
    shifts : float64, shape (k,), along `along` from the pose as matched [m].
    costs : float64, shape (k,).
    bearings, ends, max_gap, points, tf_sensor_points, along, fit : see :func:`best_step`.
    """
    outline = Outline(lines_of(bearings, ends, max_gap), places_in_sectors(ends))
    places, _ = _placed(outline, points, tf_sensor_points, fit)
    for k in range(shifts.shape[0]):
        costs[k] += _cost_at(outline, places, shifts[k], along, fit, math.inf)


@kernel
def _nearest(steps: FloatArray, moved: float) -> int:
    """Return the index of the step nearest to another."""
    nearest = 0
    for step in range(1, steps.shape[0]):
        if abs(steps[step] - moved) < abs(steps[nearest] - moved):
            nearest = step
    return nearest


@kernel
def _placed(
    outline: Outline,
    points: FloatArray,
    tf_sensor_points: tuple[float, float, float],
    fit: Fit,
) -> tuple[FloatArray, FloatArray]:
    """Return points in the scanner frame and what they cost unseen, shape (m, 4); and as matched.

    The third number is for points beyond what the outline could show, the last one for points
    beside all of it. Unless `fit` has shares for them, that is what a point costs as matched, or
    what points that fit cost in the mean. So leaving the view says nothing of the step: if it cost
    more, the steps of a scanner of short reach would be too short, and if less too long.
    """
    places, costs = np.empty((points.shape[0], 4)), np.empty(points.shape[0])
    sensor_x, sensor_y, theta = tf_sensor_points
    cos, sin = math.cos(theta), math.sin(theta)
    limit, total, count = 0.5 * (fit[1] / fit[0]) ** 2, 0.0, 0
    for k in range(points.shape[0]):
        x = sensor_x + cos * points[k, 0] - sin * points[k, 1]
        y = sensor_y + sin * points[k, 0] + cos * points[k, 1]
        place = places[k]
        place[0], place[1], place[2], place[3] = x, y, math.nan, math.nan
        costs[k] = _distance_cost(outline, line_towards(outline, x, y), x, y, place, fit)
        if costs[k] < limit:
            total += costs[k]
            count += 1
    mean = total / max(count, 1)
    for k in range(points.shape[0]):
        place = places[k]
        place[2] = place[3] = costs[k] if costs[k] < limit else mean
        for which in range(2):
            if not math.isnan(fit[3 + which]):
                place[2 + which] = fit[3 + which] * limit
        if math.isnan(costs[k]):
            x, y = place[0], place[1]
            costs[k] = _distance_cost(outline, line_towards(outline, x, y), x, y, place, fit)
    return places, costs


@kernel
def _most_decisive_first(
    outline: Outline,
    places: FloatArray,
    costs: FloatArray,
    along: tuple[float, float],
    fit: Fit,
) -> FloatArray:
    """Return points in another order: first those that cost much, or move across their lines."""
    limit = 0.5 * (fit[1] / fit[0]) ** 2
    classes = np.empty(places.shape[0], dtype=np.int64)
    begins = np.zeros(_NUM_CLASSES + 1, dtype=np.int64)
    for k in range(places.shape[0]):
        line = line_towards(outline, places[k, 0], places[k, 1])
        share = costs[k] / limit
        across = along[0] * outline.lines[line, 3] - along[1] * outline.lines[line, 2]
        if not math.isnan(across):
            share += 0.5 * abs(across)
        classes[k] = _NUM_CLASSES - 1 - min(int(share * _NUM_CLASSES / 1.5), _NUM_CLASSES - 1)
        begins[classes[k] + 1] += 1
    for number in range(1, _NUM_CLASSES):
        begins[number] += begins[number - 1]
    decisive = np.empty_like(places)
    for k in range(places.shape[0]):
        place = begins[classes[k]]
        begins[classes[k]] += 1
        decisive[place] = places[k]
    return decisive


@kernel
def _costs_around(
    outline: Outline,
    places: FloatArray,
    steps: FloatArray,
    moved: float,
    best: int,
    reach: int,
    along: tuple[float, float],
    fit: Fit,
) -> Costs:
    """Return the costs of a step and of its neighbours, see :func:`best_step`."""
    costs = np.full(5, math.nan)
    for k in range(5):
        step = best + (-reach, -1, 0, 1, reach)[k]
        if 0 <= step < steps.shape[0]:
            costs[k] = _cost_at(outline, places, steps[step] - moved, along, fit, math.inf)
    return costs[0], costs[1], costs[2], costs[3], costs[4]


@kernel
def _noise_and_loss(
    outline: Outline,
    places: FloatArray,
    costs: FloatArray,
    shift: float,
    along: tuple[float, float],
    fit: Fit,
) -> tuple[float, float]:
    """Return what noise makes of the difference of a shift's cost, and what speaks against it.

    The first is the standard deviation of the sum of the points' differences, if they are
    independent. A point that fits in one place and not in the other is a feature: as noise it
    counts as a quarter of that difference. The second is by how much stretches of returns cost
    more, in all.

    Parameters
    ----------
    costs : of the points as matched.
    """
    largest, squares = 0.25 * 0.5 * (fit[1] / fit[0]) ** 2, 0.0
    loss, gain, length = 0.0, 0.0, 0.0
    for k in range(places.shape[0]):
        if k > 0:
            step_x, step_y = places[k, 0] - places[k - 1, 0], places[k, 1] - places[k - 1, 1]
            length += math.sqrt(step_x * step_x + step_y * step_y)
        if length > STRETCH_M:
            loss += max(-gain, 0.0)
            gain, length = 0.0, 0.0
        x, y = places[k, 0] + shift * along[0], places[k, 1] + shift * along[1]
        less = costs[k] - _distance_cost(outline, line_towards(outline, x, y), x, y, places[k], fit)
        squares += min(abs(less), largest) ** 2
        gain += less
    return math.sqrt(squares), loss + max(-gain, 0.0)


@inlined_kernel
def _costs_more(
    outline: Outline,
    decisive: FloatArray,
    shift: float,
    along: tuple[float, float],
    fit: Fit,
    bound: float,
) -> bool:
    """Return whether a shift of points clearly costs more than a bound, in whatever order."""
    above = bound * (1.0 + _ROUNDING)
    return _cost_at(outline, decisive, shift, along, fit, above) > above


@borrowing_kernel
def _cost_at(
    outline: Outline,
    places: FloatArray,
    shift: float,
    along: tuple[float, float],
    fit: Fit,
    bound: float,
) -> float:
    """Return the cost of a shift of points, or a part of it that is above a bound."""
    shift_x, shift_y = shift * along[0], shift * along[1]
    cost = 0.0
    for k in range(places.shape[0]):
        x, y = places[k, 0] + shift_x, places[k, 1] + shift_y
        cost += _distance_cost(outline, line_towards(outline, x, y), x, y, places[k], fit)
        if cost > bound:
            break
    return cost


@inlined_kernel
def _distance_cost(
    outline: Outline,
    line: np.uint64,
    x: float,
    y: float,
    place: FloatArray,
    fit: Fit,
) -> float:
    """Return the cost of the distance of a point from a line, given its row.

    `place` has what the point costs unseen, see :func:`_placed`.
    """
    sigma, max_distance, outside_share, _, _ = fit
    lines = outline.lines
    limit = 0.5 * (max_distance / sigma) ** 2
    across = (x - lines[line, 0]) * lines[line, 3]
    distance = across - (y - lines[line, 1]) * lines[line, 2]
    if math.isnan(distance):
        return _cost_unseen(outline, line, x, y, place, outside_share * limit)
    cost: float = min(0.5 * (distance / sigma) ** 2, limit)
    return cost


@inlined_kernel
def _cost_unseen(
    outline: Outline, line: np.uint64, x: float, y: float, place: FloatArray, outside_cost: float
) -> float:
    """Return the cost of a point in whose direction there is no line.

    One nearer than both ends of the gap should have been seen; one beyond an end could not be.
    """
    lines = outline.lines
    after = line + np.uint64(1)
    if line == np.uint64(0) or after >= np.uint64(lines.shape[0]):
        return float(place[3])
    reach = min(
        lines[line, 0] ** 2 + lines[line, 1] ** 2, lines[after, 0] ** 2 + lines[after, 1] ** 2
    )
    return float(place[2]) if x**2 + y**2 > reach else outside_cost
