# SPDX-License-Identifier: Apache-2.0
"""The constraints of nodes that hang on submaps alone, laid out for elimination eight at a time.

A *window* is 256 consecutive nodes. Its nodes are sorted by how many constraints they have, and
*blocks* of eight that have equally many stand side by side, in *lanes*; a block that is short of
nodes repeats its first. Row k of a block has the k-th constraint of each of its nodes, submaps
ascending. What a window leaves on its submaps is summed in *slots* of its own, one for each submap
and each pair of submaps that one of its nodes ties together: windows do not depend on each other,
and one that gains constraints is packed anew behind all others.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel
from cartoloop.kernels.schur_structure import filled

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

LANES = 8
WINDOW = 256
MEASURED = 9 * LANES
"""Numbers of a row as measured: tf_a_b (x, y, theta), information (xx, xy, xt, yy, yt, tt)."""


@kernel
def link_constraints(
    first: int, index_b: IntArray, is_kept: NDArray[np.bool_], head: IntArray, following: IntArray
) -> None:
    """Put constraints from `first` on into the list of their node, the newest in front.

    Parameters
    ----------
    index_b : int64, shape (num_constraints,), nodes.
    is_kept : bool, shape (num_nodes,), nodes that are not packed.
    head : int64, shape (num_nodes,), newest constraint of a node, -1 for none.
    following : int64, shape (num_constraints,), the one before it of the same node, -1 for none.
    """
    for c in range(first, index_b.size):
        node = index_b[c]
        if not is_kept[node]:
            following[c] = head[node]
            head[node] = c


@kernel
def measure_windows(
    windows: IntArray, head: IntArray, following: IntArray
) -> tuple[int, int, int, int]:
    """Return the most constraints of a window; how many blocks, rows, rows of pairs all need."""
    most = num_blocks = num_rows = num_pairs = 0
    of_count = np.zeros(following.size + 1, dtype=np.int64)
    for w in range(windows.size):
        total = most_of_node = 0
        for node in range(windows[w] * WINDOW, min((windows[w] + 1) * WINDOW, head.size)):
            count = 0
            c = head[node]
            while c >= 0:
                count += 1
                c = following[c]
            of_count[count] += 1
            total += count
            most_of_node = max(most_of_node, count)
        most = max(most, total)
        for k in range(1, most_of_node + 1):
            blocks = (of_count[k] + LANES - 1) // LANES
            num_blocks += blocks
            num_rows += blocks * k
            num_pairs += blocks * (k * (k - 1) // 2)
            of_count[k] = 0
    return most, num_blocks, num_rows, num_pairs


@kernel
def _gather_window(
    window: int,
    head: IntArray,
    following: IntArray,
    index_a: IntArray,
    out_begin: IntArray,
    out_ids: IntArray,
    out_order: IntArray,
) -> int:
    """Write the constraints of a window's nodes into `out_ids`, by submap and then by age.

    Those of its node i are from out_begin[i] to out_begin[i + 1]. `out_order` lists the nodes that
    have any, fewest constraints first; how many these are is returned.
    """
    first, last = window * WINDOW, min((window + 1) * WINDOW, head.size)
    end = most = 0
    for node in range(first, last):
        begin = end
        out_begin[node - first] = begin
        c = head[node]
        while c >= 0:
            place = end
            while place > begin and index_a[out_ids[place - 1]] >= index_a[c]:  # c is the older
                out_ids[place] = out_ids[place - 1]
                place -= 1
            out_ids[place] = c
            end += 1
            c = following[c]
        most = max(most, end - begin)
    out_begin[last - first] = end
    place_of = np.zeros(most + 2, dtype=np.int64)
    for i in range(last - first):
        place_of[out_begin[i + 1] - out_begin[i] + 1] += 1
    none = place_of[1]
    place_of[1] = 0
    for k in range(1, most + 1):
        place_of[k + 1] += place_of[k]
    for i in range(last - first):
        k = out_begin[i + 1] - out_begin[i]
        if k > 0:
            out_order[place_of[k]] = i
            place_of[k] += 1
    num_nodes: int = last - first - none
    return num_nodes


@kernel
def _with_room(ends: IntArray, count: int, room: int) -> IntArray:
    """Return the slots' ends, of which `count` are in use, grown if need be to hold `room` more."""
    if count + room <= ends.shape[0]:
        return ends
    grown = np.empty((2 * count + room, 2), dtype=np.int64)
    for s in range(count):
        grown[s, 0] = ends[s, 0]
        grown[s, 1] = ends[s, 1]
    return grown


@kernel
def _fill_up(
    blocks: IntArray, first_row: int, nodes: IntArray, ids: IntArray, slots: IntArray
) -> None:
    """Repeat the first node of every block in the lanes that are left."""
    for b in range(blocks.shape[0]):
        for lane in range(blocks[b, 2], LANES):
            nodes[b, lane] = nodes[b, 0]
            for row in range(blocks[b, 0] - first_row, blocks[b, 0] - first_row + blocks[b, 1]):
                ids[row, lane] = -1
                slots[row, lane] = slots[row, 0]


