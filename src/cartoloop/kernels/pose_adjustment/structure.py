# SPDX-License-Identifier: Apache-2.0
"""Which vertices of a pose graph are connected: components, blocks of the reduced system.

All of it depends on which vertices the constraints connect, not on any pose or measurement.
"""

from __future__ import annotations

import numpy as np

from cartoloop._jit import kernel
from cartoloop.arrays import IntArray
from cartoloop.kernels.pose_adjustment.layout import Layout
from cartoloop.kernels.sparse_cholesky.arrays import filled


@kernel
def first_vertex_of_component(
    num_vertices: int, vertex_a: IntArray, vertex_b: IntArray
) -> IntArray:
    """Return for each vertex the lowest one that constraints connect it with, (num_vertices,)."""
    first = np.empty(num_vertices, dtype=np.int64)
    for v in range(num_vertices):
        first[v] = v
    for i in range(vertex_a.size):
        a, b = vertex_a[i], vertex_b[i]
        while first[a] != a:
            first[a] = first[first[a]]
            a = first[a]
        while first[b] != b:
            first[b] = first[first[b]]
            b = first[b]
        if a < b:
            first[b] = a
        else:
            first[a] = b
    for v in range(num_vertices):
        first[v] = first[first[v]]  # ascending, so that the lower one already points at its root
    return first


@kernel
def slots_in_use(layout: Layout) -> IntArray:
    """Return the ends (n, 2) of all slots that belong to a window."""
    windows, slot_ends = layout.windows, layout.slot_ends
    count = 0
    for w in range(windows.shape[0]):
        count += windows[w, 3] - windows[w, 2]
    ends = np.empty((count, 2), dtype=np.int64)
    count = 0
    for w in range(windows.shape[0]):
        for s in range(windows[w, 2], windows[w, 3]):
            ends[count, 0] = slot_ends[s, 0]
            ends[count, 1] = slot_ends[s, 1]
            count += 1
    return ends


@kernel
def _list_couplings(
    num_kept: int,
    row_of_vertex: IntArray,
    layout: Layout,
    vertex_a: IntArray,
    vertex_b: IntArray,
) -> tuple[IntArray, IntArray, IntArray]:
    """Return where the couplings of each row begin, their other rows, and their sources.

    A source is a slot of a window, or -1 - direct constraint.
    """
    windows, slot_ends = layout.windows, layout.slot_ends
    begin = np.zeros(num_kept + 2, dtype=np.int64)
    for w in range(windows.shape[0]):
        for s in range(windows[w, 2], windows[w, 3]):
            begin[row_of_vertex[slot_ends[s, 0]] + 1] += 1
    for e in range(vertex_a.size):
        begin[row_of_vertex[min(vertex_a[e], vertex_b[e])] + 1] += 1
    for k in range(num_kept + 1):
        begin[k + 1] += begin[k]
    end = begin.copy()
    upper = np.empty(begin[num_kept + 1], dtype=np.int64)
    source = np.empty(begin[num_kept + 1], dtype=np.int64)
    for w in range(windows.shape[0]):
        for s in range(windows[w, 2], windows[w, 3]):
            k = row_of_vertex[slot_ends[s, 0]]
            upper[end[k]] = row_of_vertex[slot_ends[s, 1]]
            source[end[k]] = s
            end[k] += 1
    for e in range(vertex_a.size):
        k = row_of_vertex[min(vertex_a[e], vertex_b[e])]
        upper[end[k]] = row_of_vertex[max(vertex_a[e], vertex_b[e])]
        source[end[k]] = -1 - e
        end[k] += 1
    return begin, upper, source


@kernel
def couple_vertices(
    num_kept: int,
    row_of_vertex: IntArray,
    layout: Layout,
    vertex_a: IntArray,
    vertex_b: IntArray,
) -> tuple[IntArray, IntArray, IntArray, IntArray]:
    """Return which blocks the reduced system has, and where slots and constraints are added.

    Parameters
    ----------
    num_kept : int64, rows of the reduced system; as a row it stands for all fixed vertices.
    row_of_vertex : int64, shape (num_vertices,), row in the reduced system, ascending.
    vertex_a, vertex_b : int64, shape (n,), ends of the direct constraints.

    Returns
    -------
    slot_blocks : int64, shape (num_slots,), block of every slot of the windows.
    edge_blocks : int64, shape (n,), block of every direct constraint.
    row_begin : int64, shape (num_kept + 1,).
    columns : int64: columns[row_begin[k]:row_begin[k + 1]] > k are coupled with k; column number i
        of all has block num_kept + 1 + i.
    """
    slot_blocks = filled(layout.slot_ends.shape[0], num_kept)
    edge_blocks = filled(vertex_a.size, num_kept)
    begin, upper, source = _list_couplings(num_kept, row_of_vertex, layout, vertex_a, vertex_b)
    row_begin = np.zeros(num_kept + 1, dtype=np.int64)
    columns = np.empty(upper.size, dtype=np.int64)
    block_of = np.empty(num_kept + 1, dtype=np.int64)
    seen_by = filled(num_kept + 1, -1)
    count = 0
    for k in range(num_kept):
        seen_by[k] = seen_by[num_kept] = k
        block_of[k], block_of[num_kept] = k, num_kept
        for i in range(begin[k], begin[k + 1]):
            other = upper[i]
            if seen_by[other] != k:
                seen_by[other] = k
                block_of[other] = num_kept + 1 + count
                columns[count] = other
                count += 1
            if source[i] >= 0:
                slot_blocks[source[i]] = block_of[other]
            else:
                edge_blocks[-1 - source[i]] = block_of[other]
        row_begin[k + 1] = count
    return slot_blocks, edge_blocks, row_begin, columns[:count]
