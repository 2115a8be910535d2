# SPDX-License-Identifier: Apache-2.0
"""A pose graph with a start, in the form in which all programs get it."""

from __future__ import annotations

import gc
from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter
from typing import NamedTuple, Protocol

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.global_slam.pose_adjustment import (
    AdjustmentOptions,
    PoseAdjuster,
    adjust,
    constraint_ends,
    held_of,
)
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.pose_adjustment import Loss, scale_of


class Solve(NamedTuple):
    """The cost of one adjustment: `seconds` of solving alone, and linear systems solved."""

    seconds: float
    iterations: int


class Program(Protocol):
    """A program that adjusts one problem repeatedly, from the same start."""

    def solve(self) -> Solve:
        """Adjust from the start and return the time and iterations."""

    def poses(self) -> FloatArray:
        """Return the poses of all vertices after the last adjustment, shape (num_vertices, 3)."""


@dataclass(frozen=True, slots=True)
class Problem:
    """A graph to adjust, in the terms that every solver has. Vertices: submaps first, then nodes.

    Attributes
    ----------
    graph : its poses are overwritten.
    options : the loss, on which constraints it acts, and when to stop.
    start : poses to begin with, shape (num_vertices, 3) [m, m, rad].
    vertex_a, vertex_b : ends of every constraint, shape (num_constraints,).
    is_robust : whether the loss acts on it, shape (num_constraints,).
    held : vertices whose poses are fixed, shape (num_held,).
    eliminated : nodes with constraints to submaps alone, which a Schur complement can eliminate.
    """

    graph: PoseGraph
    options: AdjustmentOptions
    start: FloatArray
    vertex_a: IntArray
    vertex_b: IntArray
    is_robust: BoolArray
    held: IntArray
    eliminated: IntArray

    @classmethod
    def of(cls, graph: PoseGraph, options: AdjustmentOptions | None = None) -> Problem:
        """Return the problem of adjusting a graph from its present poses."""
        options = options or AdjustmentOptions(Loss.HUBER)
        vertex_a, vertex_b = constraint_ends(graph)
        between_nodes = graph.kinds == ConstraintKind.NODE_TO_NODE
        is_alone = np.ones(graph.num_submaps + graph.num_nodes, dtype=bool)
        is_alone[: graph.num_submaps] = False
        is_alone[vertex_a[between_nodes]] = False
        is_alone[vertex_b[between_nodes]] = False
        return cls(
            graph,
            options,
            np.concatenate((graph.submap_poses, graph.node_poses)),
            vertex_a,
            vertex_b,
            np.isin(graph.kinds, [int(kind) for kind in options.robust_kinds]),
            np.flatnonzero(held_of(graph)),
            np.flatnonzero(is_alone),
        )

    @property
    def loss_scale(self) -> float:
        """Whitened residual E from which on the loss reduces the weight."""
        return scale_of(self.options.loss, self.options.loss_scale)

    def place(self, poses: FloatArray) -> None:
        """Set the poses of the graph, shape (num_vertices, 3)."""
        self.graph.submap_poses[:] = poses[: self.graph.num_submaps]
        self.graph.node_poses[:] = poses[self.graph.num_submaps :]

    def cost(self, poses: FloatArray) -> float:
        """Return half the sum of rho(E^2) (eq. SPA) at poses of shape (num_vertices, 3)."""
        self.place(poses)
        without_steps = AdjustmentOptions(
            self.options.loss, self.options.loss_scale, self.options.robust_kinds, max_iterations=0
        )
        return adjust(self.graph, without_steps).initial_cost

    def whitening(self) -> FloatArray:
        """Return W with W^T W = information of each constraint, shape (num_constraints, 3, 3)."""
        informations = self.graph.informations
        diagonal = np.sqrt(informations * np.eye(3))
        values, vectors = np.linalg.eigh(informations)
        roots = np.sqrt(np.maximum(values, 0.0))[:, :, np.newaxis] * vectors.transpose(0, 2, 1)
        is_diagonal = (informations == informations * np.eye(3)).all(axis=(1, 2))
        whitening: FloatArray = np.where(is_diagonal[:, np.newaxis, np.newaxis], diagonal, roots)
        return whitening

    def informations_in_b(self) -> FloatArray:
        """Return the informations in the frame of b as measured, where GTSAM defines its errors."""
        graph = self.graph
        cos, sin = np.cos(graph.relative_poses[:, 2]), np.sin(graph.relative_poses[:, 2])
        turn = np.zeros((cos.size, 3, 3))
        turn[:, 0, 0] = turn[:, 1, 1] = cos
        turn[:, 0, 1], turn[:, 1, 0] = -sin, sin
        turn[:, 2, 2] = 1.0
        turned = turn.transpose(0, 2, 1) @ graph.informations @ turn
        turned = 0.5 * (turned + turned.transpose(0, 2, 1))
        # an isotropic information does not change; rounding must not fill its zeros
        own = graph.informations
        is_isotropic = (own == own * np.eye(3)).all(axis=(1, 2)) & (own[:, 0, 0] == own[:, 1, 1])
        informations: FloatArray = np.where(is_isotropic[:, np.newaxis, np.newaxis], own, turned)
        return informations


def seconds_of(function: Callable[[], object]) -> float:
    """Return the seconds that one call takes, without garbage collection."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        start = perf_counter()
        function()
        return perf_counter() - start
    finally:
        if collecting:
            gc.enable()


class OwnProgram:
    """The adjustment of this package.

    Symbolic factorization, and copying poses in and out, count as solving.

    Parameters
    ----------
    problem : to solve.
    is_held : whether the constraints are sorted and packed beforehand, as while mapping, where all
        but the newest are; otherwise that counts as solving, too.
    """

    def __init__(self, problem: Problem, *, is_held: bool = False) -> None:
        self._problem = problem
        self._poses = problem.start
        self._adjuster = PoseAdjuster(problem.graph) if is_held else None
        if is_held:
            self.solve()

    def solve(self) -> Solve:
        """Adjust from the start and return the time and iterations."""
        problem, iterations = self._problem, 0

        def run() -> None:
            nonlocal iterations
            adjuster = self._adjuster or PoseAdjuster(problem.graph)
            iterations = adjuster.adjust(problem.options).iterations

        problem.place(problem.start)
        seconds = seconds_of(run)
        self._poses = np.concatenate((problem.graph.submap_poses, problem.graph.node_poses))
        return Solve(seconds, iterations)

    def poses(self) -> FloatArray:
        """Return the poses of all vertices after the last adjustment, shape (num_vertices, 3)."""
        return self._poses
