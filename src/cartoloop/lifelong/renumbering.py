# SPDX-License-Identifier: Apache-2.0
"""A map without some of its submaps and nodes: what is left is numbered again."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import BoolArray, IntArray
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.pose_graph import NO_ROW, ConstraintKind, PoseGraph
from cartoloop.lifelong.links import Links
from cartoloop.lifelong.marginal import host_submaps, touching
from cartoloop.map_data import MapData
from cartoloop.session import Session, ranges, session_numbers

AnyMap = TypeVar("AnyMap", bound=MapData)


class Numbers:
    """The numbers of what is kept.

    Parameters
    ----------
    kept : bool, shape (n,).

    Attributes
    ----------
    kept : see above.
    new : int64, shape (n + 1,), number of each afterwards, if it is kept: how many are kept
        before it.
    """

    def __init__(self, kept: BoolArray) -> None:
        self.kept = kept
        self.new: IntArray = np.concatenate(([0], np.cumsum(kept, dtype=np.int64)))


def without(result: AnyMap, kept_submaps: BoolArray, kept_nodes: BoolArray, links: Links) -> AnyMap:
    """Return a map that lacks submaps and nodes, their constraints, closures and scans.

    Parameters
    ----------
    result : the map.
    kept_submaps, kept_nodes : bool, shapes (m,), (n,).
    links : constraints between nodes that stay, added to the graph; numbered as in `result`.
    """
    submaps, nodes = Numbers(kept_submaps), Numbers(kept_nodes)
    scans = Numbers(_kept_scans(result, kept_nodes))
    hosts = host_submaps(result.graph, kept_submaps)
    closures, rows = _closures(result.closures, submaps, nodes, hosts)
    points = result.node_points
    stretches = _stretches(result, scans, nodes, submaps, hosts)
    return replace(
        result,
        stamps=result.stamps[scans.kept],
        trajectory=result.trajectory[scans.kept],
        local_trajectory=result.local_trajectory[scans.kept],
        graph=_graph(result.graph, submaps, nodes, rows, links),
        node_scan_index=scans.new[result.node_scan_index[kept_nodes]],
        submap_grids=[
            grid for grid, kept in zip(result.submap_grids, kept_submaps, strict=True) if kept
        ],
        closures=closures,
        node_points=[points[node] for node in np.flatnonzero(kept_nodes[: len(points)]).tolist()],
        sessions=tuple(session for some in stretches for session in some),
        report=replace(result.report, extra=_with_joins(result.report.extra, stretches)),
    )


def _kept_scans(result: MapData, kept_nodes: BoolArray) -> BoolArray:
    """Return which scans stay: those between two nodes that stay, and these themselves.

    A scan before the first node of its session, or behind the last, stays if that node does.
    """
    count, num_nodes = len(result.stamps), len(kept_nodes)
    scan_sessions = session_numbers([session.first_scan for session in result.sessions], count)
    node_sessions = session_numbers([session.first_node for session in result.sessions], num_nodes)
    scans = np.arange(count)
    before = np.searchsorted(result.node_scan_index, scans, side="right") - 1
    after = np.searchsorted(result.node_scan_index, scans, side="left")
    kept = np.ones(count, dtype=bool)
    for near in (before, after):
        inside = (near >= 0) & (near < num_nodes)
        inside[inside] = node_sessions[near[inside]] == scan_sessions[inside]
        kept[inside] &= kept_nodes[near[inside]]
    return kept


def _graph(
    graph: PoseGraph, submaps: Numbers, nodes: Numbers, rows: Numbers, links: Links
) -> PoseGraph:
    kept = ~touching(graph, submaps.kept, nodes.kept)
    kinds, closure_rows = graph.kinds[kept], graph.closure_rows[kept].astype(np.int64)
    index_a = graph.index_a[kept]
    from_node = kinds == ConstraintKind.NODE_TO_NODE
    smaller = PoseGraph()
    smaller.add_submaps(graph.submap_poses[submaps.kept])
    smaller.add_nodes(graph.node_poses[nodes.kept])
    smaller.add_constraints(
        kinds,
        np.where(
            from_node,
            nodes.new[np.where(from_node, index_a, 0)],
            submaps.new[np.where(from_node, 0, index_a)],
        ),
        nodes.new[graph.index_b[kept]],
        graph.relative_poses[kept],
        graph.informations[kept],
        closure_rows=np.where(closure_rows == NO_ROW, NO_ROW, rows.new[closure_rows]),
        is_trusted=graph.is_trusted[kept],
    )
    links.numbered(submaps.new, nodes.new).add_to(smaller)
    for submap in graph.fixed_submaps:
        if submaps.kept[submap]:
            smaller.fix_submap(int(submaps.new[submap]))
    for node in graph.fixed_nodes:
        if nodes.kept[node]:
            smaller.fix_node(int(nodes.new[node]))
    if smaller.num_submaps and not smaller.fixed_submaps and not smaller.fixed_nodes:
        smaller.fix_submap(0)
    return smaller


def _closures(
    closures: Closures, submaps: Numbers, nodes: Numbers, hosts: IntArray
) -> tuple[Closures, Numbers]:
    """Return the record of the pairs that are left, and the numbers of its rows."""
    rows = Numbers(submaps.kept[closures.submap] & nodes.kept[closures.node])
    asked = np.flatnonzero(rows.kept[: closures.num_requested])
    requests = closures.requests(_narrow(asked))
    own_submap = np.where(
        submaps.kept[requests.node_submap], requests.node_submap, hosts[requests.node]
    )
    table = closures.match_table
    matches = np.flatnonzero(rows.kept[table.row])
    found = matches[matches < closures.num_found]
    left = table._replace(
        row=rows.new[table.row[matches]],
        tf_submap_node=table.tf_submap_node[matches],
        information=table.information[matches],
        residual=table.residual[matches],
        moved=table.moved[matches],
        score=table.score[found],
        runner_up=table.runner_up[found],
        joined_at=_narrow(nodes.new[table.joined_at[found]]),
    )
    restored = Closures.restored(
        (submaps.new[closures.submap[rows.kept]], nodes.new[closures.node[rows.kept]]),
        (
            closures.status[rows.kept].astype(np.int64),
            closures.reason[rows.kept].astype(np.int64),
            closures.search_status[rows.kept].astype(np.int64),
        ),
        requests._replace(
            submap=_narrow(submaps.new[requests.submap]),
            node=_narrow(nodes.new[requests.node]),
            node_submap=_narrow(submaps.new[own_submap]),
        ),
        closures.min_score[asked],
        nodes.new[closures.requested_at[asked]],
        left,
    )
    return restored, rows


def _narrow(numbers: NDArray[Any]) -> NDArray[np.int32]:
    return numbers.astype(np.int32)


def _stretches(
    result: MapData, scans: Numbers, nodes: Numbers, submaps: Numbers, hosts: IntArray
) -> list[list[Session]]:
    """Return what is left of each session, where it begins now: several stretches, or none.

    A stretch is mapped without interruption, so it is a session of its own. The last session stays.

    Parameters
    ----------
    hosts : of each node the first submap that stays and that it was inserted into, or -1.
    """
    own_scans = ranges([session.first_scan for session in result.sessions], len(scans.kept))
    own_nodes = ranges([session.first_node for session in result.sessions], len(nodes.kept))
    left: list[list[Session]] = []
    for session, of_scans, of_nodes in zip(result.sessions, own_scans, own_nodes, strict=True):
        begins = [(session.first_scan, session.first_node, session.first_submap)]
        kept = nodes.kept[of_nodes]
        begins += [
            (int(result.node_scan_index[node]), node, int(hosts[node]))
            for node in (of_nodes.start + 1 + np.flatnonzero(kept[1:] & ~kept[:-1])).tolist()
        ]
        if not kept[:1].all():
            begins = begins[1:]
        if not kept.any() and (scans.kept[of_scans].any() or session is result.sessions[-1]):
            begins = [(session.first_scan, session.first_node, session.first_submap)]
        left.append(
            [
                replace(
                    session,
                    first_scan=int(scans.new[scan]),
                    first_node=int(nodes.new[node]),
                    first_submap=int(submaps.new[submap]),
                    stamp=float(result.stamps[scan]) if scan < len(result.stamps) else math.nan,
                )
                for scan, node, submap in begins
            ]
        )
    return left


def _with_joins(extra: Mapping[str, Any], stretches: Sequence[Sequence[Session]]) -> dict[str, Any]:
    """Return the report's findings, with the new numbers of sessions in what it says of joins."""
    if "joins" not in extra:
        return dict(extra)
    firsts = np.cumsum([0, *map(len, stretches)]).tolist()
    joins = []
    for join in extra["joins"]:
        groups = [
            [number for one in group for number in range(firsts[one], firsts[one + 1])]
            for group in join["sessions"]
        ]
        if all(groups):
            joins.append({**join, "sessions": groups})
    return {**extra, "joins": joins}
