# SPDX-License-Identifier: Apache-2.0
"""The plan of an adjustment: what follows from which vertices are connected, and all buffers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.kernels import sparse_cholesky
from cartoloop.kernels.pose_adjustment.layout import (
    LANES,
    LINEAR,
    MEASURED,
    DirectConstraints,
    Elimination,
    Layout,
    Rows,
)
from cartoloop.kernels.pose_adjustment.rows import fill_rows, read_weights
from cartoloop.kernels.pose_adjustment.structure import couple_vertices, slots_in_use
from cartoloop.pose_adjustment.packed_nodes import PackedNodes
from cartoloop.pose_adjustment.problem import Problem, held_vertices


class Vertices(NamedTuple):
    """What becomes of the vertices: *held* (fixed), *eliminated*, or *kept* (solved for).

    Attributes
    ----------
    kept : int64, (num_kept,), ascending.
    row_of_vertex : int64, (num_vertices,), row in the reduced system; num_kept for all others.
    starts : int64, vertices at which constraints start: their rotations are needed.
    """

    kept: IntArray
    row_of_vertex: IntArray
    starts: IntArray


class ReducedSystem(NamedTuple):
    """The normal equations of the kept vertices, and how to factor them.

    Attributes
    ----------
    slot_blocks : int64, (num_slots,), block that each slot of the packed nodes is added to.
    edge_blocks : int64, (num_direct,), block between the two ends of each direct constraint.
    blocks : float64, (num_blocks, 9), see :func:`cartoloop.kernels.sparse_cholesky.solve`.
    gradient, steps : float64, (num_kept + 1, 3); the last row is that of the held vertices.
    cholesky, workspace : plan and buffers of the factorization.
    """

    slot_blocks: IntArray
    edge_blocks: IntArray
    blocks: FloatArray
    gradient: FloatArray
    steps: FloatArray
    cholesky: sparse_cholesky.Plan
    workspace: sparse_cholesky.Workspace


@dataclass(slots=True)
class Plan:
    """How a problem is solved. Poses and losses may change; constraints and fixed poses may not.

    Attributes
    ----------
    problem : the problem to solve.
    layout, elimination : the nodes that are eliminated.
    direct : the constraints between two vertices that are both not eliminated.
    vertices : which vertices are kept.
    reduced : the system of these.
    num_groups : groups of constraints: each needs a loss.
    rotations : float64, (num_vertices, 2), cosines and sines as of the last linearisation.
    num_passes : how often it was linearised: a result is valid until the next pass.
    """

    problem: Problem
    layout: Layout
    elimination: Elimination
    direct: DirectConstraints
    vertices: Vertices
    reduced: ReducedSystem
    num_groups: int
    rotations: FloatArray
    num_passes: int = 0

    @property
    def has_direct(self) -> bool:
        """Whether there are constraints between vertices that are both kept: in few maps."""
        return self.direct.vertex_a.size > 0

    @property
    def num_weights(self) -> int:
        """How many constraints and control points there are."""
        points = self.problem.control_points
        return self.problem.constraints.groups.size + (0 if points is None else points.nodes.size)

    def weights(self) -> FloatArray:
        """Return rho' as of the last linearisation: constraints, then control points."""
        weights = np.ones(self.num_weights)
        read_weights(self.layout, weights)
        rows = self.direct.rows
        weights[rows.ids[rows.ids >= 0]] = rows.weights[rows.ids >= 0]
        return weights

    def set_weights(self, weights: FloatArray) -> None:
        """Set the weights of groups with `FIXED_WEIGHTS`; constraints, then control points."""
        for rows in (self.layout.rows, self.direct.rows):
            rows.weights[:] = np.where(rows.ids < 0, 1.0, weights[rows.ids])


class Planner:
    """Plans problems that grow from one to the next; packed constraints stay packed.

    Constraints may be added at the end of a problem; those that it has must stay as they are.
    """

    def __init__(self) -> None:
        self._packed = PackedNodes(np.zeros(0, dtype=np.int64))

    def plan(self, problem: Problem) -> Plan:
        """Return the plan of a problem; earlier plans become invalid."""
        problem.check(self._packed.num_constraints)
        points = problem.control_points
        kept_nodes = _kept_nodes(problem)
        if not np.array_equal(kept_nodes, self._packed.kept_nodes):
            self._packed = PackedNodes(kept_nodes)
        packed = self._packed
        packed.extend(problem)
        layout, direct = packed.layout, _direct_constraints(problem, kept_nodes)
        vertices = _vertices(problem, kept_nodes, layout, direct)
        return Plan(
            problem=problem,
            layout=layout,
            elimination=packed.elimination,
            direct=direct,
            vertices=vertices,
            reduced=_reduced_system(vertices, layout, direct),
            num_groups=max(
                packed.num_groups,
                0 if points is None else 1 + int(points.groups.max(initial=-1)),
            ),
            rotations=np.empty((problem.map_frame + 1, 2)),
        )


