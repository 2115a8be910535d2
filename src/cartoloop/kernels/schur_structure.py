# SPDX-License-Identifier: Apache-2.0
"""What hangs on what in a pose graph: components, constraints by node, blocks to solve for.

All of it depends on which vertices the constraints tie together, not on any pose or measurement.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@kernel
def filled(size: int, value: int) -> IntArray:
    """Return an int64 array of one value (np.full takes the compiler a while in every kernel)."""
    array = np.empty(size, dtype=np.int64)
    for i in range(size):
        array[i] = value
    return array


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
def sort_by_node(
    vertex_a: IntArray,
    vertex_b: IntArray,
    eliminated_of_vertex: IntArray,
    kept_of_vertex: IntArray,
    num_eliminated: int,
) -> tuple[IntArray, IntArray, IntArray]:
    """Return the constraints of each node that is eliminated, and those between kept vertices.

    Parameters
    ----------
    vertex_a, vertex_b : int64, shape (num_constraints,).
    eliminated_of_vertex : int64, shape (num_vertices,), rank among the eliminated, else -1.
    kept_of_vertex : int64, shape (num_vertices,), row in the reduced system.
    num_eliminated : int64.

    Returns
    -------
    begin : int64, shape (num_eliminated + 1,).
    order : int64, constraints begin[i]:begin[i + 1] of eliminated node i, their submaps ascending.
    kept_order : int64, the other constraints, ascending.
    """
    begin = np.zeros(num_eliminated + 1, dtype=np.int64)
    num_kept = 0
    for i in range(vertex_b.size):
        node = eliminated_of_vertex[vertex_b[i]]
        if node < 0:
            num_kept += 1
        else:
            begin[node + 1] += 1
    for node in range(num_eliminated):
        begin[node + 1] += begin[node]
    filled = begin.copy()
    order = np.empty(vertex_b.size - num_kept, dtype=np.int64)
    kept_order = np.empty(num_kept, dtype=np.int64)
    num_kept = 0
    for i in range(vertex_b.size):
        node = eliminated_of_vertex[vertex_b[i]]
        if node < 0:
            kept_order[num_kept] = i
            num_kept += 1
            continue
        key = kept_of_vertex[vertex_a[i]]
        place = filled[node]
        while place > begin[node] and kept_of_vertex[vertex_a[order[place - 1]]] > key:
            order[place] = order[place - 1]
            place -= 1
        order[place] = i
        filled[node] += 1
    return begin, order, kept_order


@kernel
def pack_constraints(
    order: IntArray,
    vertex_a: IntArray,
    vertex_b: IntArray,
    kinds: IntArray,
    relative_poses: FloatArray,
    informations: FloatArray,
    loss_of_kind: IntArray,
    out_vertex_a: IntArray,
    out_vertex_b: IntArray,
    out_rows: FloatArray,
    out_losses: IntArray,
) -> None:
    """Write constraints, in the given order, into the rows that the pose kernels read.

    Parameters
    ----------
    order : int64, shape (n,).
    vertex_a, vertex_b, kinds : int64, shape (num_constraints,).
    relative_poses : float64, shape (num_constraints, 3).
    informations : float64, shape (num_constraints, 9), row by row.
    loss_of_kind : int64, shape (num_kinds,), which loss acts on which kind of constraint.
    out_vertex_a, out_vertex_b, out_losses : int64, shape (n,).
    out_rows : float64, shape (n, 10), see :mod:`cartoloop.kernels.pose_residuals`.
    """
    for i in range(order.size):
        c = order[i]
        out_vertex_a[i] = vertex_a[c]
        out_vertex_b[i] = vertex_b[c]
        out_losses[i] = loss_of_kind[kinds[c]]
        out_rows[i, 0] = relative_poses[c, 0]
        out_rows[i, 1] = relative_poses[c, 1]
        out_rows[i, 2] = relative_poses[c, 2]
        out_rows[i, 3] = informations[c, 0]
        out_rows[i, 4] = informations[c, 1]
        out_rows[i, 5] = informations[c, 2]
        out_rows[i, 6] = informations[c, 4]
        out_rows[i, 7] = informations[c, 5]
        out_rows[i, 8] = informations[c, 8]
        out_rows[i, 9] = 1.0


@kernel
def couple_kept_vertices(
    num_kept: int, begin: IntArray, kept_ends: IntArray, kept_a: IntArray, kept_b: IntArray
) -> tuple[IntArray, IntArray, IntArray, IntArray]:
    """Return which blocks the reduced system has, and which of them each constraint adds to.

    Parameters
    ----------
    num_kept : int64, rows of the reduced system; the number itself stands for vertices held.
    begin : int64, shape (num_eliminated + 1,).
    kept_ends : int64, shape (begin[-1],), of the constraints sorted by node.
    kept_a, kept_b : int64, shape (n,), ends of the constraints between kept vertices.

    Returns
    -------
    pair_slots : int64, block of every pair of constraints of one node: (0, 1), (0, 2), (1, 2), ...
    slots : int64, shape (n,), block of every constraint between kept vertices.
    row_begin : int64, shape (num_kept + 1,).
    columns : int64: columns[row_begin[k]:row_begin[k + 1]] > k are coupled with k; block
        row_begin[k] + i of them has slot num_kept + 1 + row_begin[k] + i.
    """
    num_sorted = kept_ends.size
    last = np.empty(num_sorted, dtype=np.int64)
    pair_begin = np.empty(num_sorted, dtype=np.int64)  # where the pairs of e begin, less the node's
    num_pairs = 0
    for n in range(begin.size - 1):
        for e in range(begin[n], begin[n + 1]):
            last[e] = begin[n + 1]
            pair_begin[e] = num_pairs - begin[n]
            num_pairs += e - begin[n]
    incident_begin, incident = _by_value(kept_ends, num_kept + 1)
    lower = np.empty(kept_a.size, dtype=np.int64)
    upper = np.empty(kept_a.size, dtype=np.int64)
    for e in range(kept_a.size):
        lower[e] = min(kept_a[e], kept_b[e])
        upper[e] = max(kept_a[e], kept_b[e])
    direct_begin, direct = _by_value(lower, num_kept + 1)
    pair_slots = filled(num_pairs, num_kept)
    slots = filled(kept_a.size, num_kept)
    row_begin = np.zeros(num_kept + 1, dtype=np.int64)
    columns = np.empty(num_pairs + kept_a.size, dtype=np.int64)
    slot_of = np.empty(num_kept + 1, dtype=np.int64)
    seen_by = filled(num_kept + 1, -1)
    slot_of[num_kept] = num_kept
    count = 0
    for k in range(num_kept):
        seen_by[num_kept] = k
        seen_by[k] = k
        slot_of[k] = k
        for i in range(incident_begin[k], incident_begin[k + 1]):
            e = incident[i]
            for f in range(e + 1, last[e]):
                other = kept_ends[f]
                if seen_by[other] != k:
                    seen_by[other] = k
                    slot_of[other] = num_kept + 1 + count
                    columns[count] = other
                    count += 1
                pair_slots[pair_begin[f] + e] = slot_of[other]
        for i in range(direct_begin[k], direct_begin[k + 1]):
            other = upper[direct[i]]
            if seen_by[other] != k:
                seen_by[other] = k
                slot_of[other] = num_kept + 1 + count
                columns[count] = other
                count += 1
            slots[direct[i]] = slot_of[other]
        row_begin[k + 1] = count
    return pair_slots, slots, row_begin, columns[:count]


@kernel
def _by_value(values: IntArray, num_values: int) -> tuple[IntArray, IntArray]:
    """Return where 0 to num_values - 1 begin in a stable sort of `values`, and the sort."""
    begin = np.zeros(num_values + 1, dtype=np.int64)
    for i in range(values.size):
        begin[values[i] + 1] += 1
    for value in range(num_values):
        begin[value + 1] += begin[value]
    filled = begin.copy()
    order = np.empty(values.size, dtype=np.int64)
    for i in range(values.size):
        order[filled[values[i]]] = i
        filled[values[i]] += 1
    return begin, order


@kernel
def both_halves(row_begin: IntArray, columns: IntArray) -> tuple[IntArray, IntArray]:
    """Return the neighbours of every vertex, from those above it: begin (n + 1,), neighbours."""
    n = row_begin.size - 1
    begin = np.zeros(n + 1, dtype=np.int64)
    for k in range(n):
        begin[k + 1] += row_begin[k + 1] - row_begin[k]
        for i in range(row_begin[k], row_begin[k + 1]):
            begin[columns[i] + 1] += 1
    for k in range(n):
        begin[k + 1] += begin[k]
    filled = begin.copy()
    neighbours = np.empty(2 * columns.size, dtype=np.int64)
    for k in range(n):
        for i in range(row_begin[k], row_begin[k + 1]):
            other = columns[i]
            neighbours[filled[k]] = other
            filled[k] += 1
            neighbours[filled[other]] = k
            filled[other] += 1
    return begin, neighbours
