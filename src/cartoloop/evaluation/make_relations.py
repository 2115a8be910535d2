# SPDX-License-Identifier: Apache-2.0
"""Relations between scans from a run that closed its loops, to score local SLAM by.

As Cartographer's tool for the purpose does: where a loop was closed after a long way, and the
whole graph agrees with the closure, the optimised poses of the two places are believed. That says
how far local SLAM drifted on the way. It says nothing about the run that the relations are from.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import IntArray
from cartoloop.errors import InputError
from cartoloop.evaluation.finished_run import FinishedRun, Stage
from cartoloop.evaluation.relations import Relations
from cartoloop.evaluation.trajectories import read_tum
from cartoloop.map_output.text_files import format_stamp
from cartoloop.sensor.pose import relative_all

MIN_DISTANCE_M = 100.0
MAX_TRANSLATION_M = 0.15
MAX_ROTATION_RAD = 0.02


def make_relations(
    run: FinishedRun,
    min_distance: float = MIN_DISTANCE_M,
    max_translation: float = MAX_TRANSLATION_M,
    max_rotation: float = MAX_ROTATION_RAD,
) -> Relations:
    """Return a relation for each loop closure in the graph that the graph agrees with.

    It joins the scan in the middle of those that made the submap with the scan that was found in
    it, the earlier one first, both of one session: local SLAM relates no others. In the order of
    their first scans; none is there twice, and none names a scan by a stamp that another scan of
    the run has as well.

    Parameters
    ----------
    run : with optimised poses.
    min_distance : way between the two scans at least [m], from node to node.
    max_translation, max_rotation : closures violated by more are left out [m], [rad].

    Raises
    ------
    InputError
        No closure is left, or the run's ``trajectory.tum`` cannot be read or is not its own.
    """
    closures = run.closures[Stage.FINAL]
    sessions = run.node_sessions
    steps = np.hypot(*np.diff(run.node_poses[:, :2], axis=0).T) * (np.diff(sessions) == 0)
    travelled = np.concatenate(([0.0], np.cumsum(steps)))
    submap_node = _middle_nodes(run)[closures.submap]
    agrees = (closures.residual_m <= max_translation) & (
        np.radians(closures.residual_deg) <= max_rotation
    )
    far = np.abs(travelled[closures.node] - travelled[submap_node]) >= min_distance
    is_of_one = sessions[closures.node] == sessions[submap_node]
    named = _has_own_stamp(run)
    named_pair = named[closures.node] & named[submap_node]
    chosen = agrees & far & is_of_one & named_pair
    pairs = np.sort(np.column_stack((submap_node, closures.node))[chosen], axis=1)
    pairs = np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0)
    if len(pairs) == 0:
        raise InputError(
            f"{run.folder}: of {len(closures)} loop closures none both agrees with the map and "
            f"comes after a path of {min_distance:g} m (the run is {travelled[-1]:.0f} m long): "
            "try a smaller --min-distance"
        )
    first, second = pairs.T
    return Relations(
        stamps=run.stamps[pairs],
        poses=relative_all(run.node_poses[first], run.node_poses[second]),
    )


def relations_text(relations: Relations) -> str:
    """Return relations as lines ``stamp1 stamp2 x y z roll pitch yaw``, in metres and radians.

    There is no header: not all programs that read such files would pass over it.
    """
    return "".join(
        f"{format_stamp(stamp_1)} {format_stamp(stamp_2)} {x:.9f} {y:.9f} 0 0 0 {theta:.9f}\n"
        for (stamp_1, stamp_2), (x, y, theta) in zip(
            relations.stamps.tolist(), (relations.poses + 0.0).tolist(), strict=True
        )
    )


def _has_own_stamp(run: FinishedRun) -> NDArray[np.bool_]:
    """Return which nodes' scans no other scan of the run has the stamp of, shape (n,)."""
    path = run.folder / "trajectory.tum"
    stamps, counts = np.unique(read_tum(path).stamps, return_counts=True)
    if not np.all(np.isin(run.stamps, stamps)):
        raise InputError(f"{path}: is not of the same run as nodes.csv beside it; map again")
    own: NDArray[np.bool_] = ~np.isin(run.stamps, stamps[counts > 1])
    return own


def _middle_nodes(run: FinishedRun) -> IntArray:
    """Return the node in the middle of those inserted into each submap, shape (num_submaps,)."""
    order = np.lexsort((run.own_node, run.own_submap))
    ordered = run.own_submap[order]
    submaps = np.arange(run.num_submaps)
    begin, end = np.searchsorted(ordered, submaps), np.searchsorted(ordered, submaps, side="right")
    middle: IntArray = run.own_node[order][np.minimum((begin + end) // 2, len(order) - 1)]
    return middle
