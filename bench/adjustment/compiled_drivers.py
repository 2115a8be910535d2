# SPDX-License-Identifier: Apache-2.0
"""Driver programs around C++ solvers: compiled when needed, run as processes, commanded by lines.

``foreign/pose_graph_driver.h`` describes the protocol.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from bench.adjustment.problem import Problem, Solve
from cartoloop.arrays import FloatArray
from cartoloop.errors import CartoloopError

SOURCES = Path(__file__).parent / "foreign"

_ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
_COMPILE = ("g++", "-std=c++17", "-O3", "-DNDEBUG", "-I/usr/include/eigen3")
_LINK = {
    "ceres": ("-lceres", "-lglog"),
    "g2o": (
        f"-I{sys.prefix}/include",
        f"-L{sys.prefix}/lib",
        "-lg2o_types_slam2d",
        "-lg2o_solver_eigen",
        "-lg2o_core",
        "-lg2o_stuff",
    ),
}
_HOW_TO_GET = {
    "ceres": "apt install g++ libceres-dev",
    "g2o": "apt install g++ libeigen3-dev; pip install g2o-python",
}


class SolverMissing(CartoloopError):  # noqa: N818 - named for what it means
    """A foreign solver is missing or failed; the message is one line for the table."""


def compile_driver(solver: str, folder: Path) -> Path:
    """Return the driver of "ceres" or "g2o", compiled into a folder.

    Raises
    ------
    SolverMissing
        There is no compiler, or the library is missing or of another version.
    """
    if shutil.which(_COMPILE[0]) is None:
        raise SolverMissing(f"not installed: there is no {_COMPILE[0]}; {_HOW_TO_GET[solver]}")
    source, executable = SOURCES / f"{solver}_pose_graph.cpp", folder / f"{solver}_pose_graph"
    done = subprocess.run(
        [*_COMPILE, str(source), "-o", str(executable), *_LINK[solver]],
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
    )
    if done.returncode != 0:
        lines = [line for line in done.stderr.splitlines() if "error: " in line]
        reason = lines[0].partition("error: ")[2] if lines else "it cannot be linked"
        raise SolverMissing(f"not installed ({reason}); {_HOW_TO_GET[solver]}")
    return executable


def driver_input(problem: Problem) -> bytes:
    """Return the file that ``foreign/pose_graph_driver.h`` reads."""
    graph = problem.graph
    counts = (
        len(problem.start),
        graph.num_constraints,
        problem.held.size,
        problem.eliminated.size,
        problem.options.max_iterations,
    )
    integers = (problem.held, problem.eliminated, problem.vertex_a, problem.vertex_b)
    return b"".join(
        (
            np.array(counts, dtype=np.int64).tobytes(),
            np.array((problem.loss_scale, problem.options.relative_tolerance)).tobytes(),
            *(values.astype(np.int64).tobytes() for values in (*integers, problem.is_robust)),
            problem.start.tobytes(),
            graph.relative_poses.tobytes(),
            problem.whitening().tobytes(),
        )
    )


class Driver:
    """A compiled program that holds one graph and adjusts it on command.

    Parameters
    ----------
    executable : of :func:`compile_driver`.
    problem : the graph; its file is written beside the executable.
    """

    def __init__(self, executable: Path, problem: Problem) -> None:
        graph, self._result = executable.with_suffix(".graph"), executable.with_suffix(".poses")
        graph.write_bytes(driver_input(problem))
        self._process = subprocess.Popen(
            [executable, graph],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            env=os.environ | _ONE_THREAD,
        )

    def solve(self, method: str) -> Solve:
        """Adjust from the start and return the time and iterations.

        Raises
        ------
        SolverMissing
            It failed, or the program has ended.
        """
        answer = self._ask(f"solve {method}")
        if not answer["is_usable"]:
            raise SolverMissing("failed: it found no usable solution")
        return Solve(float(answer["seconds"]), int(answer["iterations"]))

    def poses(self) -> FloatArray:
        """Return the poses of all vertices after the last adjustment, shape (num_vertices, 3).

        Raises
        ------
        SolverMissing
            The program has ended, or cannot write its file.
        """
        if not self._ask(f"poses {self._result}")["is_written"]:
            raise SolverMissing(f"{self._result}: its poses cannot be written: is the disk full?")
        return np.fromfile(self._result).reshape(-1, 3)

    def is_running(self) -> bool:
        """Return whether the program is running."""
        return self._process.poll() is None

    def close(self) -> None:
        """End the program."""
        self._process.kill()  # it has nothing to save and may be in a long solve
        self._process.communicate()

    def _ask(self, command: str) -> dict[str, Any]:
        to, back = self._process.stdin, self._process.stdout
        line = ""
        if to is not None and back is not None and self.is_running():
            try:
                to.write(command + "\n")
                to.flush()
                line = back.readline()
            except BrokenPipeError:
                pass  # it ended, which is reported below
        if not line:
            raise SolverMissing(f"failed: its program ended with status {self._process.wait()}")
        answer: dict[str, Any] = json.loads(line)
        return answer


class DrivenProgram:
    """One method of a driver that other methods may share.

    Its poses are those of the method that the driver ran last.
    """

    def __init__(self, driver: Driver, method: str) -> None:
        self._driver, self._method = driver, method

    def solve(self) -> Solve:
        """Adjust from the start and return the time and iterations."""
        return self._driver.solve(self._method)

    def poses(self) -> FloatArray:
        """Return the poses of all vertices after the last adjustment, shape (num_vertices, 3)."""
        return self._driver.poses()
