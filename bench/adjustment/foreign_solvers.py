# SPDX-License-Identifier: Apache-2.0
"""GTSAM, Ceres and g2o on our graphs: same start, loss and stopping rule, one thread.

GTSAM is called through its Python package, whose factors are compiled. This is not possible for
Ceres and g2o: pyceres has no factor for poses in the plane, so every residual would be a call of
Python, and g2o-python 0.0.12 crashes on matrices of NumPy 2. The driver programs in ``foreign/``
call them. They are compiled when needed (g++), against Debian's libceres-dev and against the
headers and static libraries of g2o-python.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from bench.adjustment.compiled_drivers import (
    DrivenProgram,
    Driver,
    SolverMissing,
    compile_driver,
)
from bench.adjustment.problem import Problem, Program, Solve, seconds_of
from cartoloop.arrays import FloatArray

_GTSAM_METHODS = {
    "Levenberg-Marquardt": "levenberg",
    "Gauss-Newton": "gauss_newton",
    "Gauss-Newton, nodes first": "gauss_newton_schur",
}
_DRIVEN_METHODS = {
    "ceres": {
        "Ceres, sparse normal Cholesky": "sparse_normal_cholesky",
        "Ceres, sparse normal Cholesky, Gauss-Newton": "sparse_normal_cholesky_gauss_newton",
        "Ceres, dense Schur, Gauss-Newton": "dense_schur_gauss_newton",
        "Ceres, sparse Schur, Gauss-Newton": "sparse_schur_gauss_newton",
    },
    "g2o": {
        "g2o, Levenberg-Marquardt": "levenberg",
        "g2o, Gauss-Newton": "gauss_newton",
        "g2o, Gauss-Newton, nodes first": "gauss_newton_schur",
    },
}


@dataclass(frozen=True, slots=True)
class Method:
    """One configuration of one solver.

    Attributes
    ----------
    name : of the solver and the configuration.
    start : makes the program for a problem; raises SolverMissing.
    needs_submaps : whether it needs nodes with constraints to submaps alone.
    """

    name: str
    start: Callable[[Problem], Program]
    needs_submaps: bool = False


class ForeignSolvers:
    """The foreign solvers; compiles the drivers and keeps them running until it is closed."""

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="cartoloop-bench-")
        self._executables: dict[str, Path | SolverMissing] = {}
        self._drivers: dict[str, Driver] = {}
        self._gtsam: GtsamGraph | None = None
        self._problem: Problem | None = None

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End the programs and remove what was compiled."""
        self._turn_to(None)
        self._folder.cleanup()

    def methods(self) -> list[Method]:
        """Return the configurations to compare, those of a solver together.

        All programs have the same problem: starting one on another problem ends the others.
        """
        gtsam = [
            Method(f"GTSAM, {name}", partial(self._start_gtsam, method), "schur" in method)
            for name, method in _GTSAM_METHODS.items()
        ]
        driven = [
            Method(name, partial(self._start_driver, solver, method), "schur" in method)
            for solver, methods in _DRIVEN_METHODS.items()
            for name, method in methods.items()
        ]
        return gtsam + driven

    def _turn_to(self, problem: Problem | None) -> None:
        """End the programs of another problem."""
        if problem is None or problem is not self._problem:
            for driver in self._drivers.values():
                driver.close()
            self._drivers.clear()
            self._gtsam = None
            self._problem = problem

    def _start_gtsam(self, method: str, problem: Problem) -> Program:
        self._turn_to(problem)
        if self._gtsam is None:
            self._gtsam = GtsamGraph(problem)
        return GtsamProgram(self._gtsam, method)

    def _start_driver(self, solver: str, method: str, problem: Problem) -> Program:
        self._turn_to(problem)
        executable = self._executable(solver)
        driver = self._drivers.get(solver)
        if driver is None or not driver.is_running():
            if driver is not None:
                driver.close()
            driver = self._drivers[solver] = Driver(executable, problem)
        return DrivenProgram(driver, method)

    def _executable(self, solver: str) -> Path:
        if solver not in self._executables:
            try:
                self._executables[solver] = compile_driver(solver, Path(self._folder.name))
            except SolverMissing as error:
                self._executables[solver] = error
        found = self._executables[solver]
        if isinstance(found, SolverMissing):
            raise SolverMissing(str(found))
        return found


