# SPDX-License-Identifier: Apache-2.0
"""The normal equations of sparse pose adjustment, reduced to the vertices worth keeping.

Vertices are numbered submaps first, then nodes. Each is *held* (gauge: fixed by the user, or the
first of a component nothing of which is fixed), *eliminated* (a node that hangs on submaps alone:
Schur complement) or *kept* (solved for by sparse Cholesky factorization).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.kernels import (
    block_cholesky,
    cholesky_structure,
    pose_residuals,
    schur_complement,
    schur_structure,
)
from cartoloop.kernels.cholesky_ordering import minimum_degree
from cartoloop.kernels.pose_residuals import LINEAR_SIZE, ROW_SIZE

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_MAX_ZEROS_OF_A_FRONT = 8
"""Blocks of zeros that merging small fronts may store: 0 to 64 were tried on the public graphs."""


@dataclass(frozen=True)
class Fronts:
    """The plan of the factorization; see :mod:`cartoloop.kernels.cholesky_structure`."""

    order: IntArray
    group_begin: IntArray
    row_begin: IntArray
    rows: IntArray
    factor_begin: IntArray
    place_in_parent: IntArray
    num_children: IntArray
    target: IntArray
    stride: IntArray
    transposed: IntArray
    depth: IntArray
    even_size: int
    odd_size: int
    max_width: int


def plan_factorization(row_begin: IntArray, columns: IntArray) -> Fronts:
    """Return how to factor a system with these blocks above its diagonal.

    Parameters
    ----------
    row_begin : int64, shape (n + 1,).
    columns : int64, block columns of row k in columns[row_begin[k]:row_begin[k + 1]], all > k.
    """
    begin, neighbours = schur_structure.both_halves(row_begin, columns)
    order, group_begin, num_groups = minimum_degree(begin, neighbours)
    group_begin = group_begin[: num_groups + 1]
    front_begin, _, parent = cholesky_structure.front_rows(begin, neighbours, order, group_begin)
    order, group_begin = cholesky_structure.merge_small_fronts(
        order, group_begin, front_begin, parent, _MAX_ZEROS_OF_A_FRONT
    )
    front_begin, rows, parent = cholesky_structure.front_rows(begin, neighbours, order, group_begin)
    factor_begin, place_in_parent, num_children, depth, even_size, odd_size, max_width = (
        cholesky_structure.plan_fronts(group_begin, front_begin, rows, parent)
    )
    target, stride, transposed = cholesky_structure.place_blocks(
        row_begin, columns, order, group_begin, front_begin, rows, factor_begin
    )
    return Fronts(
        order,
        group_begin,
        front_begin,
        rows,
        factor_begin,
        place_in_parent,
        num_children,
        target,
        stride,
        transposed,
        depth,
        even_size,
        odd_size,
        max_width,
    )


def constraint_ends(graph: PoseGraph) -> tuple[IntArray, IntArray]:
    """Return the vertices a and b of every constraint, each of shape (num_constraints,)."""
    m = graph.num_submaps
    return (
        graph.index_a + np.where(graph.kinds == ConstraintKind.NODE_TO_NODE, m, 0),
        graph.index_b + m,
    )


def held_vertices(graph: PoseGraph, vertex_a: IntArray, vertex_b: IntArray) -> NDArray[np.bool_]:
    """Return which vertices must stay: the fixed, and the first of each part without any."""
    m = graph.num_submaps
    num_vertices = m + graph.num_nodes
    first = schur_structure.first_vertex_of_component(num_vertices, vertex_a, vertex_b)
    held = np.zeros(num_vertices, dtype=bool)
    held[list(graph.fixed_submaps)] = True
    held[[m + node for node in graph.fixed_nodes]] = True
    anchored = np.zeros(num_vertices, dtype=bool)
    anchored[first[held]] = True
    held[first[~anchored[first]]] = True
    return held


def _aligned(size: int) -> FloatArray:
    """Return an uninitialised array that begins a cache line: factorization is twice as fast."""
    numbers = np.empty(size + 7)
    first = -(numbers.ctypes.data // 8) % 8
    return numbers[first : first + size]


class ReducedSystem:
    """Linearises a pose graph's constraints, solves for a step and takes it; allocates once.

    Call :meth:`linearize`, :meth:`reduce`, :meth:`solve` and :meth:`move` in this order.

    Attributes
    ----------
    order : which constraint of the graph each of ours is, shape (num_constraints,).
    rows : ours, see :mod:`cartoloop.kernels.pose_residuals`; the last column may be written to.
    losses : which loss acts on each of ours.
    weights : rho' of each of ours, as of the last evaluation.
    """

    def __init__(self, graph: PoseGraph, loss_of_kind: IntArray) -> None:
        vertex_a, vertex_b = constraint_ends(graph)
        self._classify(graph, vertex_a, vertex_b)
        begin, order, kept_order = schur_structure.sort_by_node(
            vertex_a, vertex_b, self._eliminated_of_vertex, self._kept_of_vertex, self.nodes.size
        )
        self._begin = begin
        self._split = order.size
        self.order = np.concatenate((order, kept_order))
        count = self.order.size
        self.rows = np.empty((count, ROW_SIZE))
        self.losses = np.empty(count, dtype=np.int64)
        self._vertex_a = np.empty(count, dtype=np.int64)
        self._vertex_b = np.empty(count, dtype=np.int64)
        schur_structure.pack_constraints(
            self.order,
            vertex_a,
            vertex_b,
            graph.kinds,
            graph.relative_poses,
            graph.informations.reshape(-1, 9),
            loss_of_kind,
            self._vertex_a,
            self._vertex_b,
            self.rows,
            self.losses,
        )
        kept_a = self._kept_of_vertex[self._vertex_a]
        self._node_kept_a, self._kept_a = kept_a[: self._split], kept_a[self._split :]
        self._kept_b = self._kept_of_vertex[self._vertex_b[self._split :]]
        self._pair_slots, self._slots, row_begin, columns = schur_structure.couple_kept_vertices(
            self.kept.size, begin, self._node_kept_a, self._kept_a, self._kept_b
        )
        self._fronts = plan_factorization(row_begin, columns)
        self._allocate(graph.num_submaps + graph.num_nodes, columns.size)

    def _classify(self, graph: PoseGraph, vertex_a: IntArray, vertex_b: IntArray) -> None:
        """Decide which vertices are held, kept and eliminated."""
        m = graph.num_submaps
        num_vertices = m + graph.num_nodes
        held = held_vertices(graph, vertex_a, vertex_b)
        tied = np.zeros(num_vertices, dtype=bool)
        tied[:m] = True
        between_nodes = graph.kinds == ConstraintKind.NODE_TO_NODE
        tied[vertex_a[between_nodes]] = True
        tied[vertex_b[between_nodes]] = True
        self.kept = np.flatnonzero(tied & ~held)
        self.nodes = np.flatnonzero(~tied & ~held)
        self._kept_of_vertex = np.full(num_vertices, self.kept.size, dtype=np.int64)
        self._kept_of_vertex[self.kept] = np.arange(self.kept.size)
        self._eliminated_of_vertex = np.full(num_vertices, -1, dtype=np.int64)
        self._eliminated_of_vertex[self.nodes] = np.arange(self.nodes.size)
        self._turning = np.flatnonzero(tied | held)

    def _allocate(self, num_vertices: int, num_couplings: int) -> None:
        num_kept, fronts = self.kept.size, self._fronts
        most = int(np.diff(self._begin).max(initial=1))
        self._squared = np.empty(self.order.size)
        self._linear = np.empty((self.order.size, LINEAR_SIZE))
        self._rotations = np.empty((num_vertices, 2))
        self._blocks = np.empty((num_kept + 1 + num_couplings, 9))
        self._gradient = np.empty((num_kept + 1, 3))
        self._steps = np.zeros((num_kept + 1, 3))
        self._couplings = np.empty((most, 9))
        self._node_factors = np.empty((self.nodes.size, 9))
        self.weights = np.ones(self.order.size)
        self._factor = _aligned(int(fronts.factor_begin[-1]))
        self._diagonal = np.empty((num_kept, 3))
        self._even_stack = _aligned(fronts.even_size)
        self._odd_stack = _aligned(fronts.odd_size)
        self._waiting = np.empty(fronts.num_children.size, dtype=np.int64)
        self._scratch = np.empty(3 * fronts.max_width)
        self._damping = 0.0
        self._node_decrease = 0.0

    def squared_residuals(self, poses: FloatArray) -> FloatArray:
        """Return E^2 (eq. 4) of each of our constraints; valid until the next call."""
        schur_complement.rotations_of(poses, self._turning, self._rotations)
        pose_residuals.squared_residuals(
            poses, self._rotations, self._vertex_a, self._vertex_b, self.rows, self._squared
        )
        return self._squared

    def linearize(self, poses: FloatArray, scale: float) -> float:
        """Replace the constraints by quadratic models at these poses; return the cost (eq. SPA).

        Parameters
        ----------
        poses : of all vertices, shape (num_vertices, 3) [m, m, rad].
        scale : of the loss, in units of E.
        """
        schur_complement.rotations_of(poses, self._turning, self._rotations)
        return pose_residuals.linearize_constraints(
            poses,
            self._rotations,
            self._vertex_a,
            self._vertex_b,
            self.rows,
            self.losses,
            scale,
            self._linear,
            self.weights,
        )

    def reduce(self, damping: float) -> bool:
        """Build the reduced normal equations of the linearised constraints.

        Parameters
        ----------
        damping : share of the diagonal that is added to it (Marquardt).

        Returns
        -------
        definite : whether every eliminated node could be factored; if not, damp more.
        """
        self._blocks.fill(0.0)
        self._gradient.fill(0.0)
        self._damping = damping
        self._node_decrease, definite = schur_complement.eliminate_nodes(
            self._begin,
            self._node_kept_a,
            self._linear[: self._split],
            damping,
            self._pair_slots,
            self._couplings,
            self._blocks,
            self._gradient,
            self._node_factors,
        )
        schur_complement.add_kept_constraints(
            self._kept_a,
            self._kept_b,
            self._linear[self._split :],
            self._slots,
            self._blocks,
            self._gradient,
        )
        return definite

    def solve(self) -> tuple[float, bool]:
        """Solve the reduced normal equations for the step.

        Returns
        -------
        decrease : of the cost, as the (damped) quadratic model predicts it.
        definite : whether the system could be factored; if not, damp more.
        """
        fronts = self._fronts
        block_cholesky.assemble_blocks(
            self._blocks,
            self.kept.size,
            self._damping,
            fronts.target,
            fronts.stride,
            fronts.transposed,
            self._factor,
            self._diagonal,
        )
        if not block_cholesky.factor_fronts(
            fronts.order,
            fronts.group_begin,
            fronts.row_begin,
            fronts.place_in_parent,
            fronts.num_children,
            fronts.depth,
            fronts.factor_begin,
            self._diagonal,
            self._even_stack,
            self._odd_stack,
            self._waiting,
            self._factor,
        ):
            return 0.0, False
        decrease = block_cholesky.solve_fronts(
            fronts.order,
            fronts.group_begin,
            fronts.row_begin,
            fronts.rows,
            fronts.factor_begin,
            self._factor,
            self._gradient,
            self._scratch,
            self._steps,
        )
        return decrease + self._node_decrease, True

    def move(self, poses: FloatArray, out_poses: FloatArray) -> None:
        """Write the poses after the step into `out_poses`, save those of vertices that are held."""
        schur_complement.move_vertices(
            poses,
            self.kept,
            self._steps,
            self.nodes,
            self._begin,
            self._node_kept_a,
            self._linear,
            self._node_factors,
            out_poses,
        )
