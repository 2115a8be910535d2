# SPDX-License-Identifier: Apache-2.0
"""The constraints of the nodes that adjustment eliminates, kept packed while the graph grows."""

from __future__ import annotations

import numpy as np

from cartoloop.arrays import IntArray
from cartoloop.growing_array import GrowingArray
from cartoloop.kernels.pose_adjustment import packing
from cartoloop.kernels.pose_adjustment.layout import (
    FACTORED,
    LANES,
    MEASURED,
    WINDOW,
    Elimination,
    Layout,
    Rows,
)
from cartoloop.kernels.pose_adjustment.packing import Chains, Cursor, Packed
from cartoloop.kernels.pose_adjustment.rows import fill_rows
from cartoloop.pose_adjustment.problem import Problem

_MAX_STALE = 0.5
"""Share of the blocks that earlier packings may have left behind, before all is packed again:
memory stays within twice what is needed, and a constraint is packed twice on average at most."""


class PackedNodes:
    """Constraints of nodes with constraints to submaps only, laid out for the kernels.

    Parameters
    ----------
    kept_nodes : nodes that are not packed: fixed, linked to other nodes, or control points.

    Attributes
    ----------
    num_groups : groups of all constraints added, packed or not.
    """

    def __init__(self, kept_nodes: IntArray) -> None:
        self.kept_nodes = kept_nodes
        self.num_groups = 0
        self._head = GrowingArray((), np.int64)
        self._following = GrowingArray((), np.int64)
        self._windows = GrowingArray((4,), np.int64)
        self._clear()

    def _clear(self) -> None:
        self._blocks = GrowingArray((4,), np.int64)
        self._nodes = GrowingArray((LANES,), np.int64)
        self._ids = GrowingArray((LANES,), np.int64)
        self._groups = GrowingArray((LANES,), np.int64)
        self._measured = GrowingArray((MEASURED,), np.float64)
        self._weights = GrowingArray((LANES,), np.float64)
        self._slots = GrowingArray((LANES,), np.int64)
        self._pair_slots = GrowingArray((LANES,), np.int64)
        self._slot_ends = GrowingArray((2,), np.int64)
        self._factors = GrowingArray((FACTORED,), np.float64)
        self._sums = GrowingArray((9,), np.float64)
        self._slot_poses = GrowingArray((5,), np.float64)
        self._num_stale = 0

    @property
    def num_constraints(self) -> int:
        """Number of constraints of the problem that were added, packed or not."""
        return len(self._following)

    @property
    def layout(self) -> Layout:
        """The arrays of the packed constraints; valid until the next :meth:`extend`."""
        rows = Rows(self._ids.view, self._groups.view, self._measured.view, self._weights.view)
        return Layout(
            self._windows.view,
            self._blocks.view,
            self._nodes.view,
            rows,
            self._slots.view,
            self._pair_slots.view,
            self._slot_ends.view,
        )

    @property
    def elimination(self) -> Elimination:
        """The buffers of the elimination; valid until the next :meth:`extend`."""
        return Elimination(self._factors.view, self._sums.view, self._slot_poses.view)

    def extend(self, problem: Problem) -> None:
        """Take in what has been added to a problem since the last call."""
        first = len(self._following)
        index_b = problem.constraints.index_b
        newest_group = problem.constraints.groups[first:].max(initial=-1)
        self.num_groups = max(self.num_groups, 1 + int(newest_group))
        self._head.grow(problem.num_nodes - len(self._head))[:] = -1
        self._following.grow(index_b.size - first)
        self._windows.grow(-(-problem.num_nodes // WINDOW) - len(self._windows))[:] = 0
        is_kept = np.zeros(problem.num_nodes, dtype=bool)
        is_kept[self.kept_nodes] = True
        chains = Chains(self._head.view, self._following.view)
        packing.link_constraints(first, index_b, is_kept, chains)
        windows = self._windows.view
        is_changed = np.zeros(len(windows), dtype=bool)
        is_changed[index_b[first:] // WINDOW] = True
        begin, end = windows[is_changed, 0], windows[is_changed, 1]
        self._num_stale += int((end - begin).sum())
        if self._num_stale > _MAX_STALE * len(self._blocks):
            self._clear()
            is_changed[:] = True
        self._pack(problem, chains, np.flatnonzero(is_changed))

    def _pack(self, problem: Problem, chains: Chains, windows: IntArray) -> None:
        constraints = problem.constraints
        most, num_blocks, num_rows, num_pairs = packing.measure_windows(windows, chains)
        first = Cursor(
            len(self._blocks), len(self._ids), len(self._pair_slots), len(self._slot_ends)
        )
        packed = Packed(
            self._blocks.grow(num_blocks),
            self._nodes.grow(num_blocks),
            self._ids.grow(num_rows),
            self._slots.grow(num_rows),
            self._pair_slots.grow(num_pairs),
        )
        self._windows.view[windows], slot_ends = packing.pack_windows(
            windows, chains, constraints.index_a, problem.num_submaps, most, first, packed
        )
        self._slot_ends.extend(slot_ends)
        self._slot_poses.grow(len(slot_ends))
        self._sums.grow(len(slot_ends))
        self._factors.grow(num_blocks)
        self._weights.grow(num_rows)[:] = 1.0
        fill_rows(
            packed.ids,
            constraints.groups,
            constraints.tf_a_b,
            constraints.informations.reshape(-1, 9),
            self._measured.grow(num_rows),
            self._groups.grow(num_rows),
        )
