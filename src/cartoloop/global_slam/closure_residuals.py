# SPDX-License-Identifier: Apache-2.0
"""By how much closures disagree with the poses of nodes and submaps, and their weight then."""

from __future__ import annotations

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.config import PoseAdjustmentConfig
from cartoloop.global_slam.closure_matches import Matched
from cartoloop.global_slam.pose_graph import TRUE_ROTATION_RAD, TRUE_TRANSLATION_M
from cartoloop.pose_adjustment import loss_weights
from cartoloop.sensor.pose import relative_all, wrap_angles


def pose_errors(closures: Matched, submap_poses: FloatArray, node_poses: FloatArray) -> FloatArray:
    """Return measured minus estimated tf_submap_node, shape (n, 3) [m, m, rad], submap axes.

    Parameters
    ----------
    closures : n of them.
    submap_poses, node_poses : shapes (m, 3), (k, 3), adjusted or true, of all.
    """
    errors: FloatArray = closures.tf_submap_node - relative_all(
        submap_poses[closures.submap], node_poses[closures.node]
    )
    errors[:, 2] = wrap_angles(errors[:, 2])
    return errors


def residuals(
    closures: Matched, submap_poses: FloatArray, node_poses: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return translation [m] and rotation [rad] that closures disagree by, shapes (n,)."""
    errors = pose_errors(closures, submap_poses, node_poses)
    return np.hypot(errors[:, 0], errors[:, 1]), np.abs(errors[:, 2])


def precision(
    translation_error: FloatArray, rotation_error: FloatArray, num_contradicted: int = 0
) -> float | None:
    """Return the share of closures within 20 cm and 1 degree (table IV), None without any.

    Parameters
    ----------
    translation_error, rotation_error : shape (n,) [m], [rad].
    num_contradicted : further closures that count as wrong.
    """
    good = (translation_error <= TRUE_TRANSLATION_M) & (rotation_error <= TRUE_ROTATION_RAD)
    total = len(good) + num_contradicted
    return float(np.count_nonzero(good)) / total if total else None


def weights(
    closures: Matched,
    submap_poses: FloatArray,
    node_poses: FloatArray,
    config: PoseAdjustmentConfig,
) -> FloatArray:
    """Return the factor of each closure's information under the robust loss, in [0, 1], (n,).

    Of closures outside the graph, the weight that they would have.
    """
    errors = pose_errors(closures, submap_poses, node_poses)
    squared = np.maximum(np.einsum("ni,nij,nj->n", errors, closures.information, errors), 0.0)
    return loss_weights(squared, config.loss, config.loss_scale)