_NO_ROWS = np.empty((0, LANES), dtype=np.int64)
_NONE = DirectConstraints(
    Rows(_NO_ROWS, _NO_ROWS, np.empty((0, MEASURED)), np.empty((0, LANES))),
    np.empty(0, dtype=np.int64),
    np.empty(0, dtype=np.int64),
    _NO_ROWS,
    np.empty((0, 5)),
    np.empty((0, LINEAR)),
)


def plan(problem: Problem) -> Plan:
    """Return the plan of a problem."""
    return Planner().plan(problem)


def _kept_nodes(problem: Problem) -> IntArray:
    """Return the nodes that cannot be eliminated one by one: linked, measured in the map, fixed."""
    constraints, points = problem.constraints, problem.control_points
    is_kept = np.zeros(problem.num_nodes, dtype=bool)
    is_kept[constraints.index_a[constraints.between_nodes]] = True
    is_kept[constraints.index_b[constraints.between_nodes]] = True
    is_kept[list(problem.fixed_nodes)] = True
    if points is not None:
        is_kept[points.nodes] = True
    return np.flatnonzero(is_kept)


def _direct_constraints(problem: Problem, kept_nodes: IntArray) -> DirectConstraints:
    """Return the constraints and control points of the kept nodes, as rows."""
    if kept_nodes.size == 0:
        return _NONE
    constraints, points = problem.constraints, problem.control_points
    is_kept = np.zeros(problem.num_nodes, dtype=bool)
    is_kept[kept_nodes] = True
    ids = np.flatnonzero(is_kept[constraints.index_b])
    vertex_a, vertex_b = problem.ends(ids)
    groups, tf_a_b = constraints.groups[ids], constraints.tf_a_b[ids]
    informations = constraints.informations[ids]
    if points is not None:
        ids = np.concatenate((ids, constraints.groups.size + np.arange(points.nodes.size)))
        vertex_a = np.concatenate((vertex_a, np.full(points.nodes.size, problem.map_frame)))
        vertex_b = np.concatenate((vertex_b, problem.num_submaps + points.nodes))
        groups = np.concatenate((groups, points.groups))
        tf_a_b = np.concatenate((tf_a_b, points.tf_map_node))
        informations = np.concatenate((informations, points.informations))
    num_rows = -(-ids.size // LANES)
    local = np.full((num_rows, LANES), -1)
    local.ravel()[: ids.size] = np.arange(ids.size)
    rows = Rows(
        np.where(local < 0, -1, ids[local]),
        np.empty((num_rows, LANES), dtype=np.int64),
        np.empty((num_rows, MEASURED)),
        np.ones((num_rows, LANES)),
    )
    fill_rows(local, groups, tf_a_b, informations.reshape(-1, 9), rows.measured, rows.groups)
    place_of = np.where(local < 0, local[:, :1], local)
    return DirectConstraints(
        rows, vertex_a, vertex_b, place_of, np.empty((ids.size, 5)), np.empty((num_rows, LINEAR))
    )


def _vertices(
    problem: Problem, kept_nodes: IntArray, layout: Layout, direct: DirectConstraints
) -> Vertices:
    m, frame = problem.num_submaps, problem.map_frame
    ends = slots_in_use(layout)  # eliminated nodes connect nothing that these slots do not
    held = held_vertices(
        problem,
        np.concatenate((ends[:, 0], direct.vertex_a)),
        np.concatenate((ends[:, 1], direct.vertex_b)),
    )
    starts = np.concatenate((np.arange(m), m + kept_nodes, (frame,)))
    kept = starts[~held[starts]]
    row_of_vertex = np.full(held.size, kept.size, dtype=np.int64)
    row_of_vertex[kept] = np.arange(kept.size)
    return Vertices(kept, row_of_vertex, starts)


def _reduced_system(vertices: Vertices, layout: Layout, direct: DirectConstraints) -> ReducedSystem:
    num_kept = vertices.kept.size
    slot_blocks, edge_blocks, row_begin, columns = couple_vertices(
        num_kept, vertices.row_of_vertex, layout, direct.vertex_a, direct.vertex_b
    )
    cholesky = sparse_cholesky.plan(row_begin, columns)
    return ReducedSystem(
        slot_blocks=slot_blocks,
        edge_blocks=edge_blocks,
        blocks=np.empty((num_kept + 1 + columns.size, 9)),
        gradient=np.empty((num_kept + 1, 3)),
        steps=np.zeros((num_kept + 1, 3)),
        cholesky=cholesky,
        workspace=sparse_cholesky.workspace(cholesky),
    )
