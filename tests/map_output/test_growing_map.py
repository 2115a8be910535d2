# SPDX-License-Identifier: Apache-2.0
"""A map that is saved while it grows is the same as one saved once."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

from cartoloop.config import Config
from cartoloop.errors import OutputError
from cartoloop.map_file.schema import FILE_NAME
from cartoloop.map_file.write import map_bytes
from cartoloop.map_output.growing_map import save_growing_map
from cartoloop.map_output.save import save
from tests.map_output.small_result import small_result


def content(file):
    with closing(sqlite3.connect(file)) as database:
        return list(database.iterdump())


@pytest.fixture
def result():
    rng = np.random.default_rng(2)
    made = small_result(Config())
    return replace(made, node_points=tuple(rng.uniform(-9.0, 9.0, (5, 2)) for _ in range(2)))


@pytest.fixture
def saved_once(tmp_path):
    def save(result):
        path = tmp_path / "once"
        path.write_bytes(map_bytes(result))
        return content(path)

    return save


def test_every_save_is_that_of_the_map_as_it_is_then(result, saved_once, tmp_path):
    path = tmp_path / FILE_NAME
    fewer = replace(
        result,
        stamps=result.stamps[:1],
        trajectory=result.trajectory[:1],
        local_trajectory=result.local_trajectory[:1],
    )
    moved = result.graph.copy()
    moved.node_poses[:] += 0.25
    other_points = (result.node_points[0], result.node_points[1] + 1.0)

    for now in (fewer, result, replace(result, graph=moved, node_points=other_points)):
        save_growing_map(now, tmp_path)
        assert content(path) == saved_once(now)


def test_a_save_that_fails_leaves_what_was_there(result, tmp_path, monkeypatch):
    path = tmp_path / FILE_NAME
    save_growing_map(result, tmp_path)
    before = path.read_bytes()

    def full(*_):
        raise sqlite3.OperationalError("database or disk is full")

    monkeypatch.setattr("cartoloop.map_output.growing_map.fill", full)
    with pytest.raises(OutputError, match="disk is full"):
        save_growing_map(result, tmp_path)

    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == [FILE_NAME]


def test_no_file_of_an_earlier_map_stays_beside_a_growing_one(result, tmp_path):
    save(result, tmp_path)

    save_growing_map(result, tmp_path)

    assert [file.name for file in tmp_path.iterdir()] == [FILE_NAME]


def test_a_missing_folder_is_reported(result, tmp_path):
    with pytest.raises(OutputError, match="cannot be written"):
        save_growing_map(result, tmp_path / "gone")
