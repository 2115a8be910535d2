# SPDX-License-Identifier: Apache-2.0
"""The harness of changed inputs: what it runs, what it finds, and that there is nothing to find."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from random import Random

import pytest

from bench.fuzz import run as fuzz_run
from bench.fuzz import worker
from bench.fuzz.mutations import NUMBERS, mutate_arguments, mutated
from bench.fuzz.run import FuzzOptions, Results, run_all
from bench.fuzz.targets import TARGETS
from bench.fuzz.worker import Outcome, outcome_of
from cartoloop.errors import InputError

NUM_INPUTS = int(os.environ.get("CARTOLOOP_FUZZ_INPUTS", "1000"))


def test_changes_depend_on_the_seed_alone():
    data = b"FLASER 3 1.0 2.0 3.0\n" * 10
    made = [mutated(Random(f"0/{number}"), data, data) for number in range(200)]
    assert made == [mutated(Random(f"0/{number}"), data, data) for number in range(200)]
    assert sum(one != data for one in made) > 150


def test_changed_command_lines_stay_in_their_folder():
    for number in range(500):
        arguments = mutate_arguments(
            Random(number), ["map", "../a", "-o", "/etc", "\udcff"], NUMBERS
        )
        assert not any("/" in argument or ".." in argument for argument in arguments)


@pytest.mark.parametrize(
    ("raised", "what"),
    [
        (None, "fine"),
        (InputError("a.log: is empty"), "stated"),
        (ValueError("no"), "ValueError"),
        (MemoryError(), "MemoryError"),
    ],
)
def test_an_outcome_is_stated_or_a_failure(raised, what, monkeypatch):
    monkeypatch.setattr(worker, "most_held_mb", lambda: 100.0)

    def use(_):
        if raised is not None:
            raise raised

    assert outcome_of(TARGETS[0]._replace(use=use), [])[0] == what


def test_too_much_memory_is_a_failure(monkeypatch):
    monkeypatch.setattr(worker, "LIMIT_MB", 1)
    assert outcome_of(TARGETS[0]._replace(use=lambda _: None), [])[0] == "too large"


def test_memory_of_the_parent_does_not_count():
    ballast = bytearray(b"1") * (300 << 20)
    script = "from bench.fuzz.worker import most_held_mb; print(most_held_mb())"
    held = subprocess.run([sys.executable, "-c", script], capture_output=True, check=True)
    assert float(held.stdout) < len(ballast) >> 20


def _outcome(number, what, seconds=0.1):
    return Outcome(number, "text", what, "", [], seconds)


def test_results_count_and_list_failures():
    results = Results()
    for outcome in (_outcome(0, "fine"), _outcome(1, "stated", 2.0), _outcome(2, "KeyError")):
        results.add(outcome)
    assert results.total == 3
    assert [failure.number for failure in results.failures] == [2]
    assert "3 inputs, 1 failures; longest 2.00 s (number 1, text)" in results.table()


def test_a_process_that_an_input_ends_is_replaced(tmp_path, monkeypatch):
    program = tmp_path / "bench"
    (program / "fuzz").mkdir(parents=True)
    (program / "__init__.py").touch()
    (program / "fuzz" / "__init__.py").touch()
    (program / "fuzz" / "worker.py").write_text(
        "import json, os, sys\n"
        "for number in range(int(sys.argv[3]), int(sys.argv[4])):\n"
        "    for what in ('begun', 'fine'):\n"
        "        out = dict(number=number, target='text', what=what, details='', arguments=[])\n"
        "        print(json.dumps(out), flush=True)\n"
        "        if number == 3:\n"
        "            os.abort()\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    outcomes = list(fuzz_run._run_range(tmp_path, 0, 0, 6, ""))
    assert [outcome.number for outcome in outcomes] == list(range(6))
    assert outcomes[3].what == "ended the process (-6)"
    assert {outcome.what for outcome in outcomes if outcome.number != 3} == {"fine"}


@pytest.mark.slow
def test_nothing_but_stated_errors(tmp_path):
    lines = []
    options = FuzzOptions(seed=16, first=0, count=NUM_INPUTS, num_processes=2, out=tmp_path)
    results = run_all(options, lines.append)
    kept = "".join(path.read_text()[-1500:] for path in Path(tmp_path).rglob("failure.txt"))
    assert not results.failures, "\n".join(lines) + kept
    assert results.total == NUM_INPUTS
    assert {target for target, _ in results.counts} == {target.name for target in TARGETS}
