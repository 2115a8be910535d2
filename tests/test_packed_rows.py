# SPDX-License-Identifier: Apache-2.0
"""Rows that are packed without loss."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop.packed_rows import BLOCK, PackedRows

COUNTS = [0, 1, BLOCK - 1, BLOCK, BLOCK + 1, 2 * BLOCK + 7]


def numbers(count, num_columns=4):
    rows = np.random.default_rng(count).normal(size=(count, num_columns))
    rows[::7] = (np.nan, -0.0, np.inf, 5e-324)
    return rows


@pytest.mark.parametrize("count", COUNTS)
def test_rows_come_back_with_every_bit(count):
    rows, given = PackedRows(4), numbers(count)
    for row in given.tolist():
        rows.append(row)
    assert len(rows) == count
    for some in (count, count // 2, min(count, BLOCK)):
        assert rows.rows(some).tobytes() == given[:some].tobytes()


def test_rows_can_be_added_at_once_and_one_by_one():
    rows, given = PackedRows(4), numbers(BLOCK + 20)
    rows.extend(given[: BLOCK - 5])
    for row in given[BLOCK - 5 :].tolist():
        rows.append(row)
    rows.extend(given)
    assert rows.rows(len(rows)).tobytes() == given.tobytes() + given.tobytes()


def test_a_reader_gets_what_was_there_while_rows_are_added():
    """Also where a block was packed in between."""
    rows, given = PackedRows(4), numbers(3 * BLOCK)
    rows.extend(given[: 2 * BLOCK - 1])
    before = rows._packed_and_open
    rows.extend(given[2 * BLOCK - 1 :])
    rows._packed_and_open = before
    assert rows.rows(2 * BLOCK - 1).tobytes() == given[: 2 * BLOCK - 1].tobytes()


def test_the_poses_of_a_robot_that_stands_take_two_thirds():
    rng = np.random.default_rng(0)
    rows, count = PackedRows(4), 4 * BLOCK
    for number in range(count):
        pose = np.array((12.0, -3.0, 1.5)) + rng.normal(0.0, 1e-4, 3)
        rows.append((1.7e9 + 0.2 * number + rng.normal(0.0, 1e-3), *pose.tolist()))
    assert sum(map(len, rows._packed_and_open[0])) < 0.67 * 32 * count
