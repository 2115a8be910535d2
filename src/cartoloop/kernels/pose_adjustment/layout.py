# SPDX-License-Identifier: Apache-2.0
"""How constraints lie in memory, eight side by side, so that one instruction works on eight.

A *row* holds one number of eight constraints, in eight *lanes*, for each of its columns::

    measured[row]   x0 x1 .. x7 | y0 y1 .. y7 | theta0 .. theta7 | xx0 .. xx7 | ... | tt0 .. tt7
                    column 0      column 1      column 2           column 3         column 8

Column c of lane i is number 8 c + i. Nodes that only submaps see are *packed*: a *block* is eight
nodes with equally many constraints. Row k of a block holds the k-th constraint of each node, by
submap. A block that is short of nodes repeats its first node in the remaining lanes::

    block, 3 rows    lane      0    1    2    3    4    5    6    7
                     node     17   20   21   33   40   17   17   17   (5 nodes, 3 repeated)
                     row 0    s2   s2   s2   s3   s3   s2   s2   s2   submap of the first constraint
                     row 1    s3   s3   s3   s4   s4   s3   s3   s3   of the second
                     row 2    s9   s9   s8   s9   s9   s9   s9   s9   of the third

A *window* is 256 consecutive nodes and the blocks that they fill. What its elimination leaves on
the submaps is summed in *slots* of the window's own, one for each submap that saw one of its nodes
and one for each pair of submaps that saw the same node::

    window w    blocks windows[w, 0] .. windows[w, 1]    slots windows[w, 2] .. windows[w, 3]
    slot        slot_ends = (s2, s2)  diagonal block of s2        (s2, s3)  block between s2 and s3

So windows do not depend on each other, and a window that gains constraints is packed again at the
end of the arrays, without a change to the others.
"""

from __future__ import annotations

from typing import NamedTuple

from cartoloop.arrays import FloatArray, IntArray

LANES = 8
"""Constraints side by side: a cache line of float64, one AVX-512 or two AVX2 registers."""
WINDOW = 256
"""Nodes of a window: enough to fill its blocks, few enough to be packed again at little cost."""
MEASURED = 9 * LANES
"""Numbers of a row of measurements: tf_a_b (x, y, theta), information (xx, xy, xt, yy, yt, tt)."""
LINEAR = 12 * LANES
"""Numbers of a row of quadratic models: d_x, d_y; b (3); A (xx, xy, xt, yy, yt, tt); E^2."""
FACTORED = 9 * LANES
"""Numbers of eight eliminated nodes: 1 / l_00, l_10, l_20, 1 / l_11, l_21, 1 / l_22 of L; v."""


class Rows(NamedTuple):
    """Constraints, eight to a row.

    Attributes
    ----------
    ids : int64, (num_rows, 8), the constraint of each lane; -1 where a lane only repeats another.
    groups : int64, (num_rows, 8), index into the losses.
    measured : float64, (num_rows, 72), see `MEASURED`.
    weights : float64, (num_rows, 8), rho' of the last linearisation, or as set by the caller.
    """

    ids: IntArray
    groups: IntArray
    measured: FloatArray
    weights: FloatArray


class Layout(NamedTuple):
    """The packed nodes and their constraints, see the module.

    Attributes
    ----------
    windows : int64, (num_windows, 4): blocks and slots, from and to.
    blocks : int64, (num_blocks, 4): first row, rows, nodes, first row of pairs.
    nodes : int64, (num_blocks, 8), the node of each lane.
    rows : the constraints; rows may be left over from earlier packings.
    slots : int64, (num_rows, 8), slot of the submap of each constraint.
    pair_slots : int64, (num_pairs, 8), slots of the pairs (0, 1), (0, 2), (1, 2), ... of a node's
        constraints; -1 - slot of the submap if one submap saw the node twice.
    slot_ends : int64, (num_slots, 2), submaps a <= b; a = b for the diagonal block of a.
    """

    windows: IntArray
    blocks: IntArray
    nodes: IntArray
    rows: Rows
    slots: IntArray
    pair_slots: IntArray
    slot_ends: IntArray


class Elimination(NamedTuple):
    """What the elimination of the packed nodes leaves.

    Attributes
    ----------
    factors : float64, (num_blocks, 72), of the nodes, see `FACTORED`.
    sums : float64, (num_slots, 9), left on the submaps: of diagonal blocks the upper half and the
        gradient, of others the whole block.
    slot_poses : float64, (num_slots, 5), scratch.
    """

    factors: FloatArray
    sums: FloatArray
    slot_poses: FloatArray


class DirectConstraints(NamedTuple):
    """Constraints whose two ends both stay in the reduced system: no node is eliminated.

    Attributes
    ----------
    rows : the constraints, eight to a row in the order of `vertex_a`.
    vertex_a, vertex_b : int64, (n,), their ends.
    place_of : int64, (num_rows, 8), number of the constraint of each lane, repeated ones included.
    places : float64, (n, 5), scratch.
    linear : float64, (num_rows, 96), their quadratic models, see `LINEAR`.
    """

    rows: Rows
    vertex_a: IntArray
    vertex_b: IntArray
    place_of: IntArray
    places: FloatArray
    linear: FloatArray


class GroupLosses(NamedTuple):
    """The loss of each group of constraints.

    Attributes
    ----------
    codes : int64, (num_groups,), see :class:`~cartoloop.kernels.pose_adjustment.losses.Loss`.
    scales : float64, (num_groups,), in units of the whitened residual E.
    """

    codes: IntArray
    scales: FloatArray
