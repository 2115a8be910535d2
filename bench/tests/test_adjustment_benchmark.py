# SPDX-License-Identifier: Apache-2.0
"""The benchmark of pose adjustment: rows for all programs, reasons for those that are missing."""

import gzip
import math

import numpy as np
import pytest

from bench.adjustment import benchmark as adjustment
from bench.adjustment import compiled_drivers
from bench.adjustment.benchmark import HELD_NAME, OWN_NAME, run, warm_start
from bench.adjustment.compiled_drivers import SolverMissing, compile_driver
from bench.adjustment.foreign_solvers import ForeignSolvers, Method
from bench.adjustment.problem import OwnProgram, Problem, Solve
from bench.adjustment.synthetic_graphs import bipartite_graph
from bench.record import Record
from cartoloop.global_slam.pose_adjustment import AdjustmentOptions, adjust
from cartoloop.pose_adjustment import Loss

pytestmark = pytest.mark.slow

SAME_COST = 1e-5


def only_ours(_):
    return []


def problem_with_uneven_informations():
    graph = bipartite_graph(400, 8, 1_000, seed=1).graph
    rng = np.random.default_rng(2)
    roots = rng.normal(0.0, 15.0, graph.informations.shape)
    graph.informations[:] = roots @ roots.transpose(0, 2, 1) + graph.informations
    graph.relative_poses[:, 2] += 1e-4  # no two are equal
    return Problem.of(graph)


def missing(_):
    raise SolverMissing("not installed: for the test")


@pytest.fixture(scope="module")
def own_record():
    return run(2, None, largest=3_000, foreign=only_ours)


def test_every_graph_has_a_row_for_our_program(own_record):
    rows = own_record.rows
    assert [(row.case["nodes"], row.case["solver"]) for row in rows[1:]] == [
        (1_000, OWN_NAME), (1_000, HELD_NAME), (3_000, OWN_NAME), (3_000, HELD_NAME),
        (2_000, OWN_NAME), (2_000, HELD_NAME), (2_000, OWN_NAME), (2_000, HELD_NAME),
    ]  # fmt: skip
    for row in rows[1:]:
        assert row.figures["time"].value > 0.0
        assert row.figures["time"].repeats == 2
        assert row.figures["iterations"].value >= 1
    assert Record.from_json(own_record.to_json()) == own_record


def test_missing_data_folder_has_a_note(own_record, tmp_path):
    assert "no g2o files: give the folder" in own_record.rows[0].notes
    assert not own_record.rows[0].figures
    assert str(tmp_path) in run(1, tmp_path, largest=0, foreign=only_ours).rows[0].notes


def test_missing_solver_has_a_row_with_the_reason():
    record = run(1, None, largest=1_000, foreign=lambda _: [Method("absent", missing)])
    (row,) = [row for row in record.rows if row.case.get("solver") == "absent"]
    assert row.notes == "not installed: for the test"
    assert not row.figures
    assert not record.is_complete


def test_program_that_is_too_slow_is_skipped(monkeypatch):
    monkeypatch.setattr(adjustment, "_LONGEST_SOLVE_S", 0.0)
    record = run(1, None, largest=3_000, foreign=lambda _: [Method("other", OwnProgram)])
    rows = {row.case["nodes"]: row for row in record.rows if row.case.get("solver") == "other"}
    assert rows[1_000].figures["times ours"].value > 0.0
    assert "skipped" in rows[3_000].notes


def test_missing_compiler_is_an_error(monkeypatch, tmp_path):
    monkeypatch.setattr(compiled_drivers, "_COMPILE", ("no-such-compiler",))
    with pytest.raises(SolverMissing, match="there is no no-such-compiler"):
        compile_driver("ceres", tmp_path)


def test_bad_start_is_repeated_from_a_chordal_start(tmp_path):
    # a ring whose vertices all start near one place
    count = 60
    lines = [f"VERTEX_SE2 {v} {0.01 * (v % 7)} 0 {0.9 * v % 6.2 - 3.1}" for v in range(count)]
    turn, information = 2.0 * np.pi / count, "500 0 0 500 0 100"
    lines += [f"EDGE_SE2 {v} {(v + 1) % count} 1 0 {turn} {information}" for v in range(count)]
    folder = tmp_path / "pose-graphs"
    folder.mkdir()
    (folder / "ring.g2o.gz").write_bytes(gzip.compress("\n".join(lines).encode()))
    (folder / "ring_groundTruth.g2o").write_text("not read")
    rows = run(1, tmp_path, largest=0, foreign=only_ours).rows
    graphs = [row.case["graph"] for row in rows]
    assert graphs == ["ring"] * 2 + ["ring, chordal start"] * 2
    assert rows[2].figures["cost"].value == pytest.approx(rows[0].figures["cost"].value, rel=1e-3)


