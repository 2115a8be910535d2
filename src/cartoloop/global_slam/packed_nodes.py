# SPDX-License-Identifier: Apache-2.0
"""The constraints of the nodes that adjustment eliminates, kept ready while the graph grows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cartoloop.global_slam.growing_array import GrowingArray
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.kernels import node_elimination, node_packing, node_steps
from cartoloop.kernels.node_packing import LANES, MEASURED, WINDOW

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_MOST_STALE = 0.5  # share of the rows that may have been left behind before all is packed anew


class PackedNodes:
    """Constraints of nodes that hang on submaps alone, see :mod:`cartoloop.kernels.node_packing`.

    Parameters
    ----------
    kept_nodes : nodes that are not packed: fixed, or tied to other nodes.
    """

    def __init__(self, kept_nodes: IntArray) -> None:
        self.kept_nodes = kept_nodes
        self._head = GrowingArray((), np.int64)
        self._following = GrowingArray((), np.int64)
        self._windows = GrowingArray((4,), np.int64)
        self._clear()

    def _clear(self) -> None:
        self._blocks = GrowingArray((4,), np.int64)
        self._nodes = GrowingArray((LANES,), np.int64)
        self._factors = GrowingArray((node_elimination.FACTORED,), np.float64)
        self._ids = GrowingArray((LANES,), np.int64)
        self._slots = GrowingArray((LANES,), np.int64)
        self._kinds = GrowingArray((LANES,), np.int64)
        self._weights = GrowingArray((LANES,), np.float64)
        self._measured = GrowingArray((MEASURED,), np.float64)
        self._pair_slots = GrowingArray((LANES,), np.int64)
        self._slot_ends = GrowingArray((2,), np.int64)
        self._slot_poses = GrowingArray((5,), np.float64)
        self._sums = GrowingArray((9,), np.float64)
        self._num_stale = 0

    @property
    def windows(self) -> IntArray:
        """Blocks and slots of every window, from and to, shape (num_windows, 4)."""
        return self._windows.view

    @property
    def slot_ends(self) -> IntArray:
        """Submaps of every slot, shape (num_slots, 2)."""
        return self._slot_ends.view

    @property
    def sums(self) -> FloatArray:
        """What windows leave on their submaps, as of the last elimination, (num_slots, 9)."""
        return self._sums.view

    def extend(self, graph: PoseGraph) -> None:
        """Take in what has been added to a graph since the last call."""
        first = len(self._following)
        self._head.grow(graph.num_nodes - len(self._head))[:] = -1
        self._following.grow(graph.num_constraints - first)
        self._windows.grow(-(-graph.num_nodes // WINDOW) - len(self._windows))[:] = 0
        is_kept = np.zeros(graph.num_nodes, dtype=bool)
        is_kept[self.kept_nodes] = True
        node_packing.link_constraints(
            first, graph.index_b, is_kept, self._head.view, self._following.view
        )
        is_changed = np.zeros(len(self._windows), dtype=bool)
        is_changed[graph.index_b[first:] // WINDOW] = True
        begin, end = self.windows[is_changed, 0], self.windows[is_changed, 1]
        self._num_stale += int((end - begin).sum())
        if self._num_stale > _MOST_STALE * len(self._blocks):
            self._clear()
            is_changed[:] = True
        self._pack(graph, np.flatnonzero(is_changed))

    def _pack(self, graph: PoseGraph, windows: IntArray) -> None:
        head, following = self._head.view, self._following.view
        most, num_blocks, num_rows, num_pairs = node_packing.measure_windows(
            windows, head, following
        )
        first_row = len(self._ids)
        starts = len(self._blocks), first_row, len(self._pair_slots), len(self._slot_ends)
        self.windows[windows], slot_ends = node_packing.pack_windows(
            windows,
            head,
            following,
            graph.index_a,
            graph.num_submaps,
            self._blocks.grow(num_blocks),
            self._nodes.grow(num_blocks),
            self._ids.grow(num_rows),
            self._slots.grow(num_rows),
            self._pair_slots.grow(num_pairs),
            *starts,
            most,
        )
        self._slot_ends.extend(slot_ends)
        self._slot_poses.grow(len(slot_ends))
        self._sums.grow(len(slot_ends))
        self._factors.grow(num_blocks)
        self._weights.grow(num_rows)[:] = 1.0
        node_packing.fill_rows(
            self._ids.view[first_row:],
            graph.kinds,
            graph.relative_poses,
            graph.informations.reshape(-1, 9),
            self._measured.grow(num_rows),
            self._kinds.grow(num_rows),
        )

    def linearize(
        self,
        poses: FloatArray,
        rotations: FloatArray,
        loss_of_kind: IntArray,
        scale: float,
        damping: float,
        eliminate: bool,
    ) -> tuple[float, float, bool]:
        """Return the cost; eliminate the nodes if told to; see :func:`linearize_windows`."""
        return node_elimination.linearize_windows(
            poses,
            rotations,
            self.windows,
            self._blocks.view,
            self._nodes.view,
            self._slots.view,
            self._pair_slots.view,
            self.slot_ends,
            self._measured.view,
            self._kinds.view,
            loss_of_kind,
            scale,
            damping,
            eliminate,
            self._slot_poses.view,
            self._weights.view,
            self._factors.view,
            self.sums,
        )

    def move(
        self,
        poses: FloatArray,
        rotations: FloatArray,
        submap_steps: FloatArray,
        out_poses: FloatArray,
    ) -> None:
        """Write the nodes' poses after the step that follows; see :func:`move_nodes`."""
        node_steps.move_nodes(
            poses,
            rotations,
            submap_steps,
            self.windows,
            self._blocks.view,
            self._nodes.view,
            self._slots.view,
            self.slot_ends,
            self._measured.view,
            self._weights.view,
            self._factors.view,
            out_poses,
        )

    def read_weights(self, out_weights: FloatArray) -> None:
        """Write the weights of our constraints into `out_weights`, shape (num_constraints,)."""
        node_packing.read_weights(
            self.windows,
            self._blocks.view,
            self._ids.view,
            self._weights.view,
            out_weights,
        )

    def set_weights(self, weights: FloatArray) -> None:
        """Give our constraints these weights, shape (num_constraints,)."""
        self._weights.view[:] = np.where(self._ids.view < 0, 1.0, weights[self._ids.view])
