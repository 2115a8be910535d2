# SPDX-License-Identifier: Apache-2.0
"""The normal equations of sparse pose adjustment, reduced to the vertices worth keeping.

Vertices are numbered submaps first, then nodes. Each is *held* (gauge: fixed by the user, or the
first of a component nothing of which is fixed), *eliminated* (a node that hangs on submaps alone:
Schur complement) or *kept* (solved for by sparse Cholesky factorization).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cartoloop.global_slam.factorization import Factorization
from cartoloop.global_slam.packed_nodes import PackedNodes
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.kernels import kept_constraints, pose_residuals, schur_structure
from cartoloop.kernels.pose_residuals import LINEAR_SIZE

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_NONE = np.zeros(0, dtype=np.int64)


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


def kept_nodes(graph: PoseGraph) -> IntArray:
    """Return the nodes that cannot be eliminated one by one: tied to other nodes, or fixed."""
    is_kept = np.zeros(graph.num_nodes, dtype=bool)
    between_nodes = graph.kinds == ConstraintKind.NODE_TO_NODE
    is_kept[graph.index_a[between_nodes]] = True
    is_kept[graph.index_b[between_nodes]] = True
    is_kept[list(graph.fixed_nodes)] = True
    return np.flatnonzero(is_kept)


def measured_rows(graph: PoseGraph, constraints: IntArray) -> FloatArray:
    """Return constraints as :mod:`cartoloop.kernels.pose_residuals` reads them, shape (n, 9)."""
    rows = np.empty((constraints.size, pose_residuals.ROW_SIZE))
    informations = graph.informations.reshape(-1, 9)
    kept_constraints.fill_rows(constraints, graph.relative_poses, informations, rows)
    return rows


class ReducedSystem:
    """Linearises a pose graph's constraints, solves for a step and takes it; allocates once.

    Call :meth:`linearize`, :meth:`solve` and :meth:`move` in this order.

    Parameters
    ----------
    graph : what is adjusted.
    packed : the constraints of its nodes that can be eliminated.

    Attributes
    ----------
    loss_of_kind : which loss acts on which kind of constraint, shape (num_kinds,); may be written.
    """

    def __init__(self, graph: PoseGraph, packed: PackedNodes, loss_of_kind: IntArray) -> None:
        self.loss_of_kind = loss_of_kind.copy()
        self._packed = packed
        self._num_submaps = m = graph.num_submaps
        num_vertices = m + graph.num_nodes
        is_kept = np.zeros(graph.num_nodes, dtype=bool)
        is_kept[packed.kept_nodes] = True
        self._ids = np.flatnonzero(is_kept[graph.index_b]) if packed.kept_nodes.size else _NONE
        self._kinds = graph.kinds[self._ids]
        self._rows = measured_rows(graph, self._ids)
        between_nodes = self._kinds == ConstraintKind.NODE_TO_NODE
        self._vertex_a = graph.index_a[self._ids] + np.where(between_nodes, m, 0)
        self._vertex_b = graph.index_b[self._ids] + m
        self._choose_kept(graph)
        self._kept_a = self._kept_of_vertex[self._vertex_a]
        self._kept_b = self._kept_of_vertex[self._vertex_b]
        self._slot_blocks, self._edge_blocks, row_begin, columns = (
            schur_structure.couple_kept_vertices(
                self.kept.size,
                self._kept_of_vertex,
                packed.windows,
                packed.slot_ends,
                self._vertex_a,
                self._vertex_b,
            )
        )
        self._factorization = Factorization(row_begin, columns)
        self._linear = np.empty((self._ids.size, LINEAR_SIZE))
        self._weights = np.ones(self._ids.size)
        self._rotations = np.empty((num_vertices, 2))
        self._blocks = np.empty((self.kept.size + 1 + columns.size, 9))
        self._gradient = np.empty((self.kept.size + 1, 3))
        self._steps = np.zeros((self.kept.size + 1, 3))
        self._node_decrease, self._definite = 0.0, False

    def _choose_kept(self, graph: PoseGraph) -> None:
        """Decide which submaps, and which nodes that are not packed, are kept, and which held."""
        m, packed = self._num_submaps, self._packed
        slot_ends = schur_structure.slots_in_use(packed.windows, packed.slot_ends)
        # nodes that are packed connect nothing that these slots do not
        held = held_vertices(
            graph,
            np.concatenate((slot_ends[:, 0], self._vertex_a)),
            np.concatenate((slot_ends[:, 1], self._vertex_b)),
        )
        self._turning = np.concatenate((np.arange(m), m + packed.kept_nodes))
        self.kept = self._turning[~held[self._turning]]
        self._kept_of_vertex = np.full(held.size, self.kept.size, dtype=np.int64)
        self._kept_of_vertex[self.kept] = np.arange(self.kept.size)

    def linearize(
        self, poses: FloatArray, scale: float, damping: float = 0.0, *, eliminate: bool = True
    ) -> float:
        """Replace the constraints by quadratic models at these poses; return the cost (eq. SPA).

        Parameters
        ----------
        poses : of all vertices, shape (num_vertices, 3) [m, m, rad].
        scale : of the loss, in units of E.
        damping : share of the diagonal that is added to it (Marquardt).
        eliminate : False if only the cost and the weights are wanted: :meth:`solve` cannot follow.
        """
        kept_constraints.rotations_of(poses, self._turning, self._rotations)
        cost, self._node_decrease, self._definite = self._packed.linearize(
            poses,
            self._rotations[: self._num_submaps],
            self.loss_of_kind,
            scale,
            damping,
            eliminate,
        )
        cost += pose_residuals.linearize_constraints(
            poses,
            self._rotations,
            self._vertex_a,
            self._vertex_b,
            self._rows,
            self.loss_of_kind[self._kinds],
            scale,
            self._linear,
            self._weights,
        )
        return cost

    def solve(self, damping: float) -> tuple[float, bool]:
        """Solve the reduced normal equations for the step, damped as in :meth:`linearize`.

        Returns
        -------
        decrease : of the cost, as the (damped) quadratic model predicts it.
        definite : whether the system could be factored; if not, linearise with more damping.
        """
        if not self._definite:
            return 0.0, False
        self._blocks.fill(0.0)
        self._gradient.fill(0.0)
        packed = self._packed
        kept_constraints.sum_windows(
            packed.windows,
            packed.slot_ends,
            self._slot_blocks,
            packed.sums,
            self._blocks,
            self._gradient,
        )
        kept_constraints.add_kept_constraints(
            self._kept_a,
            self._kept_b,
            self._linear,
            self._edge_blocks,
            self._blocks,
            self._gradient,
        )
        decrease, definite = self._factorization.solve(
            self._blocks, self._gradient, damping, self._steps
        )
        return decrease + self._node_decrease, definite

    def move(self, poses: FloatArray, out_poses: FloatArray) -> None:
        """Write the poses after the step into `out_poses`, save those of vertices that are held.

        Parameters
        ----------
        poses : of the last call of :meth:`linearize`.
        out_poses : shape (num_vertices, 3).
        """
        m = self._num_submaps
        kept_constraints.move_vertices(poses, self.kept, self._steps, out_poses)
        self._packed.move(
            poses,
            self._rotations[:m],
            self._steps[self._kept_of_vertex[:m]],
            out_poses,
        )

    def weights(self, num_constraints: int) -> FloatArray:
        """Return rho' of all constraints as of the last linearisation."""
        weights = np.ones(num_constraints)
        self._packed.read_weights(weights)
        weights[self._ids] = self._weights
        return weights

    def set_weights(self, weights: FloatArray) -> None:
        """Set the weights of constraints whose loss is `GIVEN`; shape (num_constraints,)."""
        self._packed.set_weights(weights)
        self._weights[:] = weights[self._ids]
