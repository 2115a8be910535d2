# SPDX-License-Identifier: Apache-2.0
"""New edits: checked against the edited map, and stated for the map as mapped."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Generic

import numpy as np

from cartoloop.arguments import (
    as_array,
    as_number,
    as_numbers,
    as_pose,
    shown,
)
from cartoloop.errors import InputError, UsageError
from cartoloop.global_slam.closure_status import Reason, Status
from cartoloop.map_editing.apply import AnyMap, Applied
from cartoloop.map_editing.arguments import (
    MAX_NAME,
    MAX_NUMBERS,
    Add,
    Align,
    ControlPoints,
    Drop,
    ForgetArea,
    ForgetTime,
    Pin,
    Rename,
    Split,
    SurveyedPoint,
)
from cartoloop.map_editing.matching import matched
from cartoloop.map_editing.rectangle import Rectangle
from cartoloop.map_editing.seen_area import extent, is_seen
from cartoloop.map_output.export import angle_to_axes
from cartoloop.plain_text import one_line
from cartoloop.sensor.pose import Pose, compose, inverse, transform_points, wrap_angle
from cartoloop.session import MAIN_PART, ranges

_MAX_COORDINATE = 1e7
"""Largest number of a pose or place [m]: northings of surveyors reach it, and numbers of
double precision are exact to 2 nm there."""

_TOO_FAR = (
    "a coordinate is not finite, or beyond 10,000 km; subtract the same whole kilometres from all"
)


class NewEdits(Generic[AnyMap]):
    """Makes edits of the map as mapped from numbers and places of the edited map.

    The parameters of the methods, and what they raise, are those of `editor.Editor`.

    Parameters
    ----------
    applied : the map with its edits.
    """

    def __init__(self, applied: Applied[AnyMap]) -> None:
        self._applied = applied
        self._map = applied.map

    def drop(self, closures: Sequence[int]) -> Drop:
        """Return the edit of `editor.Editor.drop_closures`."""
        if not 1 <= len(closures) <= MAX_NUMBERS:
            raise UsageError(f"drop_closures: give 1 to {MAX_NUMBERS} closures")
        record, graph = self._map.closures, self._map.graph
        pairs = []
        for closure in dict.fromkeys(_index(one, "closure") for one in closures):
            if not 0 <= closure < len(record):
                raise InputError(
                    f"closure {closure}: the record has {len(record)} rows, counted from 0; they "
                    "are those of closures.csv"
                )
            if not np.any(graph.closure_rows == closure):
                fate = Status(int(record.status[closure])).text.replace("_", " ")
                reason = Reason(int(record.reason[closure])).text.replace("_", " ")
                raise InputError(
                    f"closure {closure}: is not in the graph ({fate}{': ' if reason else ''}"
                    f"{reason}); choose one that is, like those of 'closures --status final'"
                )
            submap, node = int(record.submap[closure]), int(record.node[closure])
            pairs.append((self.original_submap(submap), self.original_node(node)))
        return Drop(pairs=pairs)

    def add(
        self,
        submap: int,
        node: int,
        near: Sequence[float] | None,
        *,
        in_submap: bool,
        window_m: float,
        window_deg: float,
    ) -> Add:
        """Return the edit of `editor.Editor.add_closure`."""
        require_index(submap, self._map.graph.num_submaps, "submap")
        require_index(node, self._map.graph.num_nodes, "node")
        self._require_no_constraint(submap, node)
        if not (0.0 < window_m <= 50.0 and 0.0 < window_deg <= 180.0):
            raise UsageError(
                f"a window of {window_m:g} m and {window_deg:g} deg is impossible: give up to 50 m "
                "and 180 deg"
            )
        if near is None:
            pose = Pose(*self._map.graph.node_poses[node].tolist())
        else:
            pose = _pose(near, "near")
            if in_submap:
                pose = compose(Pose(*self._map.graph.submap_poses[submap].tolist()), pose)
        found = matched(self._map, submap, node, pose, window_m, window_deg)
        numbers = {"submap": self.original_submap(submap), "node": self.original_node(node)}
        return found.model_copy(update=numbers)

    def _require_no_constraint(self, submap: int, node: int) -> None:
        """Check that no constraint of the graph is between a submap and a node."""
        graph = self._map.graph
        row = self._map.closures.find(submap, node)
        if row is not None and np.any(graph.closure_rows == row):
            raise InputError(
                f"submap {submap}, node {node}: is closure {row}, which is in the graph; drop that "
                "first"
            )
        if submap in graph.index_a[graph.index_b == node].tolist():
            raise InputError(
                f"submap {submap}, node {node}: the node was inserted into this submap; choose "
                "another"
            )

    def pin_node(self, node: int, at: Sequence[float] | None = None) -> Pin:
        """Return the edit of `editor.Editor.pin_node`."""
        require_index(node, self._map.graph.num_nodes, "node")
        _require_joined(int(self._map.node_parts[node]), f"node {node}")
        pose = self._map.graph.node_poses[node].tolist() if at is None else at
        return Pin(node=self.original_node(node), pose=self._as_mapped(pose))

    def pin_submap(self, submap: int, at: Sequence[float] | None = None) -> Pin:
        """Return the edit of `editor.Editor.pin_submap`."""
        require_index(submap, self._map.graph.num_submaps, "submap")
        _require_joined(int(self._map.submap_parts[submap]), f"submap {submap}")
        pose = self._map.graph.submap_poses[submap].tolist() if at is None else at
        return Pin(submap=self.original_submap(submap), pose=self._as_mapped(pose))

    def control_points(self, points: Sequence[Sequence[float]]) -> ControlPoints:
        """Return the edit of `editor.Editor.set_control_points`."""
        table = as_array(points, "points")
        if table.ndim != 2 or table.shape[1] != 4 or not 2 <= len(table) <= MAX_NUMBERS:
            raise UsageError(
                f"points is {shown(table)}: give 2 to {MAX_NUMBERS} rows x, y, surveyed x, "
                "surveyed y"
            )
        for number, point in enumerate(table.tolist(), 1):
            if not all(abs(coordinate) <= _MAX_COORDINATE for coordinate in point):
                raise UsageError(
                    f"point {number} is {' '.join(map(str, point))}: {_TOO_FAR} points"
                )
        poses, nodes = self._map.graph.node_poses, np.flatnonzero(self._map.node_parts == MAIN_PART)
        bound = []
        for x, y, to_x, to_y in table.tolist():
            apart = np.hypot(poses[nodes, 0] - x, poses[nodes, 1] - y)
            node = int(nodes[np.argmin(apart)])
            to_node = inverse(Pose(*poses[node].tolist()))
            place = transform_points(to_node, np.array([(x, y)]))[0].tolist()
            bound.append(
                SurveyedPoint(
                    node=self.original_node(node), place=tuple(place), surveyed=(to_x, to_y)
                )
            )
        return ControlPoints(points=bound)

    def align(self) -> Align:
        """Return the edit of `editor.Editor.align`."""
        turn = angle_to_axes(self._map)
        return Align(angle=self._applied.tf_map_original.theta + turn)

    def forget_time(self, from_stamp: float, to_stamp: float, session: int | None) -> ForgetTime:
        """Return the edit of `editor.Editor.forget_time`."""
        first, last = as_number(from_stamp, "from_stamp"), as_number(to_stamp, "to_stamp")
        if not first <= last:
            raise UsageError(f"from {first} to {last} is no span: give the earlier stamp first")
        own, scans, where = slice(None), None, "the map"
        if session is not None:
            own, where = self._scans_of(session), "it"
            scans = self._applied.scans_as_mapped(session)
        stamps = self._map.stamps[own]
        inside = np.zeros(len(self._map.stamps), dtype=bool)
        inside[own] = (stamps >= first) & (stamps <= last)
        if not inside.any():
            span = f"{stamps.min():.3f} to {stamps.max():.3f}" if len(stamps) else "nothing"
            of_session = "" if session is None else f" of session {session}"
            raise InputError(
                f"no scan{of_session} has a stamp from {first:.3f} to {last:.3f}: {where} is of "
                f"{span}"
            )
        if inside[self._map.node_scan_index].all():
            raise InputError("nothing would be left of the map; forget less of it")
        return ForgetTime(from_stamp=first, to_stamp=last, scans=scans)

    def forget_session(self, session: int) -> ForgetTime:
        """Return the edit of `editor.Editor.forget_session`."""
        if not len(self._map.stamps[self._scans_of(session)]):
            raise InputError(f"session {session}: has no scans")
        first, end = self._applied.scans_as_mapped(session)
        stamps = self._applied.map_as_mapped.stamps[first:end]
        return self.forget_time(float(stamps.min()), float(stamps.max()), session)

    def _scans_of(self, session: int) -> slice:
        """Return the scans of a session in the edited map."""
        require_index(session, len(self._map.sessions), "session")
        firsts = [other.first_scan for other in self._map.sessions]
        return ranges(firsts, len(self._map.stamps))[session]

    def forget_area(self, x0: float, y0: float, x1: float, y1: float) -> ForgetArea:
        """Return the edit of `editor.Editor.forget_area`."""
        sides = as_numbers((x0, y0, x1, y1), "the area", 4)
        if not all(abs(side) <= _MAX_COORDINATE for side in sides):
            raise UsageError("the area: a coordinate is not finite, or beyond 10,000 km")
        left, right = sorted((sides[0], sides[2]))
        bottom, top = sorted((sides[1], sides[3]))
        if left == right or bottom == top:
            raise UsageError("the area is empty: give two opposite corners")
        if not is_seen(self._map, Rectangle(Pose(left, bottom, 0.0), right - left, top - bottom)):
            raise InputError(
                f"the map shows nothing from x {left:g} to {right:g} m, y {bottom:g} to {top:g} m: "
                f"{extent(self._map)}"
            )
        corner = self._as_mapped((left, bottom, 0.0))
        return ForgetArea(corner=corner, size=(right - left, top - bottom))

    def split(self, session: int, at: float, name: str | None = None) -> Split:
        """Return the edit of `editor.Editor.split_session`."""
        require_index(session, len(self._map.sessions), "session")
        stamp, one = as_number(at, "at"), self._map.sessions[session]
        scans = self._scans_of(session)
        later = np.flatnonzero(self._map.stamps[scans] >= stamp)
        if len(later) == 0 or later[0] == 0:
            stamps = self._map.stamps[scans]
            span = f"{stamps[0]:.3f} to {stamps[-1]:.3f}" if len(stamps) else "nothing"
            raise InputError(f"session {session} is of {span}: give a stamp within it")
        scan = int(self._applied.kept.scans[scans][later[0]])
        second = name if name is not None else f"{one.name or session} from {stamp:.3f}"
        return Split(scan=scan, name=_name(second))

    def rename(self, session: int, name: str) -> Rename:
        """Return the edit of `editor.Editor.rename_session`."""
        require_index(session, len(self._map.sessions), "session")
        return Rename(scan=self._applied.session_begins[session], name=_name(name))

    def _as_mapped(self, pose: Sequence[float]) -> tuple[float, float, float]:
        """Return a pose of the map in the map as mapped."""
        return compose(inverse(self._applied.tf_map_original), _pose(pose, "the pose"))

    def original_node(self, node: int) -> int:
        """Return the number of a node in the map as mapped."""
        return int(self._applied.kept.nodes[node])

    def original_submap(self, submap: int) -> int:
        """Return the number of a submap in the map as mapped."""
        return int(self._applied.kept.submaps[submap])


def require_index(index: int, count: int, what: str) -> None:
    """Check the number of a closure, node, submap, session or edit.

    Raises
    ------
    InputError
        The map has none of that number.
    UsageError
        It is no whole number.
    """
    if not 0 <= _index(index, what) < count:
        there = f"the map has {what}s 0 to {count - 1}" if count else f"the map has no {what}s"
        raise InputError(f"{what} {index}: {there}")


def _require_joined(part: int, what: str) -> None:
    if part != MAIN_PART:
        raise InputError(
            f"{what}: is in part {part}, which is apart from the map; add a closure first"
        )


def _index(value: object, what: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise UsageError(f"{what} is {shown(value)}: give a whole number")
    return int(value)


def _name(value: object) -> str:
    if not isinstance(value, str):
        raise UsageError(f"the name is {shown(value)}: give a text")
    if not 1 <= len(value) <= MAX_NAME or one_line(value) != value:
        raise UsageError(f"the name is {value[:MAX_NAME]!r}: give 1 to {MAX_NAME} plain characters")
    return value


def _pose(value: object, what: str) -> Pose:
    x, y, theta = as_pose(value, what)
    if not (abs(x) <= _MAX_COORDINATE and abs(y) <= _MAX_COORDINATE):
        raise UsageError(f"{what} is x {x:g} m, y {y:g} m: {_TOO_FAR} poses")
    return Pose(x, y, wrap_angle(theta))
