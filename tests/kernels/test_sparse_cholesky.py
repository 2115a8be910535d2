# SPDX-License-Identifier: Apache-2.0
"""Ordering, symbolic and numeric factorization against dense linear algebra."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.kernels import sparse_cholesky
from cartoloop.kernels.sparse_cholesky.arrays import both_halves
from cartoloop.kernels.sparse_cholesky.fronts import front_rows
from cartoloop.kernels.sparse_cholesky.ordering import minimum_degree

UPPER = [0, 1, 2, 4, 5, 8]  # numbers of a diagonal block that are read

seeds = st.integers(0, 2**32 - 1)
sizes = st.integers(1, 40)
densities = st.floats(0.0, 0.5)


def random_pattern(seed, n, density):
    """Return a symmetric boolean matrix with an empty diagonal."""
    upper = np.triu(np.random.default_rng(seed).random((n, n)) < density, 1)
    return upper | upper.T


def grid_pattern(side):
    """Return which cells of a square grid are neighbours."""
    x, y = np.divmod(np.arange(side * side), side)
    return np.abs(x[:, None] - x) + np.abs(y[:, None] - y) == 1


def upper_blocks(pattern):
    rows, columns = np.nonzero(np.triu(pattern, 1))
    begin = np.searchsorted(rows, np.arange(len(pattern) + 1))
    return begin.astype(np.int64), columns.astype(np.int64)


def eliminated_structure(pattern, order):
    """Return the pattern in this order, with all that fills in during elimination."""
    filled = pattern[np.ix_(order, order)].copy()
    for k in range(len(order)):
        later = np.flatnonzero(filled[k, k + 1 :]) + k + 1
        filled[np.ix_(later, later)] = True
    np.fill_diagonal(filled, False)
    return filled


def random_system(seed, pattern):
    """Return the blocks of a positive definite system, a right side, and the system dense."""
    rng = np.random.default_rng(seed)
    n = len(pattern)
    begin, columns = upper_blocks(pattern)
    dense = np.zeros((3 * n, 3 * n))
    blocks = np.full((n + 1 + columns.size, 9), np.nan)
    for k in range(n):
        for i in range(begin[k], begin[k + 1]):
            block = rng.normal(size=(3, 3))
            blocks[n + 1 + i] = block.ravel()
            dense[3 * k : 3 * k + 3, 3 * columns[i] : 3 * columns[i] + 3] = block
    dense += dense.T
    dense += np.diag(np.abs(dense).sum(axis=1) + rng.uniform(0.1, 2.0, 3 * n))
    for k in range(n):
        own = dense[3 * k : 3 * k + 3, 3 * k : 3 * k + 3]
        own += 0.05 * (np.ones((3, 3)) - np.eye(3))
        blocks[k, UPPER] = own.ravel()[UPPER]
    return blocks, rng.normal(size=(n + 1, 3)), dense


def factor_and_solve(pattern, blocks, right, damping=0.0):
    """Return the solution of H x = -right, half of right^T H^-1 right; None if not definite."""
    n = len(pattern)
    plan = sparse_cholesky.plan(*upper_blocks(pattern))
    work = sparse_cholesky.workspace(plan)
    for stack in (work.even_stack, work.odd_stack):
        stack.fill(np.nan)
    solution = np.full((n + 1, 3), 7.0)
    energy, is_definite = sparse_cholesky.solve(plan, blocks, right, damping, work, solution)
    if not is_definite:
        return None
    return solution, energy


@given(seeds, sizes, densities)
@settings(deadline=None)
def test_the_elimination_order_has_each_vertex_once(seed, n, density):
    begin, neighbours = both_halves(*upper_blocks(random_pattern(seed, n, density)))
    order, group_begin, num_groups = minimum_degree(begin, neighbours)
    assert sorted(order) == list(range(n))
    assert group_begin[0] == 0
    assert group_begin[num_groups] == n
    assert np.all(np.diff(group_begin[: num_groups + 1]) > 0)


@given(seeds, sizes, densities)
@settings(deadline=None)
def test_fronts_hold_all_that_fills_in(seed, n, density):
    pattern = random_pattern(seed, n, density)
    begin, neighbours = both_halves(*upper_blocks(pattern))
    order, group_begin, num_groups = minimum_degree(begin, neighbours)
    group_begin = group_begin[: num_groups + 1]
    filled = eliminated_structure(pattern, order)
    row_begin, rows, parent = front_rows(begin, neighbours, order, group_begin)
    for f in range(num_groups):
        pivots = range(group_begin[f], group_begin[f + 1])
        end = group_begin[f + 1]
        expected = np.flatnonzero(filled[pivots][:, end:].any(axis=0)) + end
        ours = rows[row_begin[f] : row_begin[f + 1]]
        np.testing.assert_array_equal(ours[::-1], expected)
        if ours.size > 0:
            assert group_begin[parent[f]] <= ours[-1] < group_begin[parent[f] + 1]
        else:
            assert parent[f] == -1


def test_groups_that_are_eliminated_at_once_store_no_zeros():
    pattern = random_pattern(3, 60, 0.06)
    begin, neighbours = both_halves(*upper_blocks(pattern))
    order, group_begin, num_groups = minimum_degree(begin, neighbours)
    filled = eliminated_structure(pattern, order)
    for f in range(num_groups):
        first, end = group_begin[f], group_begin[f + 1]
        assert filled[first:end, first:end].sum() == (end - first) * (end - first - 1)


def test_a_grid_fills_in_far_less_than_row_by_row():
    side = 24
    pattern = grid_pattern(side)
    order = minimum_degree(*both_halves(*upper_blocks(pattern)))[0]
    by_rows = eliminated_structure(pattern, np.arange(side * side)).sum()
    assert eliminated_structure(pattern, order).sum() < 0.55 * by_rows


def test_a_tree_does_not_fill_in_at_all():
    parents = np.random.default_rng(0).integers(0, np.arange(1, 80))
    pattern = np.zeros((80, 80), dtype=bool)
    pattern[np.arange(1, 80), parents] = pattern[parents, np.arange(1, 80)] = True
    order = minimum_degree(*both_halves(*upper_blocks(pattern)))[0]
    assert eliminated_structure(pattern, order).sum() == pattern.sum()


@given(seeds, sizes, densities, st.sampled_from([0.0, 0.3]))
@settings(deadline=None)
def test_the_solution_is_that_of_dense_algebra(seed, n, density, damping):
    pattern = random_pattern(seed, n, density)
    blocks, right, dense = random_system(seed, pattern)
    dense += damping * np.diag(np.diag(dense))
    expected = np.linalg.solve(dense, -right[:n].ravel())
    solution, energy = factor_and_solve(pattern, blocks, right, damping)
    np.testing.assert_allclose(solution[:n].ravel(), expected, rtol=1e-9, atol=1e-12)
    assert energy == pytest.approx(-0.5 * right[:n].ravel() @ expected, rel=1e-9)
    np.testing.assert_array_equal(solution[n], 7.0)


@pytest.mark.parametrize(
    "pattern", [grid_pattern(12), random_pattern(1, 90, 0.8)], ids=["grid", "dense"]
)
def test_large_fronts_are_solved_as_exactly(pattern):
    blocks, right, dense = random_system(0, pattern)
    n = len(pattern)
    solution, _ = factor_and_solve(pattern, blocks, right)
    expected = np.linalg.solve(dense, -right[:n].ravel())
    np.testing.assert_allclose(solution[:n].ravel(), expected, rtol=1e-9, atol=1e-12)


def test_an_indefinite_and_a_singular_system_are_noticed():
    pattern = grid_pattern(4)
    blocks, right, _ = random_system(0, pattern)
    indefinite, singular = blocks.copy(), blocks.copy()
    indefinite[7, 4] = -1.0
    singular[5, [2, 5, 8]] = 0.0
    assert factor_and_solve(pattern, blocks, right) is not None
    assert factor_and_solve(pattern, indefinite, right) is None
    assert factor_and_solve(pattern, singular, right) is None
