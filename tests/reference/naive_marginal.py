# SPDX-License-Identifier: Apache-2.0
"""The marginal of a pose graph, with numeric derivatives and dense matrices."""

from __future__ import annotations

import numpy as np

from cartoloop.global_slam.pose_graph import ConstraintKind
from cartoloop.sensor.pose import Pose, relative, wrap_angle

_STEP = 1e-6


def _residual(graph, poses, constraint):
    is_node = graph.kinds[constraint] == ConstraintKind.NODE_TO_NODE
    first = graph.index_a[constraint] + graph.num_submaps * is_node
    second = graph.index_b[constraint] + graph.num_submaps
    seen = np.array(relative(Pose(*poses[first]), Pose(*poses[second])))
    error = graph.relative_poses[constraint] - seen
    error[2] = wrap_angle(error[2])
    return error


def naive_hessian(graph, constraints, stand):
    """Return matrix and gradient of the cost of constraints, Gauss-Newton.

    `stand(changes)` gives the poses of all vertices by the changes of the vertices that count.
    """
    count = stand(None)
    matrix, gradient = np.zeros((count, count)), np.zeros(count)
    for constraint in constraints:
        columns = []
        for axis in range(count):
            step = np.zeros(count)
            step[axis] = _STEP
            ahead, behind = (_residual(graph, stand(s * step), constraint) for s in (1, -1))
            columns.append((ahead - behind) / (2 * _STEP))
        jacobian = np.stack(columns, axis=1)
        information = graph.informations[constraint]
        error = _residual(graph, stand(np.zeros(count)), constraint)
        matrix += jacobian.T @ information @ jacobian
        gradient += jacobian.T @ information @ error
    return matrix, gradient


def naive_schur(matrix, gradient, kept):
    """Return matrix and gradient of the kept variables after the others are eliminated."""
    gone = np.setdiff1d(np.arange(len(matrix)), kept)
    inverse = np.linalg.pinv(matrix[np.ix_(gone, gone)])
    across = matrix[np.ix_(kept, gone)]
    return (
        matrix[np.ix_(kept, kept)] - across @ inverse @ across.T,
        gradient[kept] - across @ inverse @ gradient[gone],
    )
