# SPDX-License-Identifier: Apache-2.0
"""What is wrong with constraints, against words of one syllable."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.kernels import constraint_faults as faults

NUM_NODES, NUM_SUBMAPS, BETWEEN_NODES, ASYMMETRY = 5, 3, 2, 1e-9


def naive_fault(kind, a, b, pose, information):
    """What is wrong with one constraint."""
    between_nodes = kind == BETWEEN_NODES
    if a not in range(NUM_NODES if between_nodes else NUM_SUBMAPS):
        return faults.NO_START
    if b not in range(NUM_NODES):
        return faults.NO_END
    if between_nodes and a == b:
        return faults.SAME_NODE
    if not (np.isfinite(pose).all() and np.isfinite(information).all()):
        return faults.NOT_FINITE
    if (abs(information - information.T) > ASYMMETRY * abs(information).max()).any():
        return faults.NOT_SYMMETRIC
    return faults.NEGATIVE if (np.diag(information) < 0.0).any() else faults.NOTHING


def spoiled(values, rng, value):
    """The values, one of them another."""
    values = values.copy()
    values[tuple(rng.integers(0, size) for size in values.shape)] = value
    return values


def some_constraint(rng):
    kind = int(rng.integers(0, 3))
    end_a = NUM_NODES if kind == BETWEEN_NODES else NUM_SUBMAPS
    a, b, pose = int(rng.integers(0, end_a)), int(rng.integers(0, NUM_NODES)), rng.normal(size=3)
    root = rng.normal(size=(3, 3))
    information = root @ root.T
    match int(rng.integers(0, 12)):
        case 0:
            a = int(rng.choice((-1, end_a)))
        case 1:
            b = int(rng.choice((-1, NUM_NODES)))
        case 2:
            pose = spoiled(pose, rng, rng.choice((np.nan, np.inf)))
        case 3:
            information = spoiled(information, rng, rng.choice((np.nan, -np.inf)))
        case 4:
            information = spoiled(information, rng, 9.0)
        case 5:
            information = information - 2.0 * np.diag(np.diag(information))
        case 6:
            information[1, 0] *= 1.0 + 1e-13
    return kind, a, b, pose, information


@settings(deadline=None, max_examples=200)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(0, 4))
def test_the_first_fault_is_returned(seed, count):
    rng = np.random.default_rng(seed)
    constraints = [some_constraint(rng) for _ in range(count)]
    found = [naive_fault(*constraint) for constraint in constraints]
    expected = next((fault for fault in found if fault != faults.NOTHING), faults.NOTHING)
    columns = list(zip(*constraints, strict=True)) or [()] * 5

    fault = faults.first_fault(
        *(np.array(column, dtype=np.int64) for column in columns[:3]),
        np.array(columns[3]).reshape(-1, 3),
        np.array(columns[4]).reshape(-1, 3, 3),
        NUM_NODES, NUM_SUBMAPS, BETWEEN_NODES, ASYMMETRY,
    )  # fmt: skip

    assert fault == expected
