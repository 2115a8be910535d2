# SPDX-License-Identifier: Apache-2.0
"""The pose graph: nodes, submaps and the constraints between them (section V). Data only.

A constraint is a measured relative pose: `relative_pose` is tf_a_b and `information` the inverse of
its covariance in the frame of a, Sigma^-1 of eq. (4). What the paper
calls scan poses are the poses of the nodes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.growing_array import GrowingArray
from cartoloop.kernels import constraint_faults as faults

_ASYMMETRY = 1e-9  # what rounding leaves between two halves of one information matrix

TRUE_TRANSLATION_M, TRUE_ROTATION_RAD = 0.2, math.radians(1.0)
"""A loop closure with a larger residual after adjustment counts as false (section VI, table IV)."""


NO_ROW = -1
"""Row of a constraint that is no loop closure."""


class ConstraintKind(IntEnum):
    """What a constraint connects, and how it came about."""

    INTRA_SUBMAP = 0
    """Submap (a) to a node (b) that was inserted into it."""
    LOOP_CLOSURE = 1
    """Submap (a) to a node (b) that was found in it by search or by the last pass; may be false."""
    NODE_TO_NODE = 2
    """Node (a) to node (b): odometry, and graphs without submaps."""


class ClosureConstraints(NamedTuple):
    """Loop closures that are to join a graph.

    Attributes
    ----------
    row : int, shape (n,), rows in the record of closures.
    submap, node : int, shape (n,).
    tf_submap_node : float64, shape (n, 3), as measured [m, m, rad].
    information : float64, shape (n, 3, 3), inverse covariance, submap axes.
    """

    row: NDArray[np.integer]
    submap: NDArray[np.integer]
    node: NDArray[np.integer]
    tf_submap_node: FloatArray
    information: FloatArray


class PoseGraph:
    """Poses of nodes and submaps in the map frame, and constraints as a structure of arrays.

    Everything is added at the end and keeps its index. The arrays handed out are views: they may
    be written to, and are valid until the next addition of their sort.
    """

    def __init__(self) -> None:
        self._node_poses = GrowingArray((3,), np.float64)
        self._submap_poses = GrowingArray((3,), np.float64)
        self._kinds = GrowingArray((), np.int64)
        self._index_a = GrowingArray((), np.int64)
        self._index_b = GrowingArray((), np.int64)
        self._relative_poses = GrowingArray((3,), np.float64)
        self._informations = GrowingArray((3, 3), np.float64)
        self._closure_rows = GrowingArray((), np.int32)
        self._is_trusted = GrowingArray((), np.bool_)
        self._num_loop_closures = 0
        self._revision = 0
        self._fixed_nodes: list[int] = []
        self._fixed_submaps: list[int] = []

    @property
    def num_nodes(self) -> int:
        """Number of nodes."""
        return len(self._node_poses)

    @property
    def num_submaps(self) -> int:
        """Number of submaps."""
        return len(self._submap_poses)

    @property
    def num_constraints(self) -> int:
        """Number of constraints."""
        return len(self._kinds)

    @property
    def num_loop_closures(self) -> int:
        """Number of loop closures among them."""
        return self._num_loop_closures

    @property
    def node_poses(self) -> FloatArray:
        """tf_map_node of every node, shape (num_nodes, 3) [m, m, rad]."""
        return self._node_poses.view

    @property
    def submap_poses(self) -> FloatArray:
        """tf_map_submap of every submap, shape (num_submaps, 3) [m, m, rad]."""
        return self._submap_poses.view

    @property
    def kinds(self) -> IntArray:
        """:class:`ConstraintKind` of every constraint, shape (num_constraints,)."""
        return self._kinds.view

    @property
    def index_a(self) -> IntArray:
        """Submap index, or node index where the kind is NODE_TO_NODE, shape (num_constraints,)."""
        return self._index_a.view

    @property
    def index_b(self) -> IntArray:
        """Node index, shape (num_constraints,)."""
        return self._index_b.view

    @property
    def relative_poses(self) -> FloatArray:
        """tf_a_b as measured, xi_ij of eq. (5), shape (num_constraints, 3) [m, m, rad]."""
        return self._relative_poses.view

    @property
    def informations(self) -> FloatArray:
        """Sigma^-1 of eq. (4), frame of a, (num_constraints, 3, 3) [1/m^2, 1/(m rad), 1/rad^2]."""
        return self._informations.view

    @property
    def closure_rows(self) -> NDArray[np.int32]:
        """Row of each loop closure in the record of closures; -1 for other constraints."""
        return self._closure_rows.view

    @property
    def is_trusted(self) -> NDArray[np.bool_]:
        """Which constraints no robust loss weakens, though their kind has one."""
        return self._is_trusted.view

    @property
    def revision(self) -> int:
        """Rises when constraints are removed or replaced; not when they are added."""
        return self._revision

    @property
    def fixed_nodes(self) -> Sequence[int]:
        """Nodes that adjustment must not move."""
        return tuple(self._fixed_nodes)

    @property
    def fixed_submaps(self) -> Sequence[int]:
        """Submaps that adjustment must not move."""
        return tuple(self._fixed_submaps)

    def add_node(self, tf_map_node: ArrayLike) -> int:
        """Add a node at this pose (3,) and return its index."""
        self._node_poses.append(tf_map_node)
        return self.num_nodes - 1

    def add_nodes(self, tf_map_node: ArrayLike) -> int:
        """Add nodes at these poses (n, 3) and return the index of the first."""
        first = self.num_nodes
        self._node_poses.extend(np.asarray(tf_map_node, dtype=np.float64).reshape(-1, 3))
        return first

    def add_submap(self, tf_map_submap: ArrayLike) -> int:
        """Add a submap at this pose (3,) and return its index."""
        self._submap_poses.append(tf_map_submap)
        return self.num_submaps - 1

    def add_submaps(self, tf_map_submap: ArrayLike) -> int:
        """Add submaps at these poses (n, 3) and return the index of the first."""
        first = self.num_submaps
        self._submap_poses.extend(np.asarray(tf_map_submap, dtype=np.float64).reshape(-1, 3))
        return first

    def fix_node(self, node: int) -> None:
        """Hold a node where it is in every adjustment."""
        if not 0 <= node < self.num_nodes:
            raise IndexError(f"node {node} is not in the graph of {self.num_nodes} nodes")
        if node not in self._fixed_nodes:
            self._fixed_nodes.append(node)

    def fix_submap(self, submap: int) -> None:
        """Hold a submap where it is in every adjustment."""
        if not 0 <= submap < self.num_submaps:
            raise IndexError(f"submap {submap} is not in the graph of {self.num_submaps} submaps")
        if submap not in self._fixed_submaps:
            self._fixed_submaps.append(submap)

    def hold_only(self, submaps: Iterable[int], nodes: Iterable[int]) -> None:
        """Hold these where they are in every adjustment, and release all others."""
        self._fixed_submaps, self._fixed_nodes = [], []
        for submap in submaps:
            self.fix_submap(submap)
        for node in nodes:
            self.fix_node(node)

    def add_constraint(
        self,
        kind: ConstraintKind,
        index_a: int,
        index_b: int,
        tf_a_b: ArrayLike,
        information: ArrayLike,
        *,
        closure_row: int = NO_ROW,
    ) -> int:
        """Add one constraint and return its index; see :meth:`add_constraints`."""
        return self.add_constraints(
            np.array([kind], dtype=np.int64),
            np.array([index_a], dtype=np.int64),
            np.array([index_b], dtype=np.int64),
            np.asarray(tf_a_b, dtype=np.float64).reshape(1, 3),
            np.asarray(information, dtype=np.float64).reshape(1, 3, 3),
            closure_rows=closure_row,
        )

    def add_constraints(
        self,
        kinds: ArrayLike,
        index_a: ArrayLike,
        index_b: ArrayLike,
        tf_a_b: ArrayLike,
        informations: ArrayLike,
        *,
        closure_rows: ArrayLike = NO_ROW,
        is_trusted: ArrayLike = False,
    ) -> int:
        """Add constraints and return the index of the first.

        Parameters
        ----------
        kinds : :class:`ConstraintKind` of each, shape (n,), or one for all.
        index_a : submap, or node where the kind is NODE_TO_NODE, shape (n,).
        index_b : node, shape (n,).
        tf_a_b : where b was seen from a, shape (n, 3) [m, m, rad].
        informations : symmetric, shape (n, 3, 3), in the frame of a.
        closure_rows : row of each in the record of closures, shape (n,), or one for all.
        is_trusted : see :attr:`is_trusted`, shape (n,), or one for all.

        Raises
        ------
        IndexError
            If a constraint names a submap or a node that is not in the graph.
        ValueError
            If the columns differ in length, a pose or an information matrix is not finite, or a
            matrix not symmetric or with a negative diagonal, or a node is constrained to itself.
        """
        index_a = np.array(index_a, dtype=np.int64, ndmin=1)
        index_b = np.array(index_b, dtype=np.int64, ndmin=1)
        kinds = _filled(kinds, index_a)
        relative_poses = np.array(tf_a_b, dtype=np.float64, order="C").reshape(-1, 3)
        matrices = np.array(informations, dtype=np.float64, order="C").reshape(-1, 3, 3)
        if not len(index_a) == len(index_b) == len(relative_poses) == len(matrices):
            raise ValueError("the columns of the constraints are not of one length")
        self._check(kinds, index_a, index_b, relative_poses, matrices)
        first = self.num_constraints
        self._num_loop_closures += int(np.count_nonzero(kinds == int(ConstraintKind.LOOP_CLOSURE)))
        self._kinds.extend(kinds)
        self._index_a.extend(index_a)
        self._index_b.extend(index_b)
        self._relative_poses.extend(relative_poses)
        self._informations.extend(matrices)
        self._closure_rows.grow(len(kinds))[:] = closure_rows
        self._is_trusted.grow(len(kinds))[:] = is_trusted
        return first

    def add_loop_closures(self, closures: ClosureConstraints, *, are_trusted: bool = False) -> None:
        """Add loop closures; raises as :meth:`add_constraints` does.

        Parameters
        ----------
        are_trusted : see :attr:`is_trusted`.
        """
        self.add_constraints(
            ConstraintKind.LOOP_CLOSURE,
            closures.submap,
            closures.node,
            closures.tf_submap_node,
            closures.information,
            closure_rows=closures.row,
            is_trusted=are_trusted,
        )

    def copy(self) -> PoseGraph:
        """Return a copy that does not change when this graph does."""
        return self.without(np.zeros(self.num_constraints, dtype=bool))

    def remove(self, constraints: NDArray[np.bool_]) -> None:
        """Remove the constraints marked, shape (num_constraints,)."""
        self._adopt_constraints(self.without(constraints))

    def replace_loop_closures(self, closures: Iterable[ClosureConstraints]) -> None:
        """Replace the loop closures by others; if that raises, the graph is unchanged."""
        replaced = self.without(self.kinds == ConstraintKind.LOOP_CLOSURE)
        for some in closures:
            replaced.add_loop_closures(some)
        self._adopt_constraints(replaced)

    def without(self, constraints: NDArray[np.bool_]) -> PoseGraph:
        """Return a copy that lacks the constraints marked, shape (num_constraints,)."""
        kept = ~constraints
        graph = PoseGraph()
        graph.add_submaps(self.submap_poses)
        graph.add_nodes(self.node_poses)
        graph._fixed_submaps = list(self._fixed_submaps)
        graph._fixed_nodes = list(self._fixed_nodes)
        graph.add_constraints(
            self.kinds[kept],
            self.index_a[kept],
            self.index_b[kept],
            self.relative_poses[kept],
            self.informations[kept],
            closure_rows=self.closure_rows[kept],
            is_trusted=self.is_trusted[kept],
        )
        return graph

    def _adopt_constraints(self, other: PoseGraph) -> None:
        """Take over the constraints of a graph that is dropped afterwards."""
        self._kinds, self._index_a, self._index_b = other._kinds, other._index_a, other._index_b
        self._relative_poses, self._informations = other._relative_poses, other._informations
        self._closure_rows, self._is_trusted = other._closure_rows, other._is_trusted
        self._num_loop_closures = other._num_loop_closures
        self._revision += 1

    def _check(
        self,
        kinds: IntArray,
        index_a: IntArray,
        index_b: IntArray,
        relative_poses: FloatArray,
        informations: FloatArray,
    ) -> None:
        fault = faults.first_fault(
            kinds,
            index_a,
            index_b,
            relative_poses,
            informations,
            self.num_nodes,
            self.num_submaps,
            int(ConstraintKind.NODE_TO_NODE),
            _ASYMMETRY,
        )
        if fault == faults.NO_START:
            raise IndexError(
                f"a constraint starts at no vertex of the graph ({self.num_submaps} submaps, "
                f"{self.num_nodes} nodes): add the vertex first"
            )
        if fault == faults.NO_END:
            raise IndexError(
                f"a constraint ends at no node of the graph ({self.num_nodes} nodes): "
                "add the node first"
            )
        if fault in _FAULTS:
            raise ValueError(_FAULTS[fault])


_FAULTS = {
    faults.SAME_NODE: "a constraint connects a node with itself",
    faults.NOT_FINITE: "a constraint holds a number that is not finite",
    faults.NOT_SYMMETRIC: "an information matrix is not symmetric",
    faults.NEGATIVE: "an information matrix has a negative diagonal",
}


def _filled(values: ArrayLike, like: IntArray) -> IntArray:
    filled = np.empty_like(like)
    filled[:] = values
    return filled
