# SPDX-License-Identifier: Apache-2.0
"""Trajectories as TUM files and the pose graph as a g2o file."""

from __future__ import annotations

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph


def tum_text(stamps: FloatArray, poses: FloatArray) -> str:
    """Return a trajectory as TUM text: ``stamp tx ty tz qx qy qz qw``, one pose a line.

    Parameters
    ----------
    stamps : float64 (n,) [s]; written so that they read back as exactly the same numbers.
    poses : float64 (n, 3) [m, m, rad]; written to 1e-9.
    """
    lines = ["# timestamp tx ty tz qx qy qz qw"]
    half = poses[:, 2] / 2.0
    table = np.column_stack((poses[:, :2], np.sin(half), np.cos(half))) + 0.0  # no -0.0
    lines += [
        f"{format_stamp(stamp)} {x:.9f} {y:.9f} 0 0 0 {qz:.9f} {qw:.9f}"
        for stamp, (x, y, qz, qw) in zip(stamps.tolist(), table.tolist(), strict=True)
    ]
    return "\n".join(lines) + "\n"


def format_stamp(stamp: float) -> str:
    """Return a stamp [s] with at least 6 decimals, or as many as make it unique."""
    text = f"{stamp:.6f}"
    if float(text) == stamp:
        return text
    return np.format_float_positional(stamp, unique=True, min_digits=6)


def g2o_text(graph: PoseGraph) -> str:
    """Return the pose graph in g2o's 2D text format.

    Nodes have their indices as ids, submaps follow at an offset that a comment states.

    Notes
    -----
    The error of eq. (5) is expressed in the frame of a, g2o's in that of the measured b; they
    differ by the measured rotation R, so the information becomes R^T I R.
    """
    num_nodes = graph.num_nodes
    lines = [
        f"# nodes have the ids 0 to {num_nodes - 1}, submaps those from {num_nodes} on"
        if num_nodes
        else "# an empty graph"
    ]
    # Without -0.0, which a map database does not keep.
    vertices = np.concatenate((graph.node_poses, graph.submap_poses)) + 0.0
    lines += [f"VERTEX_SE2 {i} {x!r} {y!r} {t!r}" for i, (x, y, t) in enumerate(vertices.tolist())]
    fixed = [*graph.fixed_nodes, *(num_nodes + submap for submap in graph.fixed_submaps)]
    if fixed:
        lines.append(f"FIX {' '.join(map(str, fixed))}")
    ids_a = np.where(
        graph.kinds == ConstraintKind.NODE_TO_NODE, graph.index_a, graph.index_a + num_nodes
    )
    upper = _in_frame_of_b(graph.informations, graph.relative_poses[:, 2])[:, *np.triu_indices(3)]
    values = np.column_stack((graph.relative_poses, upper)) + 0.0
    lines += [
        f"EDGE_SE2 {a} {b} {' '.join(map(repr, numbers))}"
        for a, b, numbers in zip(
            ids_a.tolist(), graph.index_b.tolist(), values.tolist(), strict=True
        )
    ]
    return "\n".join(lines) + "\n"


def _in_frame_of_b(informations: FloatArray, theta: FloatArray) -> FloatArray:
    """Return R^T I R for informations (n, 3, 3) and rotations theta (n,) [rad] about z."""
    rotation = np.zeros((len(theta), 3, 3))
    rotation[:, 0, 0] = rotation[:, 1, 1] = np.cos(theta)
    rotation[:, 1, 0] = np.sin(theta)
    rotation[:, 0, 1] = -rotation[:, 1, 0]
    rotation[:, 2, 2] = 1.0
    rotated: FloatArray = rotation.transpose(0, 2, 1) @ informations @ rotation
    return rotated
