# SPDX-License-Identifier: Apache-2.0
"""Maps as the beginning of another: their graphs and records of closures, one after the other.

The record is brought into the state that it has while mapping: what the last pass matched, and what
of it is in the graph, counts as found. The last pass over the whole map will replace it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.global_slam.closure_matches import UPPER, MatchTable, Requests
from cartoloop.global_slam.closure_status import REASON_OF_SEARCH, Reason, Status
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.pose_graph import NO_ROW, PoseGraph
from cartoloop.global_slam.sessions import MappedSessions, NodeSubmaps, SessionRanges

_NO_WINDOW = 0.0


class Loaded(NamedTuple):
    """What is known when mapping goes on.

    Attributes
    ----------
    graph : of all maps; each keeps its poses.
    closures : the record of all of them.
    ranges : of their sessions; no two maps are connected.
    """

    graph: PoseGraph
    closures: Closures
    ranges: SessionRanges


def load(maps: Sequence[MappedSessions]) -> Loaded:
    """Return the graph, the record and the sessions of maps, none for an empty beginning."""
    graph, ranges = PoseGraph(), SessionRanges()
    records: list[RecordRows] = []
    for each in maps:
        first_node, first_submap = graph.num_nodes, graph.num_submaps
        record, row_of = settled(each.closures, each.graph)
        first_row = sum(len(earlier.min_score) for earlier in records)
        records.append(_moved(record, first_row, first_node, first_submap))
        _append(graph, each.graph, np.where(row_of >= 0, row_of + first_row, NO_ROW))
        _append_ranges(ranges, each, first_node, first_submap)
    return Loaded(graph, _together(records), ranges)


class RecordRows(NamedTuple):
    """The rows of a record of closures; the attributes are those of `Closures.restored`."""

    ends: tuple[IntArray, IntArray]
    codes: tuple[IntArray, IntArray, IntArray]
    requests: Requests
    min_score: FloatArray
    requested_at: IntArray
    matches: MatchTable


def settled(closures: Closures, graph: PoseGraph) -> tuple[RecordRows, IntArray]:
    """Return a finished map's record as one that can grow, and the new row of each constraint.

    Rows that were requested stay; of those that only the last pass matched, the ones in the graph.
    The rows in the graph are found ones, with the measurement that the graph has.
    """
    in_graph = np.flatnonzero(graph.closure_rows >= 0)
    rows_in_graph = graph.closure_rows[in_graph].astype(np.int64)
    is_kept = np.arange(len(closures)) < closures.num_requested
    is_kept[rows_in_graph] = True
    kept = np.flatnonzero(is_kept)
    new_row = np.full(len(closures), NO_ROW)
    new_row[kept] = np.arange(len(kept))
    row_of = np.full(graph.num_constraints, NO_ROW)
    row_of[in_graph] = new_row[rows_in_graph]
    record = RecordRows(
        (closures.submap[kept].astype(np.int64), closures.node[kept].astype(np.int64)),
        _codes(closures, kept, rows_in_graph),
        _requests(closures, kept, graph),
        *_request_values(closures, kept, graph),
        _matches(closures, graph, in_graph, new_row),
    )
    return record, row_of


def _codes(
    closures: Closures, kept: IntArray, in_graph: IntArray
) -> tuple[IntArray, IntArray, IntArray]:
    status = closures.search_status.astype(np.int64)
    is_requested = np.arange(len(closures)) < closures.num_requested
    is_final = (closures.status >= Status.REPLACED) & (closures.status <= Status.CONTRADICTED)
    is_final |= np.isin(closures.status, (Status.REMOVED, Status.ADDED))
    usual = REASON_OF_SEARCH[closures.search_status]
    reason = np.where(is_final & is_requested, usual, closures.reason).astype(np.int64)
    was_found = status[in_graph] == Status.FOUND
    status_now = status.copy()
    status_now[in_graph] = Status.FOUND
    reason[in_graph] = np.where(was_found, Reason.REACHED_THRESHOLD, Reason.EARLIER_PASS)
    return status_now[kept], reason[kept], status[kept]


def _requests(closures: Closures, kept: IntArray, graph: PoseGraph) -> Requests:
    """Return the requests of the rows; those that were never requested have a window of 0."""
    requested = closures.num_requested
    others = kept[requested:]
    measured = closures.measured
    own = NodeSubmaps.of(graph).first[closures.node[others]]
    poses = measured.tf_submap_node[np.searchsorted(measured.row, others)]
    nothing = np.full(len(others), _NO_WINDOW)
    return Requests(
        closures.submap[kept],
        closures.node[kept],
        np.concatenate((closures.node_submap, own.astype(np.int32))),
        np.concatenate((closures.predicted, poses)),
        np.concatenate((closures.linear_window, nothing)),
        np.concatenate((closures.angular_window, nothing)),
    )


def _request_values(
    closures: Closures, kept: IntArray, graph: PoseGraph
) -> tuple[FloatArray, IntArray]:
    count = len(kept) - closures.num_requested
    min_score = np.concatenate((closures.min_score, np.full(count, np.nan)))
    requested_at = np.concatenate((closures.requested_at, np.full(count, graph.num_nodes)))
    return min_score, requested_at


def _matches(
    closures: Closures, graph: PoseGraph, in_graph: IntArray, new_row: IntArray
) -> MatchTable:
    """Return one match of each row that has one: that in the graph, or what the search found."""
    table, num_found = closures.match_table, closures.num_found
    found_rows = table.row[:num_found]
    constraint_of = np.full(len(closures), -1)
    constraint_of[graph.closure_rows[in_graph]] = in_graph
    newest = np.full(len(closures), -1)
    newest[table.row] = np.arange(len(table.row))  # those of the last pass come last
    only_final = np.setdiff1d(graph.closure_rows[in_graph].astype(np.int64), found_rows)
    rows = np.concatenate((found_rows, only_final))
    is_in_graph = constraint_of[rows] >= 0
    source = np.concatenate((np.arange(num_found), newest[only_final]))
    source = np.where(is_in_graph, newest[rows], source)
    poses = table.tf_submap_node[source].copy()
    information = table.information[source].copy()
    poses[is_in_graph] = graph.relative_poses[constraint_of[rows[is_in_graph]]]
    information[is_in_graph] = graph.informations[constraint_of[rows[is_in_graph]]][:, *UPPER]
    nothing = np.zeros(len(only_final))
    return MatchTable(
        new_row[rows],
        poses,
        information,
        table.residual[source],
        table.moved[source],
        np.concatenate((table.score, nothing)),
        np.concatenate((table.runner_up, nothing)),
        np.concatenate((table.joined_at, np.full(len(only_final), graph.num_nodes))),
    )


def _moved(record: RecordRows, first_row: int, first_node: int, first_submap: int) -> RecordRows:
    """Return a record whose rows, nodes and submaps have others before them."""
    submap, node = record.ends
    requests, matches = record.requests, record.matches
    return record._replace(
        ends=(submap + first_submap, node + first_node),
        requests=requests._replace(
            submap=(requests.submap + first_submap).astype(np.int32),
            node=(requests.node + first_node).astype(np.int32),
            node_submap=(requests.node_submap + first_submap).astype(np.int32),
        ),
        requested_at=record.requested_at + first_node,
        matches=matches._replace(
            row=matches.row + first_row,
            joined_at=(matches.joined_at + first_node).astype(np.int32),
        ),
    )


def _together(records: Sequence[RecordRows]) -> Closures:
    if not records:
        return Closures()
    ends, codes, requests, min_score, requested_at, matches = zip(*records, strict=True)
    return Closures.restored(
        (np.concatenate([e[0] for e in ends]), np.concatenate([e[1] for e in ends])),
        (
            np.concatenate([code[0] for code in codes]),
            np.concatenate([code[1] for code in codes]),
            np.concatenate([code[2] for code in codes]),
        ),
        Requests._make(map(np.concatenate, zip(*requests, strict=True))),
        np.concatenate(min_score),
        np.concatenate(requested_at),
        MatchTable._make(map(np.concatenate, zip(*matches, strict=True))),
    )


def _append(graph: PoseGraph, other: PoseGraph, closure_rows: IntArray) -> None:
    """Add the vertices and constraints of another graph, whose closures have these rows."""
    first_submap, first_node = graph.num_submaps, graph.num_nodes
    graph.add_submaps(other.submap_poses)
    graph.add_nodes(other.node_poses)
    graph.add_constraints(
        other.kinds,
        other.index_a + first_submap,
        other.index_b + first_node,
        other.relative_poses,
        other.informations,
        closure_rows=closure_rows,
        is_trusted=other.is_trusted,
    )
    for submap in other.fixed_submaps:
        if first_submap == 0:
            graph.fix_submap(submap)
    for node in other.fixed_nodes:
        graph.fix_node(first_node + node)


def _append_ranges(
    ranges: SessionRanges, each: MappedSessions, first_node: int, first_submap: int
) -> None:
    """Begin the sessions of a map; its parts get numbers of their own."""
    first_part = max(ranges.parts, default=-1) + 1
    numbers = sorted({session.part for session in each.sessions})
    for session in each.sessions:
        ranges.begin(
            first_node + session.first_node,
            first_submap + session.first_submap,
            first_part + numbers.index(session.part),
        )
