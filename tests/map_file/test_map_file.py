# SPDX-License-Identifier: Apache-2.0
"""A map database gives back the result that it was made of; damage is reported in one line."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cartoloop.config_file import load_config
from cartoloop.errors import InputError
from cartoloop.global_slam.closure_status import Reason, Status
from cartoloop.map_file.read import require_map
from cartoloop.map_file.schema import FILE_NAME
from cartoloop.map_file.write import map_bytes
from cartoloop.map_output.save import save
from cartoloop.report import InputSummary
from cartoloop.result import load_map
from tests.global_slam.closures import (
    INFORMATION,
    add_to_graph,
    closure,
    final_matches,
    record,
    requests,
)
from tests.map_output.small_result import small_result


def full_record():
    """Closures with every fate but that of the small result's own, which is in its graph."""
    closures = record(found=[closure(0, 0, (1.0, 2.0, 0.5), information=INFORMATION, score=0.75)])
    rows = closures.request(requests((0, 1), (0, 0)), 2)
    closures.note_dropped(rows[:1])
    closures.note_searched(rows[1:], 0.625)
    own = closure(0, 1, (1.0, 0.5, 0.1))
    poor = closure(0, 0, residual=0.75)
    [_, last] = closures.note_last_pass(
        np.array([Reason.NO_OVERLAP], dtype=np.int8),
        [final_matches([poor], [Reason.RESIDUAL]), final_matches([own])],
    )
    assert closures.status[last[0]] == Status.FINAL
    return closures


@pytest.fixture
def result():
    config = load_config(settings=["local_slam.submaps.resolution=0.05"]).config
    rng = np.random.default_rng(1)
    made = small_result(
        config, input=InputSummary(name="a log"), skipped={"too dark": 3}, wall_s=5.0
    )
    made.graph.fix_submap(0)
    closures = full_record()
    made.graph.replace_loop_closures([])
    add_to_graph(made.graph, closures)
    return replace(
        made,
        closures=closures,
        node_points=(rng.uniform(-30.0, 30.0, (50, 2)), rng.uniform(-300.0, 300.0, (7, 2))),
    )


@pytest.fixture
def file(result, tmp_path):
    path = tmp_path / "out? #1" / FILE_NAME
    path.parent.mkdir()
    path.write_bytes(map_bytes(result))
    return path


def test_what_was_saved_is_loaded(result, file):
    loaded = load_map(file)

    for name in ("stamps", "trajectory", "local_trajectory", "node_scan_index"):
        assert np.array_equal(getattr(loaded, name), getattr(result, name)), name
    for name in (
        "submap_poses", "node_poses", "kinds", "index_a", "index_b", "relative_poses",
        "informations", "closure_rows",
    ):  # fmt: skip
        values = getattr(loaded.graph, name), getattr(result.graph, name)
        assert np.array_equal(*values, equal_nan=True), name
    for ours, theirs in zip(loaded.submap_grids, result.submap_grids, strict=True):
        assert np.array_equal(ours.cells, theirs.cells)
        assert (ours.origin_x, ours.origin_y) == (theirs.origin_x, theirs.origin_y)
    assert loaded.config == result.config
    assert loaded.report.input == result.report.input
    assert loaded.report.skipped == result.report.skipped
    assert loaded.report.wall_s == 0.0
    for name, column in result.closures.stored().items():
        loaded_column = loaded.closures.stored()[name]
        np.testing.assert_array_equal(loaded_column, column, err_msg=name)
        assert loaded_column.dtype == column.dtype


@pytest.mark.parametrize("finished", [True, False])
def test_whether_the_run_was_finished_is_kept(result, finished, tmp_path):
    report = replace(result.report, finished=finished)
    save(replace(result, report=report), tmp_path)

    assert load_map(tmp_path).report.finished is finished


@pytest.mark.parametrize(("verdict", "finished"), [("good", True), ("unknown", False)])
def test_older_files_are_of_finished_runs_if_examined(file, verdict, finished):
    with closing(sqlite3.connect(file)) as database, database:
        report = json.loads(
            database.execute("SELECT value FROM about WHERE key = 'report'").fetchone()[0]
        )
        del report["finished"]
        report["quality"]["verdict"] = verdict
        database.execute("UPDATE about SET value = ? WHERE key = 'report'", [json.dumps(report)])

    assert load_map(file).report.finished is finished


def test_parameters_of_another_version_are_left_out(result, file):
    with closing(sqlite3.connect(file)) as database, database:
        [saved] = database.execute("SELECT value FROM about WHERE key = 'config'").fetchone()
        config = json.loads(saved)
        config["a section of tomorrow"] = {"a": 1}
        config["local_slam"]["submaps"]["a_parameter_of_tomorrow"] = 2.5
        database.execute("UPDATE about SET value = ? WHERE key = 'config'", [json.dumps(config)])

    assert load_map(file).config == result.config


def test_points_are_kept_to_a_millimetre_near_the_robot(result, file):
    near, far = load_map(file).node_points

    assert np.abs(near - result.node_points[0]).max() <= 0.00051
    assert np.abs(far - result.node_points[1]).max() <= 0.006


def test_bytes_do_not_depend_on_times_and_threads(result):
    threads = load_config(settings=["global_slam.num_threads=4"]).config
    other = replace(result, config=threads, report=replace(result.report, wall_s=9.0))

    assert map_bytes(result) == map_bytes(other)


