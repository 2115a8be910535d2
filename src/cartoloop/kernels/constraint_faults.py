# SPDX-License-Identifier: Apache-2.0
"""What is wrong with constraints that are to join a pose graph."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

NOTHING, NO_START, NO_END, SAME_NODE, NOT_FINITE, NOT_SYMMETRIC, NEGATIVE = range(7)


@kernel
def fault_of_ends(
    is_between_nodes: bool, index_a: int, index_b: int, num_nodes: int, num_submaps: int
) -> int:
    """Return what is wrong with the ends of a constraint, or `NOTHING`."""
    if index_a < 0 or index_a >= (num_nodes if is_between_nodes else num_submaps):
        return NO_START
    if index_b < 0 or index_b >= num_nodes:
        return NO_END
    if is_between_nodes and index_a == index_b:
        return SAME_NODE
    return NOTHING


@kernel
def fault_of_measurement(pose: FloatArray, information: FloatArray, asymmetry: float) -> int:
    """Return what is wrong with a relative pose (3,) or its information (3, 3), or `NOTHING`."""
    size = 0.0
    for i in range(3):
        if not math.isfinite(pose[i]):
            return NOT_FINITE
        for j in range(3):
            if not math.isfinite(information[i, j]):
                return NOT_FINITE
            size = max(size, abs(information[i, j]))
    for i in range(3):
        for j in range(i):
            if abs(information[i, j] - information[j, i]) > asymmetry * size:
                return NOT_SYMMETRIC
    for i in range(3):
        if information[i, i] < 0.0:
            return NEGATIVE
    return NOTHING


@kernel
def first_fault(
    kinds: IntArray,
    index_a: IntArray,
    index_b: IntArray,
    relative_poses: FloatArray,
    informations: FloatArray,
    num_nodes: int,
    num_submaps: int,
    between_nodes: int,
    asymmetry: float,
) -> int:
    """Return the fault of the first faulty constraint, or `NOTHING`.

    Parameters
    ----------
    kinds, index_a, index_b : int64, shape (n,).
    relative_poses, informations : float64, shapes (n, 3), (n, 3, 3).
    num_nodes, num_submaps : of the graph.
    between_nodes : the kind of constraints that start at nodes; all others start at submaps.
    asymmetry : what rounding may leave between two halves of a matrix, as a share of its largest
        entry.
    """
    for k in range(kinds.shape[0]):
        fault = fault_of_ends(
            kinds[k] == between_nodes, index_a[k], index_b[k], num_nodes, num_submaps
        )
        if fault == NOTHING:
            fault = fault_of_measurement(relative_poses[k], informations[k], asymmetry)
        if fault != NOTHING:
            return fault
    return NOTHING
