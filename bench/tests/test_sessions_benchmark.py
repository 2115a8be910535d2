# SPDX-License-Identifier: Apache-2.0
"""The benchmark of sessions: its cases, and the rows that it keeps."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from bench import sessions
from bench.record import Figure, Row, read_record
from bench.results_page import write_results_page
from bench.row_store import RowStore
from bench.session_measures import distances
from cartoloop.errors import ConfigError, InputError
from cartoloop.result import Result
from cartoloop.sensor.pose import compose_all
from cartoloop.session import Session

CASE = {"part": sessions.CUT, "case": "aces", "sessions": 2}


def _wings(seed: int, wrong: int, notes: str) -> Row:
    figures = {
        "wrong joins": Figure.exact(wrong),
        "not explained": Figure.exact(0),
        "merging": Figure.of_samples([1.0 + seed], "CPU s"),
    }
    return Row({"part": sessions.WINGS, "case": f"seed {seed}"}, figures, notes)


def test_rows_are_kept_for_the_commit_they_are_of(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    RowStore(path, "abc").add(Row(CASE, {"joined": Figure.exact(1)}, "why"))
    again = RowStore(path, "abc")
    assert again.has(CASE)
    assert [row.notes for row in again] == ["why"]
    for commit in ("def", "abc with changes", "unknown"):
        assert not RowStore(path, commit).has(CASE)
    (other,) = RowStore(path, "def")
    assert other.figures["joined"].value == 1
    assert other.notes == "why; at abc"


def test_the_newest_row_of_a_case_counts(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    RowStore(path, "abc").add(Row(CASE, {"joined": Figure.exact(1)}))
    RowStore(path, "def").add(Row(CASE, {"joined": Figure.exact(2)}))
    (row,) = RowStore(path, "def")
    assert row.figures["joined"].value == 2


def test_a_file_without_rows_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    path.write_text('{"commit": "abc"}\n')
    with pytest.raises(InputError, match=r"rows\.jsonl, line 1: is not a row"):
        RowStore(path, "abc")


def test_wings_are_one_row_with_their_reasons() -> None:
    wall = "a wall of {} m at x -7.0, y 5.2 contradicts it"
    rows = [
        _wings(0, 0, wall.format(1.9)),
        _wings(1, 1, ""),
        _wings(2, 0, wall.format(2)),
        Row(CASE, {}),
    ]
    first, last = sessions.rows(rows)
    assert first.case == CASE
    assert last.figures["buildings"].value == 3
    assert last.figures["wrong joins"].value == 1
    assert last.figures["merging"].value == 2.0
    assert last.notes == "2 x a wall of N m at x N, y N contradicts it"


def test_rows_are_in_the_order_of_the_recordings() -> None:
    cases = [("aces", 10), ("intel", 10), ("aces", 2), ("intel", 5)]
    rows = [Row({"part": sessions.CUT, "case": name, "sessions": n}) for name, n in cases]
    ordered = [(row.case["case"], row.case["sessions"]) for row in sessions.rows(rows)]
    assert ordered == [("intel", 5), ("intel", 10), ("aces", 2), ("aces", 10)]


def test_pieces_make_one_record_on_the_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    measured = []

    def wings(case: dict[str, str | int | float]) -> Row:
        measured.append(case["case"])
        return _wings(int(str(case["case"]).split()[1]), 0, "two places fit")

    def rings(case: dict[str, str | int | float]) -> Row:
        return replace(wings(case), case=case)

    monkeypatch.setattr(sessions, "_wings_row", wings)
    monkeypatch.setattr(sessions, "_rings_row", rings)
    monkeypatch.setattr(sessions, "environment", lambda: {"commit": "abc", "date": "today"})
    for recordings, seeds in (((), 1), (("aces",), 3)):
        chosen = sessions.Chosen(tmp_path / "none", recordings, (2,), False, range(seeds))
        record = sessions.run(chosen, tmp_path, lambda line: None)
    assert measured == ["seed 0", "seed 0", "seed 1", "seed 1", "seed 2", "seed 2"]
    assert [row.notes for row in record.rows] == [
        "the recording is not there",
        "3 x two places fit",
        "3 x two places fit",
    ]
    assert read_record(tmp_path / "sessions.json").rows == record.rows
    write_results_page(tmp_path, tmp_path / "results.md")
    page = (tmp_path / "results.md").read_text()
    assert "### cut into sessions" in page
    assert "3 x two places fit" in page


def test_unknown_recordings_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no recording 'acess'"):
        sessions.run(sessions.Chosen(tmp_path, ("acess",), (2,), False, ()), tmp_path, print)


def test_relations_may_be_given_where_none_are_verified(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data, given = tmp_path / "radish", tmp_path / "made"
    for folder in (data, given):
        folder.mkdir()
    for name in ("aces", "mit-killian", "intel"):
        (data / f"{name}.clf.gz").touch()
    for name in ("aces", "intel-exact"):
        (given / f"{name}.relations").touch()
    monkeypatch.setattr(sessions, "open_log", lambda path: [])
    found = {}
    for name in ("aces", "mit-killian", "intel"):
        drive = sessions._drive(name, tmp_path, given)
        assert drive is not None
        found[name] = drive.relations
    assert found == {
        "aces": given / "aces.relations",
        "mit-killian": None,
        "intel": data / "intel-exact.relations",
    }


def _walk(offset: tuple[float, float], stamps: np.ndarray) -> np.ndarray:
    """Return poses along a bend, those of the third part of it displaced."""
    poses = np.column_stack((stamps, 0.01 * stamps**2, 0.1 * stamps))
    poses[20:30, :2] += offset
    return poses


def _sessions_at(offset: tuple[float, float], last_part: int = 0) -> SimpleNamespace:
    """Return a map of three sessions of ten scans, in a frame of its own."""
    stamps = np.arange(30.0)
    turned = compose_all(np.array((5.0, -3.0, 2.0)), _walk(offset, stamps))
    parts = (0, 0, last_part)
    return SimpleNamespace(
        stamps=stamps,
        trajectory=turned,
        scan_parts=np.repeat(parts, 10),
        sessions=[Session(first_scan=10 * k, part=part) for k, part in enumerate(parts)],
    )


def test_a_session_far_off_is_a_wrong_join() -> None:
    uncut = SimpleNamespace(stamps=np.arange(30.0), trajectory=_walk((0.0, 0.0), np.arange(30.0)))
    found = distances(cast("Result", uncut), cast("Result", _sessions_at((0.0, 5.6))), 0)
    assert found.num_wrong == 1
    assert found.largest == pytest.approx(5.6, abs=0.05)
    assert found.of_sessions == pytest.approx([0.0, 0.0, 5.6], abs=0.05)
    assert found.mean == pytest.approx(5.6 / 3, abs=0.05)


def test_sessions_apart_have_no_distance() -> None:
    uncut = SimpleNamespace(stamps=np.arange(30.0), trajectory=_walk((0.0, 0.0), np.arange(30.0)))
    merged = _sessions_at((0.0, 5.6), last_part=1)
    found = distances(cast("Result", uncut), cast("Result", merged), 0)
    assert found.num_wrong == 0
    assert found.largest < 1e-6
    assert np.isnan(found.of_sessions[2])
