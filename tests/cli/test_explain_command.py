# SPDX-License-Identifier: Apache-2.0
"""``cartoloop explain`` on a small map."""

from __future__ import annotations

import json

import pytest

from cartoloop.cli.main import run
from tests.evaluation.hand_made_run import closure, hand_made_result


@pytest.fixture
def explain(tmp_path, capsys):
    hand_made_result([closure(0, 5, 0.1)], [closure(0, 4)]).save(tmp_path / "out")

    def call(*arguments):
        status = run(["explain", str(tmp_path / "out"), *arguments])
        captured = capsys.readouterr()
        assert "Traceback" not in captured.err
        return status, captured.out, captured.err

    return call


def test_a_row_a_pair_and_a_place_are_explained(explain):
    for arguments in (("--closure", "1"), ("--pair", "0", "5"), ("--near", "0.2", "0.1")):
        status, out, _ = explain(*arguments)
        assert status == 0
        assert "Closure 1: submap 0, node 5: final" in out


def test_json_holds_the_same(explain):
    [one] = json.loads(explain("--pair", "0", "5", "--json")[1])

    assert (one["closure"], one["status"], one["reason"]) == (1, "final", "fits")
    assert one["values"]["residual_m"] == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        ((), 2, "give one of --closure"),
        (("--closure", "0", "--pair", "0", "5"), 2, "give one of --closure"),
        (("--closure", "9"), 1, "the record has 2 rows"),
        (("--pair", "9", "0"), 1, "the map has submaps 0 to 2"),
        (("--near", "nan", "0"), 1, "give two finite numbers"),
    ],
)
def test_wrong_questions_are_refused_in_a_line(explain, arguments, status, message):
    got, _, err = explain(*arguments)

    assert got == status
    assert message in err
    assert len(err.splitlines()) == 1
