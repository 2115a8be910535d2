# SPDX-License-Identifier: Apache-2.0
"""Loop closures (section V-B), asked for and found: structured arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph

IntArray = NDArray[np.int64]

REQUEST = np.dtype(
    [
        ("number", np.int64),
        ("submap", np.int64),
        ("node", np.int64),
        ("node_submap", np.int64),
        ("tf_submap_node", np.float64, 3),
        ("linear_window", np.float64),
        ("angular_window", np.float64),
        ("num_nodes", np.int64),
    ]
)
"""A node to be sought in a finished submap.

number : counts the requests; what is found joins the graph in their order.
submap, node : their indices in the pose graph.
node_submap : the older submap that the node was inserted into.
tf_submap_node : estimate, the centre of the window [m, m, rad].
linear_window, angular_window : how far to search each way [m], [rad].
num_nodes : how many nodes the graph had when it was asked for.
"""

CLOSURE = np.dtype(
    [
        ("submap", np.int64),
        ("node", np.int64),
        ("tf_submap_node", np.float64, 3),
        ("information", np.float64, (3, 3)),
        ("score", np.float64),
        ("runner_up", np.float64),
    ]
)
"""A node that fits in a submap that it was not inserted into.

submap, node : their indices in the pose graph.
tf_submap_node : where it was found [m, m, rad].
information : inverse covariance, submap axes.
score : how well the node's returns fit there, in [0, 1].
runner_up : score of the best match elsewhere in the window, 0 where none was good enough; NaN where
    none was sought.
"""

FOUND = np.dtype([*((name, CLOSURE[name]) for name in CLOSURE.names or ()), ("request", REQUEST)])
"""A :data:`CLOSURE` that a search found, with what was asked for; its score is the mean probability
of the node's returns."""

Requests = NDArray[np.void]
"""Many of :data:`REQUEST`, shape (n,)."""

Closures = NDArray[np.void]
"""Many of :data:`CLOSURE` or :data:`FOUND`, shape (n,)."""

NO_CLOSURES: Closures = np.zeros(0, CLOSURE)
NONE_FOUND: Closures = np.zeros(0, FOUND)


def closures_in(graph: PoseGraph, constraints: NDArray[np.bool_]) -> Closures:
    """Return the constraints marked, shape (num_constraints,), all of which are closures."""
    closures = np.zeros(np.count_nonzero(constraints), CLOSURE)
    closures["submap"] = graph.index_a[constraints]
    closures["node"] = graph.index_b[constraints]
    closures["tf_submap_node"] = graph.relative_poses[constraints]
    closures["information"] = graph.informations[constraints]
    closures["score"] = graph.scores[constraints]
    closures["runner_up"] = graph.runner_ups[constraints]
    return closures


def add_closures(graph: PoseGraph, closures: Closures) -> None:
    """Add loop closures to a graph."""
    graph.add_constraints(
        ConstraintKind.LOOP_CLOSURE,
        closures["submap"],
        closures["node"],
        closures["tf_submap_node"],
        closures["information"],
        scores=closures["score"],
        runner_ups=closures["runner_up"],
    )
