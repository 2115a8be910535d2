# SPDX-License-Identifier: Apache-2.0
"""The constraints as quadratic models, and the step to the minimum of their sum."""

from __future__ import annotations

from dataclasses import dataclass

from cartoloop.arrays import FloatArray
from cartoloop.kernels import sparse_cholesky
from cartoloop.kernels.pose_adjustment import elimination, reduced_system, steps
from cartoloop.kernels.pose_adjustment.layout import GroupLosses
from cartoloop.kernels.pose_adjustment.linearization import linearize_direct
from cartoloop.pose_adjustment.plan import Plan


def linearise(plan: Plan, poses: FloatArray, losses: GroupLosses, damping: float) -> Linearised:
    """Replace the constraints by quadratic models, eliminate the nodes.

    Parameters
    ----------
    poses : of all vertices, shape (num_vertices, 3) [m, m, rad].
    losses : of each group of constraints.
    damping : share of the diagonal that is added to it (Marquardt).
    """
    cost, decrease, is_definite = _pass(plan, poses, losses, damping, eliminate=True)
    return Linearised(plan, poses, cost, damping, decrease, is_definite, plan.num_passes)


def cost_at(plan: Plan, poses: FloatArray, losses: GroupLosses) -> float:
    """Return the cost of eq. (SPA): half the sum of rho(E^2); updates the weights of the plan."""
    return _pass(plan, poses, losses, 0.0, eliminate=False)[0]


def _pass(
    plan: Plan, poses: FloatArray, losses: GroupLosses, damping: float, *, eliminate: bool
) -> tuple[float, float, bool]:
    plan.num_passes += 1
    reduced_system.rotations_of(poses, plan.vertices.starts, plan.rotations)
    cost, decrease, is_definite = elimination.linearize_windows(
        poses,
        plan.rotations,
        plan.problem.num_submaps,
        plan.layout,
        losses,
        damping,
        eliminate,
        plan.elimination,
    )
    if plan.has_direct:
        cost += linearize_direct(poses, plan.rotations, plan.direct, losses)
    return cost, decrease, is_definite


@dataclass(frozen=True, slots=True)
class Linearised:
    """Quadratic models of all constraints at some poses. Valid until the plan's next pass.

    Attributes
    ----------
    plan : whose buffers hold the models.
    poses : where they were made.
    cost : half the sum of rho(E^2) (eq. SPA).
    damping : of the models.
    """

    plan: Plan
    poses: FloatArray
    cost: float
    damping: float
    _node_decrease: float
    _is_definite: bool
    _pass_number: int

    def step(self) -> Step | None:
        """Solve the reduced normal equations.

        Returns
        -------
        step : None if the system is not positive definite: linearise with more damping.

        Raises
        ------
        RuntimeError
            If the plan has been linearised elsewhere since.
        """
        self.check_valid()
        if not self._is_definite:
            return None
        plan, system = self.plan, self.plan.reduced
        system.blocks.fill(0.0)
        system.gradient.fill(0.0)
        reduced_system.sum_windows(
            plan.layout, system.slot_blocks, plan.elimination.sums, system.blocks, system.gradient
        )
        if plan.has_direct:
            reduced_system.add_direct(
                plan.direct,
                plan.vertices.row_of_vertex,
                system.edge_blocks,
                system.blocks,
                system.gradient,
            )
        decrease, is_definite = sparse_cholesky.solve(
            system.cholesky,
            system.blocks,
            system.gradient,
            self.damping,
            system.workspace,
            system.steps,
        )
        return Step(self, decrease + self._node_decrease) if is_definite else None

    def check_valid(self) -> None:
        """Raise RuntimeError if the plan has been linearised elsewhere since."""
        if self._pass_number != self.plan.num_passes:
            raise RuntimeError("the plan has been linearised elsewhere since: linearise again")


@dataclass(frozen=True, slots=True)
class Step:
    """The step to the minimum of a :class:`Linearised`.

    Attributes
    ----------
    origin : where it starts.
    decrease : of the cost, as the (damped) quadratic model predicts it.
    """

    origin: Linearised
    decrease: float

    def move(self, out_poses: FloatArray) -> None:
        """Write the poses after the step into `out_poses`; held vertices are not written.

        `out_poses` (num_vertices, 3) must be another array than `origin.poses`.
        """
        self.origin.check_valid()
        plan, poses = self.origin.plan, self.origin.poses
        step_of_kept = plan.reduced.steps
        steps.move_vertices(poses, plan.vertices.kept, step_of_kept, out_poses)
        steps.move_nodes(
            poses,
            plan.rotations,
            step_of_kept[plan.vertices.row_of_vertex[: plan.problem.num_submaps]],
            plan.layout,
            plan.elimination.factors,
            out_poses,
        )
