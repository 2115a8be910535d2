# SPDX-License-Identifier: Apache-2.0
"""Packing: the constraints of nodes that only submaps see, laid out for elimination.

The arrays are explained in :mod:`cartoloop.kernels.pose_adjustment.layout`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cartoloop._jit import kernel
from cartoloop.arrays import BoolArray, IntArray
from cartoloop.kernels.pose_adjustment.layout import LANES, WINDOW
from cartoloop.kernels.sparse_cholesky.arrays import filled


class Chains(NamedTuple):
    """The constraints of each packed node, as linked lists, newest first.

    Attributes
    ----------
    head : int64, (num_nodes,), newest constraint of a node, -1 for none.
    following : int64, (num_constraints,), the one before it of the same node, -1 for none.
    """

    head: IntArray
    following: IntArray


class Cursor(NamedTuple):
    """How many blocks, rows, rows of pairs and slots there are."""

    block: int
    row: int
    pair: int
    slot: int


class Packed(NamedTuple):
    """Rows that :func:`pack_windows` appends to the arrays of the same name of a layout."""

    blocks: IntArray
    nodes: IntArray
    ids: IntArray
    slots: IntArray
    pair_slots: IntArray


class _Gathered(NamedTuple):
    """The constraints of one window.

    `order` has its nodes, fewest constraints first; the constraints of node i are
    ids[begin[i]:begin[i + 1]], and `members` numbers their submaps within the window.
    """

    begin: IntArray
    order: IntArray
    ids: IntArray
    members: IntArray


@kernel
def link_constraints(first: int, index_b: IntArray, is_kept: BoolArray, chains: Chains) -> None:
    """Add the constraints from `first` on to the list of their node.

    Parameters
    ----------
    index_b : int64, shape (num_constraints,), nodes.
    is_kept : bool, shape (num_nodes,), nodes that are not packed.
    """
    head, following = chains.head, chains.following
    for c in range(first, index_b.size):
        node = index_b[c]
        if not is_kept[node]:
            following[c] = head[node]
            head[node] = c


@kernel
def measure_windows(windows: IntArray, chains: Chains) -> tuple[int, int, int, int]:
    """Return the most constraints of a window; how many blocks, rows, rows of pairs all need."""
    head, following = chains.head, chains.following
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
def _gather_window(window: int, chains: Chains, index_a: IntArray, out: _Gathered) -> int:
    """List the constraints of a window's nodes, by submap and then by age, and order its nodes.

    Returns how many nodes have constraints.
    """
    head, following = chains.head, chains.following
    out_begin, out_ids, out_order = out.begin, out.ids, out.order
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
def _number_submaps(count: int, index_a: IntArray, gathered: _Gathered, number_of: IntArray) -> int:
    """Number the submaps of a window's constraints from 0; return how many there are.

    `number_of` (num_submaps,) is -1 everywhere, before and after.
    """
    ids, members = gathered.ids, gathered.members
    num_members = 0
    for i in range(count):
        submap = index_a[ids[i]]
        if number_of[submap] < 0:
            number_of[submap] = num_members
            num_members += 1
        members[i] = number_of[submap]
    for i in range(count):
        number_of[index_a[ids[i]]] = -1
    return num_members


@kernel
def _with_room(ends: IntArray, count: int, room: int) -> IntArray:
    """Return the slots' ends, `count` in use, in an array with room for `room` more."""
    if count + room <= ends.shape[0]:
        return ends
    grown = np.empty((2 * count + room, 2), dtype=np.int64)
    for s in range(count):
        grown[s, 0] = ends[s, 0]
        grown[s, 1] = ends[s, 1]
    return grown


@kernel
def _fill_up(first_row: int, packed: Packed) -> None:
    """Repeat the first node of every block in the lanes that are left."""
    blocks, nodes, ids, slots = packed.blocks, packed.nodes, packed.ids, packed.slots
    for b in range(blocks.shape[0]):
        for lane in range(blocks[b, 2], LANES):
            nodes[b, lane] = nodes[b, 0]
            for row in range(blocks[b, 0] - first_row, blocks[b, 0] - first_row + blocks[b, 1]):
                ids[row, lane] = -1
                slots[row, lane] = slots[row, 0]