def test_our_program_restarts_each_time():
    problem = Problem.of(bipartite_graph(400, 8, 1_000).graph)
    program = OwnProgram(problem)
    first, poses = program.solve(), program.poses()
    second = program.solve()
    assert first.iterations == second.iterations >= 2
    assert program.poses().tobytes() == poses.tobytes()
    assert problem.cost(poses) < 0.1 * problem.cost(problem.start)


def test_warm_start_begins_near_the_least_cost():
    cold = bipartite_graph(1_000, 11, 3_080).graph
    warm = warm_start(bipartite_graph(1_000, 11, 3_080).graph, 90)
    from_cold, from_warm = adjust(cold), adjust(warm)
    assert from_warm.initial_cost < 0.1 * from_cold.initial_cost
    assert from_warm.iterations <= from_cold.iterations
    assert from_warm.cost == pytest.approx(from_cold.cost, rel=1e-4)


def test_whitening_is_a_root_of_the_information():
    problem = problem_with_uneven_informations()
    whitening = problem.whitening()
    np.testing.assert_allclose(
        whitening.transpose(0, 2, 1) @ whitening, problem.graph.informations, rtol=1e-9, atol=1e-9
    )


@pytest.fixture(scope="module")
def solvers():
    with ForeignSolvers() as solvers:
        yield solvers


def cost_of(method, problem):
    program = method.start(problem)
    assert program.solve().seconds > 0.0
    return problem.cost(program.poses())


def own_cost(problem):
    problem.place(problem.start)
    return adjust(problem.graph, AdjustmentOptions(Loss.HUBER, relative_tolerance=1e-9)).cost


@pytest.mark.parametrize("uneven", [False, True])
def test_gtsam_reaches_our_cost(solvers, uneven):
    pytest.importorskip("gtsam", reason="install the extra 'oracles' to compare with GTSAM")
    graph = bipartite_graph(400, 8, 1_000).graph
    problem = problem_with_uneven_informations() if uneven else Problem.of(graph)
    methods = [method for method in solvers.methods() if method.name.startswith("GTSAM")]
    assert len(methods) == 3
    for method in methods:
        assert cost_of(method, problem) == pytest.approx(own_cost(problem), rel=1e-4)


@pytest.mark.parametrize("solver", ["Ceres", "g2o"])
def test_a_compiled_solver_reaches_our_cost(solvers, solver):
    methods = [method for method in solvers.methods() if method.name.startswith(solver)]
    assert len(methods) >= 3
    for problem in (
        Problem.of(bipartite_graph(400, 8, 1_000).graph),
        problem_with_uneven_informations(),
    ):
        for method in methods:
            program = start_or_skip(method, problem)
            assert program.solve().seconds > 0.0
            cost = problem.cost(program.poses())
            assert cost == pytest.approx(own_cost(problem), rel=SAME_COST)


def test_driver_that_ended_is_reported_and_restarted(solvers):
    problem = Problem.of(bipartite_graph(400, 8, 1_000).graph)
    method = next(method for method in solvers.methods() if method.name.startswith("Ceres"))
    program = start_or_skip(method, problem)
    process = solvers._drivers["ceres"]._process
    process.kill()
    process.wait()
    with pytest.raises(SolverMissing, match="ended with status"):
        program.solve()
    assert method.start(problem).solve().iterations > 0


def start_or_skip(method, problem):
    """Return the program, or skip the test where the solver cannot be compiled."""
    try:
        return method.start(problem)
    except SolverMissing as error:
        pytest.skip(str(error))


class Failing:
    """A program that fails after `solves` solves, with poses that may not be finite."""

    def __init__(self, problem, solves, poses=0.0):
        self.problem, self.left, self.offset = problem, solves, poses

    def solve(self):
        self.left -= 1
        if self.left < 0:
            raise SolverMissing("failed: it ended")
        return Solve(0.001, 3)

    def poses(self):
        return self.problem.start + self.offset


@pytest.mark.parametrize(
    ("solves", "poses", "has_figures", "note"),
    [(2, 0.0, True, "when repeated: failed"), (9, math.nan, False, "failed: its poses")],
)
def test_program_that_fails_has_a_note(solves, poses, has_figures, note):
    def methods(_):
        return [Method("failing", lambda problem: Failing(problem, solves, poses))]

    record = run(3, None, 1_000, methods)
    (row,) = (row for row in record.rows if row.case.get("solver") == "failing")
    assert bool(row.figures) == has_figures
    assert note in row.notes
    assert "times ours" not in row.figures  # it ends where it started, at a higher cost
    assert Record.from_json(record.to_json()) == record
