# SPDX-License-Identifier: Apache-2.0
"""Slow, obvious references of cartoloop.kernels.sweep_projection and cloud_projection."""

from __future__ import annotations

import math

import numpy as np


def naive_place_upright(point, time, start, step, knots):
    """Return a point of the moving, tilted tracking frame in the level frame at time 0."""
    moments = start + step * np.arange(len(knots))
    x, y, theta, roll, pitch = (np.interp(time, moments, column) for column in np.transpose(knots))
    turn = about(2, theta) @ about(1, pitch) @ about(0, roll)
    return turn @ np.asarray(point) + np.array((x, y, 0.0))


def about(axis, angle):
    """Return the rotation about an axis."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[first, first] = matrix[second, second] = math.cos(angle)
    matrix[first, second], matrix[second, first] = -math.sin(angle), math.sin(angle)
    return matrix


def naive_sweep(ranges, directions, origin, increment, motion, limits, heights, is_free):
    """Return returns and misses, lists of points."""
    shortest, longest, no_return, _, free, _ = limits
    low, high = heights
    returns, misses = [], []
    for k, measured in enumerate(ranges):
        if math.isnan(measured) or measured < shortest or measured <= 0.0:
            continue
        is_hit = measured <= longest and measured < no_return
        says_free = measured < no_return or is_free or measured == math.inf
        if not is_hit and not (says_free and free > 0.0):
            continue
        length = measured if is_hit else min(measured, free)
        end = np.asarray(origin) + length * directions[k]
        x, y, z = naive_place_upright(end, k * increment, *motion)
        if low <= z <= high:
            (returns if is_hit else misses).append((x, y))
    return returns, misses


def naive_cloud(points, times, rotation, translation, motion, limits, centre, num_directions):
    """Return the nearest point of each direction, in the order of the directions."""
    shortest, longest, low, high = limits
    best = {}
    for k, point in enumerate(points):
        reach = np.linalg.norm(point)
        if not np.isfinite(point).all() or not shortest <= reach < longest or reach == 0.0:
            continue
        time = times[k] if len(times) else 0.0
        x, y, z = naive_place_upright(rotation @ point + translation, time, *motion)
        if not low <= z <= high:
            continue
        bearing = math.atan2(y - centre[1], x - centre[0])
        share = (bearing + math.pi) / math.tau
        direction = min(int(share * num_directions), num_directions - 1)
        distance = (x - centre[0]) ** 2 + (y - centre[1]) ** 2
        if direction not in best or distance < best[direction][0]:
            best[direction] = (distance, x, y)
    return [best[direction][1:] for direction in sorted(best)]
