# SPDX-License-Identifier: Apache-2.0
"""Pose adjustment of a pose graph (section V-A, eq. SPA), by :mod:`cartoloop.pose_adjustment`."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.pose_adjustment import (
    Constraints,
    ControlPoints,
    GroupLoss,
    Loss,
    Planner,
    Problem,
    Solution,
    held_vertices,
    residuals,
    solve,
)

TRUSTED = len(ConstraintKind)
"""Group of the constraints that no loss weakens."""

NEARLY_ALL, MIN_MORE = 0.97, 3
"""A decision with a flexible chain stands if it keeps this share of the loop closures, and this
many more than that with the chain as it is: one or two may be false."""


@dataclass(frozen=True, slots=True)
class AdjustmentOptions:
    """Parameters of one adjustment.

    Attributes
    ----------
    loss : what limits the influence of single constraints.
    loss_scale : where it begins, in units of the whitened residual E; None: the loss's default.
    robust_kinds : kinds of constraint that the loss acts on; the others are trusted.
    max_iterations : linear systems solved at most; a truncated loss needs several descents, each of
        which may take as many.
    relative_tolerance : change of the cost, as a share of it, below which the result stands.
    chain_share : share of the information of intra-submap constraints that is used.
    decision_share : share of it, if less, with which a truncated loss decides what it leaves out.
    flexible_share : share of it, if less, with which a truncated loss decides again if it leaves
        out more than a few loop closures; see :meth:`PoseAdjuster.adjust`.
    """

    loss: Loss = Loss.TRUNCATED
    loss_scale: float | None = None
    robust_kinds: Collection[ConstraintKind] = (ConstraintKind.LOOP_CLOSURE,)
    max_iterations: int = 50
    relative_tolerance: float = 1e-6
    chain_share: float = 1.0
    decision_share: float = 1.0
    flexible_share: float = 1.0

    def loss_of_kind(self) -> list[GroupLoss]:
        """Return the loss of each group: of the kinds of constraint, and of those trusted."""
        robust = GroupLoss(self.loss, self.loss_scale)
        losses = [robust if kind in self.robust_kinds else GroupLoss() for kind in ConstraintKind]
        return [*losses, GroupLoss()]


@dataclass(frozen=True, slots=True)
class AdjustmentResult:
    """What an adjustment did.

    Attributes
    ----------
    cost, initial_cost : half the sum of rho(E^2), after and before (eq. SPA).
    iterations : linear systems solved.
    converged : False if it stopped at the maximum number of iterations.
    weights : what the loss leaves of each constraint's information, in [0, 1],
        shape (num_constraints,).
    """

    cost: float
    initial_cost: float
    iterations: int
    converged: bool
    weights: FloatArray


def graph_problem(
    graph: PoseGraph, points: ControlPoints | None = None, chain_share: float = 1.0
) -> Problem:
    """Return the problem of adjusting a graph from where its poses are.

    The groups of the constraints are their kinds, and one more for those that are trusted. Copies
    no constraint, but all information if intra-submap constraints have a share of theirs.
    """
    informations = graph.informations
    if chain_share != 1.0:
        informations = informations.copy()
        informations[graph.kinds == ConstraintKind.INTRA_SUBMAP] *= chain_share
    return Problem(
        graph.submap_poses,
        graph.node_poses,
        Constraints(
            np.where(graph.is_trusted, TRUSTED, graph.kinds),
            graph.kinds == ConstraintKind.NODE_TO_NODE,
            graph.index_a,
            graph.index_b,
            graph.relative_poses,
            informations,
        ),
        points,
        graph.fixed_submaps,
        graph.fixed_nodes,
    )


class PoseAdjuster:
    """Adjusts a graph repeatedly while it grows; the plan is kept between adjustments.

    Parameters
    ----------
    graph : constraints may be added to it; those that it has must stay as they are.
    """

    def __init__(self, graph: PoseGraph) -> None:
        self.graph = graph
        self._planners: dict[float, Planner] = {}
        self._believed: BoolArray | None = None

    def adjust(
        self, options: AdjustmentOptions | None = None, points: ControlPoints | None = None
    ) -> AdjustmentResult:
        """Move the nodes and submaps to where the constraints agree best, in place.

        Fixed nodes and submaps stay. A part of the graph with nothing fixed and no control point is
        held at its first submap (or first node); a vertex without constraints stays where it is.

        A truncated loss may decide what it leaves out with a share of the chain's information; the
        poses follow from the chain as it is.

        Errors of scans in one submap are not independent, so that the chain of submaps is too sure
        of itself, and a truncated loss may leave out loop closures that are true. If with a
        flexible chain nearly all of them agree, this decision stands, and the poses follow from
        the chain as it is. False closures do not all agree, however flexible the chain is.

        Parameters
        ----------
        options : None for the defaults.
        points : absolute measurements of nodes; the group of a point is a `ConstraintKind`.
        """
        options = options or AdjustmentOptions()
        share = min(options.decision_share, options.chain_share)
        result = self._solve(share, points, options)
        iterations = result.iterations
        if options.flexible_share < share and self._leaves_out_many(result):
            flexible = self._solve(options.flexible_share, points, options)
            iterations += flexible.iterations
            if self._is_agreed(flexible, result):
                result, share = flexible, options.flexible_share
            else:
                self._move_to(result)
        if share < options.chain_share:
            weights = np.concatenate((result.weights, result.control_weights))
            result = self._solve(options.chain_share, points, options, weights)
            iterations += result.iterations
        self._believed = result.weights > 0.0
        return AdjustmentResult(
            result.cost, result.initial_cost, iterations, result.converged, result.weights
        )

    def _num_kept(self, solution: Solution) -> tuple[int, int]:
        """Return the number of loop closures that a solution keeps, and that of all."""
        weights = solution.weights[self.graph.kinds == ConstraintKind.LOOP_CLOSURE]
        return int(np.count_nonzero(weights)), weights.size

    def _leaves_out_many(self, solution: Solution) -> bool:
        """Return whether a solution leaves out more than a few of the loop closures."""
        num_kept, number = self._num_kept(solution)
        return num_kept < NEARLY_ALL * number

    def _is_agreed(self, solution: Solution, other: Solution) -> bool:
        """Return whether nearly all loop closures agree in a solution, not just a few more."""
        more = self._num_kept(solution)[0] - self._num_kept(other)[0]
        return more >= MIN_MORE and not self._leaves_out_many(solution)

    def _solve(
        self,
        share: float,
        points: ControlPoints | None,
        options: AdjustmentOptions,
        weights: FloatArray | None = None,
    ) -> Solution:
        """Adjust with a share of the chain's information, and move the graph's poses there."""
        planner = self._planners.setdefault(share, Planner())
        solution = solve(
            planner.plan(graph_problem(self.graph, points, share)),
            options.loss_of_kind(),
            max_iterations=options.max_iterations,
            relative_tolerance=options.relative_tolerance,
            believed=self._believed,
            weights=weights,
        )
        self._move_to(solution)
        return solution

    def _move_to(self, solution: Solution) -> None:
        self.graph.submap_poses[:] = solution.submap_poses
        self.graph.node_poses[:] = solution.node_poses


def adjust(
    graph: PoseGraph,
    options: AdjustmentOptions | None = None,
    points: ControlPoints | None = None,
) -> AdjustmentResult:
    """Adjust a graph once, in place; see :meth:`PoseAdjuster.adjust`."""
    return PoseAdjuster(graph).adjust(options, points)


def chain_share(graph: PoseGraph, max_chi_square: float) -> float:
    """Return the share of the information of intra-submap constraints that the map bears out.

    Errors of neighbouring scan matches are not independent, and add up along the path. Where loop
    closures have to bend the chain of submaps by far more than its information allows, that says
    how much too large it is: the variance factor of an adjustment, chi square per degree of freedom
    (Koch, Parameter Estimation and Hypothesis Testing in Linear Models, 1999).

    Parameters
    ----------
    graph : adjusted.
    max_chi_square : per degree of freedom; up to it the share is 1.
    """
    is_chain = graph.kinds == ConstraintKind.INTRA_SUBMAP
    freedom = 3 * (int(np.count_nonzero(is_chain)) - graph.num_nodes - graph.num_submaps + 1)
    if freedom <= 0:
        return 1.0
    squared = residuals(graph_problem(graph), np.flatnonzero(is_chain)).squared
    chi_square = float(squared.sum()) / freedom
    return max_chi_square / chi_square if chi_square > max_chi_square else 1.0


def constraint_residuals(
    graph: PoseGraph, constraints: IntArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return by how much constraints are violated at the current poses.

    Parameters
    ----------
    constraints : which, shape (n,); None for all.

    Returns
    -------
    translation_error : shape (n,) [m].
    rotation_error : shape (n,) [rad], not negative.

    Notes
    -----
    A loop closure counts as true where these are at most 20 cm and 1 degree (section VI, table IV).
    """
    measured = residuals(graph_problem(graph), constraints)
    return measured.translation, measured.rotation


def constraint_ends(graph: PoseGraph) -> tuple[IntArray, IntArray]:
    """Return the vertices a and b of every constraint; vertices are submaps, then nodes."""
    return graph_problem(graph).ends()


def held_of(graph: PoseGraph) -> BoolArray:
    """Return which vertices an adjustment holds: fixed ones, the first of each part without any."""
    problem = graph_problem(graph)
    return held_vertices(problem, *problem.ends())[:-1]
