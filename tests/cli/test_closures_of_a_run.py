# SPDX-License-Identifier: Apache-2.0
"""``cartoloop evaluate closures`` and ``make-relations`` on a simulated run with known truth."""

from __future__ import annotations

import json
import shutil

import pytest

from cartoloop.cli.main import run
from cartoloop.simulation import ring, simulate

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def mapped(tmp_path_factory, two_rounds, two_rounds_result):
    """Twice around a ring: folder with log, truth and the map in ``out``."""
    folder = tmp_path_factory.mktemp("ring")
    two_rounds.write_carmen(folder / "ring.log")
    two_rounds.write_truth(folder / "ring.tum")
    two_rounds_result.save(folder / "out")
    return folder


@pytest.fixture
def evaluate(mapped, capsys):
    def call(*arguments):
        paths = {"OUT": mapped / "out", "TRUTH": mapped / "ring.tum", "LOG": mapped / "ring.log"}
        status = run(["evaluate", *(str(paths.get(word, word)) for word in arguments)])
        captured = capsys.readouterr()
        assert "Traceback" not in captured.err
        return status, captured.out, captured.err

    return call


def test_closures_of_a_ring_are_true_and_complete(mapped, evaluate):
    status, out, _ = evaluate("closures", "OUT", "--truth", "TRUTH", "--log", "LOG", "--json")
    score = json.loads(out)
    report = json.loads((mapped / "out" / "report.json").read_text())["constraints"]

    assert status == 0
    assert score["final"]["constraints"] == report["loop_closure"] > 100
    assert score["final"]["precision"] == report["precision"]
    assert score["found"]["constraints"] == report["found"]
    assert score["found"]["precision"] == report["found_precision"]
    assert score["final"]["true_precision"] > 0.85
    recall = score["final"]["recall"]
    assert recall["pairs"] > recall["pairs_closed"] > 100
    assert recall["of_revisits"] > 0.5
    assert score["found"]["recall"]["pairs"] == recall["pairs"]


def test_scans_that_must_show_more_are_fewer(evaluate):
    def pairs(*options):
        arguments = ("closures", "OUT", "--truth", "TRUTH", "--log", "LOG", "--json", *options)
        return json.loads(evaluate(*arguments)[1])["final"]["recall"]["pairs"]

    assert pairs("--overlap", "0.9") < pairs() < pairs("--overlap", "0.3")


def test_the_table_shows_what_is_known(evaluate):
    paper = evaluate("closures", "OUT")[1]
    full = evaluate("closures", "OUT", "--truth", "TRUTH", "--log", "LOG")[1]

    assert "Precision (20 cm, 1 deg from the map)" in paper
    assert "against the truth" not in paper
    assert set(paper.splitlines()) <= set(full.splitlines())
    assert "closed at least once" in full


def test_a_plot_is_written(evaluate, tmp_path):
    pytest.importorskip("matplotlib")

    status, _, _ = evaluate("closures", "OUT", "--plot", str(tmp_path / "closures.png"))

    assert status == 0
    assert (tmp_path / "closures.png").read_bytes().startswith(b"\x89PNG")


def test_relations_score_local_slam(mapped, evaluate, tmp_path):
    path = str(tmp_path / "ring.relations")
    status, out, err = evaluate("make-relations", "OUT", "-o", path, "--min-distance", "10")
    first = (tmp_path / "ring.relations").read_bytes()
    evaluate("make-relations", "OUT", "-o", path, "--min-distance", "10")

    def mean_error(name):
        arguments = ("relations", str(mapped / "out" / name), path, "--json")
        return json.loads(evaluate(*arguments)[1])["absolute_translational"]["mean"]

    assert status == 0
    assert int(out.split()[0]) == len(first.splitlines()) > 10
    assert "proves nothing" in err
    assert (tmp_path / "ring.relations").read_bytes() == first
    assert mean_error("trajectory.tum") < 1e-6
    assert mean_error("local_trajectory.tum") > 0.001


def test_relations_never_replace_the_map(mapped, evaluate):
    file = mapped / "out" / "map.cartoloop"
    before = file.read_bytes()

    status, _, err = evaluate("make-relations", "OUT", "-o", str(file), "--min-distance", "10")

    assert status == 1
    assert "is a file of a map" in err
    assert file.read_bytes() == before


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (("closures", "nowhere"), 1, "nowhere: is not there"),
        (("closures", "OUT", "--log", "LOG"), 2, "--log: recall is measured against the truth"),
        (("closures", "OUT", "--truth", "LOG"), 1, "expected 8 numbers"),
        (("closures", "OUT", "--truth", "SHORT"), 1, "the truth has no pose for"),
        (("closures", "OUT", "--truth", "TRUTH", "--log", "OTHER"), 1, "give the recording"),
        (("closures", "OUT", "--plot", "a.bmp"), 2, "a name that ends in .png or .svg"),
        (("make-relations", "OUT", "-o", "a", "--min-distance", "1e5"), 1, "try a smaller"),
    ],
)
def test_bad_input_is_reported_in_a_line(
    mapped, evaluate, tmp_path, monkeypatch, arguments, status, message
):
    monkeypatch.chdir(tmp_path)
    short = (mapped / "ring.tum").read_text().splitlines(keepends=True)[:50]
    (tmp_path / "SHORT").write_text("".join(short))
    simulate(ring(), seed=4, duration=20.0).write_carmen(tmp_path / "OTHER")

    got, _, err = evaluate(*arguments)

    assert got == status
    assert message in err
    assert len(err.splitlines()) == 1


def test_a_folder_without_a_map_is_refused(mapped, evaluate, tmp_path):
    shutil.copytree(mapped / "out", tmp_path / "old")
    (tmp_path / "old" / "map.cartoloop").unlink()

    status, _, err = evaluate("closures", str(tmp_path / "old"))

    assert status == 1
    assert "is not there; give a folder that 'cartoloop map' wrote" in err