class GtsamGraph:
    """A problem in GTSAM's form: `factors` and the values to `start` from.

    Its factor measures the logarithm of the error, which differs from eq. (5) in the second order
    of the residual: the least cost is the same to several digits.

    Raises
    ------
    SolverMissing
        GTSAM is not installed.
    """

    def __init__(self, problem: Problem) -> None:
        try:
            import gtsam
        except ImportError as error:
            raise SolverMissing(f"not installed ({error}); pip install gtsam") from error
        self.gtsam: Any = gtsam
        self.problem = problem
        self.factors = self._make_factors()
        self.start = gtsam.Values()
        for vertex, pose in enumerate(problem.start.tolist()):
            self.start.insert(vertex, gtsam.Pose2(*pose))
        # the usual anchor; its residual stays zero, so it adds nothing to the cost
        anchor = gtsam.noiseModel.Isotropic.Sigma(3, 1e-4)
        for vertex in problem.held.tolist():
            self.factors.addPriorPose2(vertex, self.start.atPose2(vertex), anchor)

    def _make_factors(self) -> Any:  # noqa: ANN401 - a package without types
        gtsam, problem = self.gtsam, self.problem
        huber = gtsam.noiseModel.mEstimator.Huber.Create(problem.loss_scale)
        noises: dict[tuple[bytes, bool], Any] = {}
        factors = gtsam.NonlinearFactorGraph()
        for a, b, measured, information, is_robust in zip(
            problem.vertex_a.tolist(),
            problem.vertex_b.tolist(),
            problem.graph.relative_poses.tolist(),
            problem.informations_in_b(),
            problem.is_robust.tolist(),
            strict=True,
        ):
            key = information.tobytes(), is_robust
            if key not in noises:
                noise = gtsam.noiseModel.Gaussian.Information(information)
                noises[key] = gtsam.noiseModel.Robust.Create(huber, noise) if is_robust else noise
            factors.add(gtsam.BetweenFactorPose2(a, b, gtsam.Pose2(*measured), noises[key]))
        return factors


class GtsamProgram:
    """One method of GTSAM; solving includes the choice of an ordering, as it does for the others.

    Parameters
    ----------
    graph : to adjust.
    method : "levenberg", "gauss_newton" or "gauss_newton_schur", which orders all nodes before the
        submaps: the fastest ordering for our graphs.
    """

    def __init__(self, graph: GtsamGraph, method: str) -> None:
        self._graph, self._method = graph, method
        self._result = graph.start

    def solve(self) -> Solve:
        """Adjust from the start and return the time and iterations.

        Raises
        ------
        SolverMissing
            GTSAM gave up.
        """
        iterations = 0

        def run() -> None:
            nonlocal iterations
            optimizer = self._make_optimizer()
            self._result = optimizer.optimize()
            iterations = optimizer.iterations()

        try:
            return Solve(seconds_of(run), iterations)
        except RuntimeError as error:
            raise SolverMissing(f"failed: {' '.join(str(error).split())[:80]}") from error

    def poses(self) -> FloatArray:
        """Return the poses of all vertices after the last adjustment, shape (num_vertices, 3)."""
        poses: FloatArray = self._graph.gtsam.utilities.extractPose2(self._result)
        return poses

    def _make_optimizer(self) -> Any:  # noqa: ANN401 - a package without types
        gtsam, problem = self._graph.gtsam, self._graph.problem
        if self._method == "levenberg":
            parameters, make = gtsam.LevenbergMarquardtParams(), gtsam.LevenbergMarquardtOptimizer
        else:
            parameters, make = gtsam.GaussNewtonParams(), gtsam.GaussNewtonOptimizer
        parameters.setMaxIterations(problem.options.max_iterations)
        parameters.setRelativeErrorTol(problem.options.relative_tolerance)
        parameters.setAbsoluteErrorTol(0.0)
        parameters.setErrorTol(0.0)
        factors = self._graph.factors
        if self._method == "gauss_newton_schur":
            submaps = list(range(problem.graph.num_submaps))
            order = gtsam.Ordering.ColamdConstrainedLastNonlinearFactorGraph(factors, submaps)
            parameters.setOrdering(order)
        return make(factors, self._graph.start, parameters)
