# SPDX-License-Identifier: Apache-2.0
"""The adjustment problem: poses, which of them are fixed, and constraints between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.kernels.pose_adjustment.residuals import Residuals, measure_residuals
from cartoloop.kernels.pose_adjustment.structure import first_vertex_of_component

ORIGIN = np.zeros((1, 3))
"""Pose of the map frame, the last vertex: control points are constraints from it."""


class Constraints(NamedTuple):
    """Measured relative poses of nodes, in the frame of a submap or of another node.

    Attributes
    ----------
    groups : int64, (n,), index into the losses.
    between_nodes : bool, (n,), whether a is a node (a *link*) instead of a submap.
    index_a, index_b : int64, (n,), submap or node a, node b.
    tf_a_b : float64, (n, 3) [m, m, rad], xi_ij of eq. (5).
    informations : float64, (n, 3, 3), Sigma^-1 of eq. (4), frame of a, symmetric.
    """

    groups: IntArray
    between_nodes: BoolArray
    index_a: IntArray
    index_b: IntArray
    tf_a_b: FloatArray
    informations: FloatArray


class ControlPoints(NamedTuple):
    """Measured positions or poses of nodes in the map frame: surveyed points, satellite fixes.

    Make them with :func:`control_points`.

    Attributes
    ----------
    groups : int64, (n,), index into the losses.
    nodes : int64, (n,).
    tf_map_node : float64, (n, 3) [m, m, rad].
    informations : float64, (n, 3, 3), map frame; zero for an angle that was not measured.
    """

    groups: IntArray
    nodes: IntArray
    tf_map_node: FloatArray
    informations: FloatArray


def control_points(
    nodes: ArrayLike, measured: ArrayLike, covariances: ArrayLike, group: int = 0
) -> ControlPoints:
    """Return control points from measurements with covariances.

    Parameters
    ----------
    nodes : shape (n,).
    measured : positions, shape (n, 2) [m], or poses, shape (n, 3) [m, m, rad], map frame.
    covariances : shape (n, 2, 2) or (n, 3, 3), map frame, or one of them for all.
    group : index into the losses.

    Raises
    ------
    ValueError
        If shapes differ, or a covariance is not symmetric and positive definite.
    """
    nodes = np.array(nodes, dtype=np.int64, ndmin=1)
    values = np.asarray(measured, dtype=np.float64).reshape(nodes.size, -1)
    size = values.shape[1] if nodes.size else 2
    if size not in {2, 3}:
        raise ValueError(f"a control point has 2 or 3 coordinates, not {size}")
    matrices = np.broadcast_to(np.asarray(covariances, dtype=np.float64), (nodes.size, size, size))
    if not (np.isfinite(values).all() and np.isfinite(matrices).all()):
        raise ValueError("a control point or its covariance is not finite")
    if not np.allclose(matrices, matrices.transpose(0, 2, 1)):
        raise ValueError("a covariance of a control point is not symmetric")
    if nodes.size and np.linalg.eigvalsh(matrices).min() <= 0.0:
        raise ValueError("a covariance of a control point is not positive definite")
    poses, informations = np.zeros((nodes.size, 3)), np.zeros((nodes.size, 3, 3))
    poses[:, :size] = values.reshape(nodes.size, size)
    inverse = np.linalg.inv(matrices)
    informations[:, :size, :size] = 0.5 * (inverse + inverse.transpose(0, 2, 1))
    return ControlPoints(np.full(nodes.size, group), nodes, poses, informations)


@dataclass(frozen=True, slots=True)
class Problem:
    """A pose adjustment: eq. (SPA), with links and control points.

    Vertices are numbered: submaps, then nodes, then the map frame.

    Attributes
    ----------
    submap_poses, node_poses : start, shapes (num_submaps, 3), (num_nodes, 3) [m, m, rad].
    constraints : submap to node, and node to node.
    control_points : absolute measurements of nodes; None for none.
    fixed_submaps, fixed_nodes : those that must not move.

    Notes
    -----
    A part of the graph with nothing fixed and no control point is held at its first submap (or
    node): its place in the map is not measured. A vertex without constraints stays where it is.
    """

    submap_poses: FloatArray
    node_poses: FloatArray
    constraints: Constraints
    control_points: ControlPoints | None = None
    fixed_submaps: Sequence[int] = ()
    fixed_nodes: Sequence[int] = ()

    @property
    def num_submaps(self) -> int:
        """How many submaps there are."""
        return len(self.submap_poses)

    @property
    def num_nodes(self) -> int:
        """How many nodes there are."""
        return len(self.node_poses)

    @property
    def map_frame(self) -> int:
        """The vertex of the map frame."""
        return self.num_submaps + self.num_nodes

    def poses(self) -> FloatArray:
        """Return a copy of the poses of all vertices, shape (num_vertices, 3)."""
        return np.concatenate((self.submap_poses, self.node_poses, ORIGIN))

    def ends(self, constraints: slice | IntArray = slice(None)) -> tuple[IntArray, IntArray]:
        """Return the vertices a and b of some constraints, or of all; control points left out."""
        m, all_of_them = self.num_submaps, self.constraints
        between_nodes = all_of_them.between_nodes[constraints]
        return (
            all_of_them.index_a[constraints] + np.where(between_nodes, m, 0),
            all_of_them.index_b[constraints] + m,
        )

    def check(self, first: int = 0) -> None:
        """Check the indices of the control points, and of the constraints from `first` on.

        Raises
        ------
        IndexError
            If one names a submap or a node that does not exist.
        """
        c = self.constraints
        if first < c.groups.size:
            self._check_constraints(first)
        nodes = () if self.control_points is None else self.control_points.nodes
        for node in (*nodes, *self.fixed_nodes):
            if not 0 <= node < self.num_nodes:
                raise IndexError(
                    f"node {node}, fixed or a control point, is none of {self.num_nodes} nodes"
                )

    def _check_constraints(self, first: int) -> None:
        c = self.constraints
        size_a = np.where(c.between_nodes[first:], self.num_nodes, self.num_submaps)
        wrong = (c.index_a[first:] < 0) | (c.index_a[first:] >= size_a)
        wrong |= (c.index_b[first:] < 0) | (c.index_b[first:] >= self.num_nodes)
        wrong |= c.groups[first:] < 0
        if wrong.any():
            raise IndexError(
                f"constraint {first + int(np.argmax(wrong))} has a negative group, or an end that "
                f"is none of {self.num_submaps} submaps and {self.num_nodes} nodes"
            )


class Measurements(NamedTuple):
    """All measurements of a problem: constraints, then control points.

    Attributes
    ----------
    groups : int64, (n,), index into the losses.
    vertex_a, vertex_b : int64, (n,), submaps, then nodes, then the map frame.
    tf_a_b : float64, (n, 3) [m, m, rad].
    informations : float64, (n, 3, 3), frame of a.
    """

    groups: IntArray
    vertex_a: IntArray
    vertex_b: IntArray
    tf_a_b: FloatArray
    informations: FloatArray

    @classmethod
    def of(cls, problem: Problem) -> Measurements:
        """Return the measurements of a problem; copies no constraint if it has no control point."""
        constraints, points = problem.constraints, problem.control_points
        own = cls(constraints.groups, *problem.ends(), constraints.tf_a_b, constraints.informations)
        if points is None:
            return own
        return cls(
            np.concatenate((own.groups, points.groups)),
            np.concatenate((own.vertex_a, np.full(points.nodes.size, problem.map_frame))),
            np.concatenate((own.vertex_b, problem.num_submaps + points.nodes)),
            np.concatenate((own.tf_a_b, points.tf_map_node)),
            np.concatenate((own.informations, points.informations)),
        )

    def residuals(self, poses: FloatArray) -> Residuals:
        """Return the residuals of all at poses of all vertices, shape (num_vertices, 3)."""
        out = Residuals(*np.empty((3, self.groups.size)))
        measure_residuals(poses, self.vertex_a, self.vertex_b, self.tf_a_b, self.informations, out)
        return out


def held_vertices(problem: Problem, vertex_a: IntArray, vertex_b: IntArray) -> BoolArray:
    """Return which vertices must stay: the fixed, and the first of each part without any.

    Parameters
    ----------
    vertex_a, vertex_b : shape (n,), pairs of vertices that connect the parts of the graph.
    """
    num_vertices = problem.map_frame + 1
    first = first_vertex_of_component(num_vertices, vertex_a, vertex_b)
    held = np.zeros(num_vertices, dtype=bool)
    held[list(problem.fixed_submaps)] = True
    held[[problem.num_submaps + node for node in problem.fixed_nodes]] = True
    held[problem.map_frame] = True
    anchored = np.zeros(num_vertices, dtype=bool)
    anchored[first[held]] = True
    held[first[~anchored[first]]] = True
    return held


def residuals(problem: Problem, constraints: IntArray | None = None) -> Residuals:
    """Return how much constraints are violated at the poses of a problem.

    Parameters
    ----------
    constraints : which, shape (n,); None for all. Control points are left out.
    """
    which: slice | IntArray = slice(None) if constraints is None else constraints
    vertex_a, vertex_b = problem.ends(which)
    out = Residuals(*np.empty((3, vertex_a.size)))
    measure_residuals(
        np.concatenate((problem.submap_poses, problem.node_poses)),
        vertex_a,
        vertex_b,
        problem.constraints.tf_a_b[which],
        problem.constraints.informations[which],
        out,
    )
    return out