@kernel
def _pack_node(
    lane: int,
    of_node: int,
    num_rows: int,
    gathered: _Gathered,
    slot_of: IntArray,
    index_a: IntArray,
    first_slot: int,
    at: Cursor,
    slot_ends: IntArray,
    out: Packed,
) -> int:
    """Write the constraints and slots of a node into its lane; return the number of slots.

    Parameters
    ----------
    of_node, num_rows : int64, its constraints are number of_node, of_node + 1, ... as gathered.
    slot_of : int64, shape (num_members, num_members), slot of each pair of submaps, -1 for none.
    at : block, row and pair of its block; slots so far.
    """
    ids, members = gathered.ids, gathered.members
    row, pair, slot = at.row, at.pair, at.slot
    out_ids, out_slots, out_pair_slots = out.ids, out.slots, out.pair_slots
    for e in range(num_rows):
        b = members[of_node + e]
        for f in range(e + 1):  # f = e: the submap's own slot
            a = members[of_node + f]
            if slot_of[a, b] < 0:
                slot_ends[slot, 0] = index_a[ids[of_node + f]]
                slot_ends[slot, 1] = index_a[ids[of_node + e]]
                slot_of[a, b] = first_slot + slot
                slot += 1
            if f < e:
                out_pair_slots[pair, lane] = slot_of[a, b] if a != b else -1 - slot_of[a, b]
                pair += 1
            else:
                out_slots[row + e, lane] = slot_of[a, b]
                out_ids[row + e, lane] = ids[of_node + e]
    return slot


@kernel
def _pack_window(
    window: int,
    num_nodes: int,
    num_members: int,
    gathered: _Gathered,
    index_a: IntArray,
    first: Cursor,
    end: Cursor,
    slot_ends: IntArray,
    out: Packed,
) -> Cursor:
    """Lay out the nodes of a window behind `end`; return the new end."""
    block, row, pair, slot = end.block, end.row, end.pair, end.slot
    begin, order = gathered.begin, gathered.order
    out_blocks, out_nodes = out.blocks, out.nodes
    slot_of = filled(num_members * num_members, -1).reshape((num_members, num_members))
    lane = num_rows = 0
    for n in range(num_nodes):
        of_node = begin[order[n]]
        count = begin[order[n] + 1] - of_node
        if lane == LANES or count != num_rows:  # a new block
            lane, num_rows = 0, count
            out_blocks[block, 0] = first.row + row
            out_blocks[block, 1] = count
            out_blocks[block, 3] = first.pair + pair
            block += 1
            row += count
            pair += count * (count - 1) // 2
        out_nodes[block - 1, lane] = window * WINDOW + order[n]
        at = Cursor(block - 1, row - count, pair - count * (count - 1) // 2, slot)
        slot = _pack_node(
            lane, of_node, count, gathered, slot_of, index_a, first.slot, at, slot_ends, out
        )
        lane += 1
        out_blocks[block - 1, 2] = lane
    return Cursor(block, row, pair, slot)


@kernel
def pack_windows(
    windows: IntArray,
    chains: Chains,
    index_a: IntArray,
    num_submaps: int,
    most: int,
    first: Cursor,
    out: Packed,
) -> tuple[IntArray, IntArray]:
    """Lay out the constraints of some windows; all numbers written are counted from `first`.

    Parameters
    ----------
    windows : int64, shape (n,), which.
    index_a : int64, shape (num_constraints,), submaps.
    most : int64, of :func:`measure_windows`.
    first : what the layout already holds.

    Returns
    -------
    out_windows : int64, shape (n, 4): blocks and slots, from and to.
    slot_ends : int64, shape (num_slots, 2), submaps a <= b; a = b for the diagonal block of a.
    """
    out_windows = np.empty((windows.size, 4), dtype=np.int64)
    slot_ends = np.empty((256, 2), dtype=np.int64)
    gathered = _Gathered(
        np.empty(WINDOW + 1, dtype=np.int64),
        np.empty(WINDOW, dtype=np.int64),
        np.empty(most, dtype=np.int64),
        np.empty(most, dtype=np.int64),
    )
    number_of = filled(num_submaps, -1)
    end = Cursor(0, 0, 0, 0)
    for w in range(windows.size):
        num_nodes = _gather_window(windows[w], chains, index_a, gathered)
        count = gathered.begin[min(WINDOW, chains.head.size - windows[w] * WINDOW)]
        num_members = _number_submaps(count, index_a, gathered, number_of)
        slot_ends = _with_room(slot_ends, end.slot, num_members * (num_members + 1) // 2)
        out_windows[w, 0], out_windows[w, 2] = first.block + end.block, first.slot + end.slot
        end = _pack_window(
            windows[w], num_nodes, num_members, gathered, index_a, first, end, slot_ends, out
        )
        out_windows[w, 1], out_windows[w, 3] = first.block + end.block, first.slot + end.slot
    _fill_up(first.row, out)
    return out_windows, slot_ends[: end.slot]