@kernel
def pack_windows(
    windows: IntArray,
    head: IntArray,
    following: IntArray,
    index_a: IntArray,
    num_submaps: int,
    out_blocks: IntArray,
    out_nodes: IntArray,
    out_ids: IntArray,
    out_slots: IntArray,
    out_pair_slots: IntArray,
    first_block: int,
    first_row: int,
    first_pair: int,
    first_slot: int,
    most: int,
) -> tuple[IntArray, IntArray]:
    """Lay out the constraints of some windows; all numbers written are counted from `first_...`.

    Parameters
    ----------
    windows : int64, shape (n,), which.
    head, following : of :func:`link_constraints`; most : int64, of :func:`measure_windows`.
    index_a : int64, shape (num_constraints,), submaps.
    out_blocks : int64, shape (num_blocks, 4): first row, rows, nodes, first row of pairs.
    out_nodes : int64, shape (num_blocks, 8).
    out_ids : int64, shape (num_rows, 8), constraints; -1 in lanes that only fill up.
    out_slots : int64, shape (num_rows, 8), slots of their submaps.
    out_pair_slots : int64, shape (num_pairs, 8), slots of pairs of a node's constraints, (0, 1),
        (0, 2), (1, 2), ...; -1 - slot of the submap where one has seen the node twice.

    Returns
    -------
    out_windows : int64, shape (n, 4): blocks and slots, from and to.
    slot_ends : int64, shape (num_slots, 2), submaps a <= b; of a = b is the diagonal block of a.
    """
    out_windows = np.empty((windows.size, 4), dtype=np.int64)
    ends = np.empty((256, 2), dtype=np.int64)
    begin = np.empty(WINDOW + 1, dtype=np.int64)
    order = np.empty(WINDOW, dtype=np.int64)
    ids = np.empty(most, dtype=np.int64)
    numbers = np.empty(most, dtype=np.int64)  # of their submaps among those of the window
    number_of = filled(num_submaps, -1)
    slot_of = np.empty(0, dtype=np.int64)
    block = row = pair = slot = 0
    for w in range(windows.size):
        num_nodes = _gather_window(windows[w], head, following, index_a, begin, ids, order)
        out_windows[w, 0], out_windows[w, 2] = first_block + block, first_slot + slot
        num_members = 0
        end = begin[min(WINDOW, head.size - windows[w] * WINDOW)]
        for i in range(end):
            submap = index_a[ids[i]]
            if number_of[submap] < 0:
                number_of[submap] = num_members
                num_members += 1
            numbers[i] = number_of[submap]
        for i in range(end):
            number_of[index_a[ids[i]]] = -1
        if slot_of.size < num_members * num_members:
            slot_of = np.empty(2 * num_members * num_members, dtype=np.int64)
        for i in range(num_members * num_members):
            slot_of[i] = -1
        ends = _with_room(ends, slot, num_members * (num_members + 1) // 2)
        lane = k = 0
        for n in range(num_nodes):
            of_node = begin[order[n]]
            if lane == LANES or begin[order[n] + 1] - of_node != k:
                k = begin[order[n] + 1] - of_node
                lane = 0
                out_blocks[block, 0] = first_row + row
                out_blocks[block, 1] = k
                out_blocks[block, 3] = first_pair + pair
                block += 1
                row += k
                pair += k * (k - 1) // 2
            out_nodes[block - 1, lane] = windows[w] * WINDOW + order[n]
            p = pair - k * (k - 1) // 2
            for e in range(k):
                b = numbers[of_node + e]
                for f in range(e + 1):  # f = e: the submap's own slot
                    a = numbers[of_node + f]
                    if slot_of[a * num_members + b] < 0:
                        ends[slot, 0] = index_a[ids[of_node + f]]
                        ends[slot, 1] = index_a[ids[of_node + e]]
                        slot_of[a * num_members + b] = first_slot + slot
                        slot += 1
                    s = slot_of[a * num_members + b]
                    if f < e:
                        out_pair_slots[p, lane] = s if a != b else -1 - s
                        p += 1
                    else:
                        out_slots[row - k + e, lane] = s
                        out_ids[row - k + e, lane] = ids[of_node + e]
            lane += 1
            out_blocks[block - 1, 2] = lane
        out_windows[w, 1], out_windows[w, 3] = first_block + block, first_slot + slot
    _fill_up(out_blocks, first_row, out_nodes, out_ids, out_slots)
    return out_windows, ends[:slot]


@kernel
def fill_rows(
    ids: IntArray,
    kinds: IntArray,
    relative_poses: FloatArray,
    informations: FloatArray,
    out_measured: FloatArray,
    out_kinds: IntArray,
) -> None:
    """Write measurements and kinds of the constraints of rows into the outputs.

    Parameters
    ----------
    ids : int64, shape (num_rows, 8); -1: as the first lane.
    kinds, relative_poses, informations : of the graph, shapes (n,), (n, 3), (n, 9).
    out_measured : float64, shape (num_rows, 72): of each row x, y, theta, xx, xy, xt, yy, yt, tt,
        eight of each.
    out_kinds : int64, shape (num_rows, 8).
    """
    for row in range(ids.shape[0]):
        for i in range(LANES):
            c = ids[row, i]
            if c < 0:
                c = ids[row, 0]
            out_kinds[row, i] = kinds[c]
            out_measured[row, i] = relative_poses[c, 0]
            out_measured[row, i + LANES] = relative_poses[c, 1]
            out_measured[row, i + 2 * LANES] = relative_poses[c, 2]
            out_measured[row, i + 3 * LANES] = informations[c, 0]
            out_measured[row, i + 4 * LANES] = informations[c, 1]
            out_measured[row, i + 5 * LANES] = informations[c, 2]
            out_measured[row, i + 6 * LANES] = informations[c, 4]
            out_measured[row, i + 7 * LANES] = informations[c, 5]
            out_measured[row, i + 8 * LANES] = informations[c, 8]


@kernel
def read_weights(
    windows: IntArray, blocks: IntArray, ids: IntArray, weights: FloatArray, out_weights: FloatArray
) -> None:
    """Write weights (num_rows, 8) to where their constraints are in `out_weights`."""
    for w in range(windows.shape[0]):
        for b in range(windows[w, 0], windows[w, 1]):
            for row in range(blocks[b, 0], blocks[b, 0] + blocks[b, 1]):
                for i in range(blocks[b, 2]):
                    out_weights[ids[row, i]] = weights[row, i]
