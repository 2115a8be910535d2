# SPDX-License-Identifier: Apache-2.0
"""The slow, obvious twin of kernels/map_changes.py: sets of cells, one scan at a time."""

from __future__ import annotations

import math
from collections import defaultdict


class Looks:
    """What all looks came to: numbers by cell (row, col)."""

    def __init__(self):
        self.shown, self.denied, self.ends, self.balance = (defaultdict(int) for _ in range(4))
        self.first, self.last = {}, {}

    def add(self, cells, limits, start, ends, time):
        """Note one scan; start and ends are (column, row)."""
        beams = [(end, self._length(start, end)) for end in ends]
        used = [(end, length) for end, length in beams if _fits(limits, length)]
        near_walls, appeared = self._at_ends(cells, limits, used)
        passed = {
            cell
            for end, length in used
            if length > 0.0
            for cell in _passed(cells, limits, start, end, length)
        } - (near_walls | appeared)
        walls = {cell for cell in passed if cells[cell] >= limits.wall}
        for cell in near_walls | (passed - walls):
            self.denied[cell] += 1
            self.balance[cell] = max(self.balance[cell] - 1, -limits.max_balance)
        for cell in appeared | walls:
            self.shown[cell] += 1
            self.balance[cell] = min(self.balance[cell] + 1, limits.max_balance)
            self.first.setdefault(cell, time)
            self.last[cell] = time

    @staticmethod
    def _length(start, end):
        return math.hypot(end[0] - start[0], end[1] - start[1])

    def _at_ends(self, cells, limits, used):
        """Return the walls that have a return near them, and the floor around other returns."""
        near_walls, appeared = set(), set()
        for (x, y), length in used:
            col, row = math.floor(x + 0.5), math.floor(y + 0.5)
            reach = math.ceil(_tolerance(limits, length))
            near = {
                (r, c)
                for r, c in _square(row, col, reach)
                if _value(cells, r, c) >= limits.wall
                and (r - row) ** 2 + (c - col) ** 2 <= reach**2
            }
            near_walls |= near
            around = _square(row, col, 1)
            if not near and all(1 <= _value(cells, r, c) <= limits.floor for r, c in around):
                self.ends[row, col] += 1
                appeared |= set(around)
        return near_walls, appeared


def _passed(cells, limits, start, end, length):
    """Return the walls and the floor that a beam passes through."""
    across, up = (end[0] - start[0]) / length, (end[1] - start[1]) / length
    for k in range(1, math.floor(length - _tolerance(limits, length) - limits.clearance) + 1):
        x, y = start[0] + k * across, start[1] + k * up
        cell = math.floor(y + 0.5), math.floor(x + 0.5)
        value = _value(cells, *cell)
        aside = _tolerance(limits, k)
        sides = ((x - aside * up, y + aside * across), (x + aside * up, y - aside * across))
        if 0 < value <= limits.floor or (
            value >= limits.wall and all(_is_wall_around(cells, limits, *side) for side in sides)
        ):
            yield cell


def _is_wall_around(cells, limits, x, y):
    around = _square(math.floor(y + 0.5), math.floor(x + 0.5), 1)
    return any(_value(cells, row, col) >= limits.wall for row, col in around)


def _tolerance(limits, distance):
    return limits.reach + math.hypot(limits.offset, limits.slope * distance)


def _fits(limits, length):
    return _tolerance(limits, length) <= limits.max_tolerance


def _square(row, col, reach):
    return [(row + i, col + j) for i in range(-reach, reach + 1) for j in range(-reach, reach + 1)]


def _value(cells, row, col):
    inside = 0 <= row < cells.shape[0] and 0 <= col < cells.shape[1]
    return int(cells[row, col]) if inside else 0
