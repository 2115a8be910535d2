# SPDX-License-Identifier: Apache-2.0
"""A map of several sessions with what the newest ones have superseded removed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.global_slam.pose_adjustment import AdjustmentOptions, graph_problem
from cartoloop.lifelong.links import replacements
from cartoloop.lifelong.marginal import host_submaps
from cartoloop.lifelong.renumbering import AnyMap, without
from cartoloop.lifelong.revisits import driven_again
from cartoloop.lifelong.selection import Selection, select
from cartoloop.map_data import MapData, input_left
from cartoloop.pose_adjustment import loss_weights, residuals
from cartoloop.report import summarize_constraints
from cartoloop.session import session_numbers


def trimmed(result: AnyMap) -> AnyMap:
    """Return a map without what later sessions cover, and in which what they contradict faded.

    The poses of what stays do not change. Removed constraints are replaced by a few that say the
    same about it, so that the graph stays connected and as certain. The last session stays whole,
    and so does each part of the map that is apart, but for what its own later sessions cover.

    Parameters
    ----------
    result : an adjusted map; returned as it is where it has one session.
    """
    chosen = _selection(result)
    if chosen is None:
        return result
    graph = result.graph
    kept_nodes = (host_submaps(graph, chosen.kept) >= 0) | (
        host_submaps(graph, np.ones(graph.num_submaps, dtype=bool)) < 0
    )
    original, before = result, _sizes(result)
    result = replace(result, submap_grids=chosen.grids)
    if not chosen.kept.all():
        links = replacements(
            graph, chosen.kept, kept_nodes, _weights(result), result.config.lifelong.memory
        )
        result = without(result, chosen.kept, kept_nodes, links)
    removed = {f"removed_{name}": before[name] - size for name, size in _sizes(result).items()}
    report = replace(
        result.report,
        input=input_left(original, result),
        nodes=result.graph.num_nodes,
        submaps=result.graph.num_submaps,
        constraints=summarize_constraints(result.graph, result.closures),
        extra=result.report.extra | {"lifelong": removed | {"faded_cells": chosen.num_faded}},
    )
    return replace(result, report=report)


def _selection(result: MapData) -> Selection | None:
    """Return what becomes of the submaps; None where no session follows another."""
    firsts = [session.first_submap for session in result.sessions]
    sessions = session_numbers(firsts, result.graph.num_submaps)
    parts = result.submap_parts
    is_driven_again = driven_again(
        result.graph,
        [session.first_node for session in result.sessions],
        sessions,
        result.node_parts,
        result.config.lifelong.revisit_distance,
    )
    kept = np.ones(len(sessions), dtype=bool)
    grids, num_faded, is_any = list(result.submap_grids), 0, False
    for part in np.unique(parts):
        own: IntArray = np.flatnonzero(parts == part)
        if sessions[own[0]] == sessions[own[-1]]:
            continue
        chosen = select(
            [grids[submap] for submap in own],
            result.graph.submap_poses[own],
            sessions[own],
            is_driven_again[own],
            result.config.local_slam.submaps,
            result.config.lifelong,
        )
        is_any = True
        kept[own] = chosen.kept
        num_faded += chosen.num_faded
        for submap, grid in zip(own.tolist(), chosen.grids, strict=True):
            grids[submap] = grid
    return Selection(kept, grids, num_faded) if is_any else None


def _sizes(result: MapData) -> dict[str, int]:
    return {
        "submaps": result.graph.num_submaps,
        "nodes": result.graph.num_nodes,
        "scans": len(result.stamps),
    }


def _weights(result: MapData) -> FloatArray:
    """Return what the robust loss leaves of each constraint at the present poses."""
    config = result.config.global_slam.pose_adjustment
    losses = AdjustmentOptions(loss=config.loss, loss_scale=config.loss_scale).loss_of_kind()
    problem = graph_problem(result.graph)
    squared = residuals(problem).squared
    weights = np.ones(len(squared))
    for group, (loss, scale) in enumerate(losses):
        own = np.flatnonzero(problem.constraints.groups == group)
        weights[own] = loss_weights(squared[own], loss, scale)
    return weights