def test_a_loaded_result_can_be_saved_again(result, tmp_path):
    save(result, tmp_path / "a")

    load_map(tmp_path / "a").save(tmp_path / "b")

    for name in ("map.pgm", "map.png", "graph.g2o", "closures.csv"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


VERSION_2 = """
PRAGMA user_version = 2;
DROP TABLE constraints; DROP TABLE closures; DROP TABLE matches;
CREATE TABLE constraints (
  constraint_id INTEGER PRIMARY KEY, kind INTEGER, a INTEGER, b INTEGER, x REAL, y REAL, theta REAL,
  ixx REAL, ixy REAL, ixt REAL, iyy REAL, iyt REAL, itt REAL, score REAL, runner_up REAL);
INSERT INTO constraints VALUES
  (0, 0, 0, 0, 0.5, 0.5, 0, 1, 0, 0, 1, 0, 1, NULL, NULL),
  (1, 1, 0, 1, 1.0, 0.5, 0.1, 4, 1, 0.5, 5, 0.25, 6, {}),
  (2, 0, 0, 1, 1.0, 0.5, 0.1, 1, 0, 0, 1, 0, 1, NULL, NULL),
  (3, 3, 0, 0, 2.0, 0.5, 0.1, 4, 1, 0.5, 5, 0.25, 6, {});
"""


@pytest.mark.parametrize(
    ("scores", "status"), [("0.75, NULL", Status.FINAL), ("0.75, 0.5", Status.FOUND)]
)
def test_files_of_version_2_are_loaded(file, scores, status):
    with closing(sqlite3.connect(file)) as database:
        database.executescript(VERSION_2.format(scores, scores))

    loaded = load_map(file)

    assert loaded.graph.kinds.tolist() == [0, 1, 0]
    assert loaded.graph.relative_poses[1].tolist() == [1.0, 0.5, 0.1]
    np.testing.assert_array_equal(loaded.graph.informations[1], INFORMATION)
    closures = loaded.closures
    [row] = closures.with_status(status).row
    assert loaded.graph.closure_rows.tolist() == [-1, row, -1]
    assert closures.with_status(Status.CONTRADICTED).tf_submap_node.tolist() == [[2.0, 0.5, 0.1]]
    if status == Status.FINAL:
        assert closures.residual[row] == 0.25
    else:
        assert (closures.score[row], closures.runner_up[row]) == (0.75, 0.5)


@pytest.mark.parametrize(
    ("content", "says"), [(b"", "is empty"), (b"not a database at all" * 100, "is no map database")]
)
def test_other_files_are_refused(tmp_path, content, says):
    (tmp_path / FILE_NAME).write_bytes(content)

    with pytest.raises(InputError, match=says):
        load_map(tmp_path)
    with pytest.raises(InputError, match=says):
        require_map(tmp_path)


def test_a_file_of_another_name_is_no_map_to_be_made_again(tmp_path):
    (tmp_path / "drive.log").write_bytes(b"FLASER 1 2.0\n" * 100)

    with pytest.raises(InputError, match="give a folder that 'cartoloop map' wrote"):
        load_map(tmp_path / "drive.log")


def test_a_map_that_cannot_be_read_is_not_called_damaged(tmp_path, monkeypatch):
    (tmp_path / FILE_NAME).write_bytes(b"")

    def refuse(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(InputError, match="cannot be read: Permission denied; check the file"):
        load_map(tmp_path)


def test_a_folder_without_a_map_is_refused(tmp_path):
    with pytest.raises(InputError, match="is not there; give a folder"):
        load_map(tmp_path)


def test_the_file_of_a_newer_program_is_refused(file):
    change(file, "PRAGMA user_version = 99")

    with pytest.raises(InputError, match="is of version 99, this program reads 2 to 5"):
        load_map(file)


@pytest.mark.parametrize(
    "damage",
    [
        "UPDATE submaps SET cells = x'0102'",
        "UPDATE submaps SET num_rows = 41",
        "UPDATE submaps SET num_rows = -1",
        "UPDATE submaps SET num_rows = 1000000, num_cols = 1000000",
        "UPDATE submaps SET x = NULL",
        "UPDATE nodes SET points = NULL",
        "UPDATE nodes SET scan = 1000",
        "UPDATE nodes SET node = 5 WHERE node = 1",
        "UPDATE constraints SET a = 7",
        "UPDATE constraints SET kind = 9",
        "UPDATE constraints SET a = 9e999",
        "UPDATE constraints SET ixx = NULL",
        "UPDATE constraints SET kind = 1",
        "DELETE FROM constraints",
        "UPDATE closures SET submap = 1",
        "UPDATE closures SET node = -1",
        "UPDATE closures SET status = 99",
        "UPDATE closures SET reason = 1.5",
        "UPDATE closures SET constraint_id = 7 WHERE constraint_id IS NOT NULL",
        "UPDATE closures SET linear_window = NULL",
        "DELETE FROM closures WHERE closure = 0",
        "UPDATE matches SET closure = 9",
        "UPDATE matches SET x = NULL",
        "DELETE FROM matches",
        "DROP TABLE matches",
        "UPDATE nodes SET point_unit = 9e999",
        "UPDATE nodes SET x = -1e300",
        "UPDATE submaps SET y = 1e300",
        "UPDATE nodes SET point_unit = NULL",
        "UPDATE trajectory SET y = 'somewhere'",
        "UPDATE about SET value = '{' WHERE key = 'report'",
        "UPDATE about SET value = '[1]' WHERE key = 'config'",
        "DELETE FROM about",
        "DROP TABLE nodes",
    ],
)
def test_damage_is_reported_in_one_line(file, damage):
    change(file, damage)

    with pytest.raises(InputError, match=r"is damaged \(\w+: .*map the recording again") as error:
        load_map(file)

    assert "\n" not in str(error.value)


def test_a_file_that_was_cut_off_is_refused(file):
    whole = file.read_bytes()
    for share in (0.3, 0.6, 0.9):
        file.write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(InputError):
            load_map(file)


def change(file, statement):
    with closing(sqlite3.connect(file)) as database:
        database.execute(statement)
        database.commit()
