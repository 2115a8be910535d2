# SPDX-License-Identifier: Apache-2.0
"""Edits a finished map. Start reading here."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from types import TracebackType
from typing import Generic, Self

import numpy as np

from cartoloop.arguments import as_array, as_number, as_numbers, shown
from cartoloop.errors import InputError, UsageError
from cartoloop.global_slam.closure_status import Reason, Status
from cartoloop.map_data import Edit
from cartoloop.map_editing.apply import AnyMap, apply_edits
from cartoloop.map_editing.arguments import (
    MAX_NAME,
    MAX_NUMBERS,
    Align,
    Arguments,
    ControlPoints,
    Drop,
    ForgetArea,
    ForgetTime,
    Pin,
    Rename,
    Split,
    SurveyedPoint,
    checked,
    made,
)
from cartoloop.map_editing.change import Change, change_of
from cartoloop.map_editing.closure_list import ClosureRow, closure_rows
from cartoloop.map_editing.descriptions import described
from cartoloop.map_editing.edited_folder import EditedFolder
from cartoloop.map_editing.examination import examined
from cartoloop.map_editing.matching import WINDOW_DEG, WINDOW_M, matched
from cartoloop.map_file.edit_table import MAX_EDITS
from cartoloop.map_output.export import angle_to_axes
from cartoloop.plain_text import one_line
from cartoloop.sensor.pose import Pose, compose, inverse, transform_points, wrap_angle
from cartoloop.session import MAIN_PART, ranges

_MAX_COORDINATE = 1e6
"""Largest number of a pose or place [m]."""


class Editor(Generic[AnyMap]):
    """Edits a finished map; each edit can be undone at any time.

    Numbers of closures, nodes and submaps, and places, are those of `map`, as in ``closures.csv``.
    With ``with``, the map is saved at the end, unless an exception ends the block.

    Parameters
    ----------
    original : the map as mapped, with its edits so far.
    folder : where it is saved; None: nowhere.

    Raises
    ------
    InputError
        Its mapping did not come to its end.
    """

    def __init__(self, original: AnyMap, folder: EditedFolder | None = None) -> None:
        if not original.report.finished:
            raise InputError(
                f"{'the map' if folder is None else folder.path}: mapping was stopped before its "
                "end; finish it first, then edit it"
            )
        self._folder = folder
        try:
            self._applied = apply_edits(original, original.edited_quality)
        except (ValueError, IndexError) as error:
            raise InputError(f"the edits of the map are damaged ({error})") from error
        self._original = original
        self._is_changed = False
        self._saved = self._original, self._applied

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None:
            self.save()

    @property
    def map(self) -> AnyMap:
        """The map with the edits that are not undone."""
        return self._applied.map

    @property
    def original(self) -> AnyMap:
        """The map as mapped."""
        return self._original

    @property
    def edits(self) -> tuple[Edit, ...]:
        """All edits, by their numbers; those undone among them."""
        return self._original.edits

    @property
    def is_changed(self) -> bool:
        """Whether something was edited since the map was opened or saved."""
        return self._is_changed

    def described(self) -> list[str]:
        """Return each edit in words, by its number."""
        return [described(edit) for edit in self.edits]

    def closures(
        self,
        *,
        statuses: Iterable[str] = (),
        submap: int | None = None,
        node: int | None = None,
        worst: int | None = None,
    ) -> list[ClosureRow]:
        """Return the loop closures with their fates; see `closure_list.closure_rows`."""
        return closure_rows(self.map, statuses=statuses, submap=submap, node=node, worst=worst)

    def drop_closures(self, *closures: int) -> Change:
        """Remove loop closures from the graph, and adjust it.

        Parameters
        ----------
        closures : rows of ``closures.csv`` and of `closures`.

        Raises
        ------
        InputError
            One is none that is in the graph.
        """
        if not 1 <= len(closures) <= MAX_NUMBERS:
            raise UsageError(f"drop_closures: give 1 to {MAX_NUMBERS} closures")
        record, graph = self.map.closures, self.map.graph
        pairs = []
        for closure in dict.fromkeys(_index(one, "closure") for one in closures):
            if closure >= len(record):
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
            pairs.append((self._original_submap(submap), self._original_node(node)))
        return self._do(Drop(pairs=pairs))

    def add_closure(
        self,
        submap: int,
        node: int,
        near: Sequence[float] | None = None,
        *,
        in_submap: bool = False,
        window_m: float = WINDOW_M,
        window_deg: float = WINDOW_DEG,
    ) -> Change:
        """Add a loop closure: the node is matched to the submap near a rough pose.

        Parameters
        ----------
        submap, node : the pair.
        near : x, y [m] and theta [rad] of the node in the map, with the submap where it is now;
            None: where it is now.
        in_submap : whether `near` is in the frame of the submap instead.
        window_m, window_deg : window around it that is searched.

        Raises
        ------
        InputError
            There is no such pair, it has a closure in the graph, or it does not fit there.
        """
        self._require(submap, self.map.graph.num_submaps, "submap")
        self._require(node, self.map.graph.num_nodes, "node")
        row = self.map.closures.find(submap, node)
        if row is not None and np.any(self.map.graph.closure_rows == row):
            raise InputError(
                f"submap {submap}, node {node}: is closure {row}, which is in the graph; drop that "
                "first"
            )
        own = self.map.graph.index_a[self.map.graph.index_b == node]
        if submap in own.tolist():
            raise InputError(
                f"submap {submap}, node {node}: the node was inserted into this submap; choose "
                "another"
            )
        if not (0.0 < window_m <= 50.0 and 0.0 < window_deg <= 180.0):
            raise UsageError(
                f"a window of {window_m:g} m and {window_deg:g} deg is impossible: give up to 50 m "
                "and 180 deg"
            )
        if near is None:
            pose = Pose(*self.map.graph.node_poses[node].tolist())
        else:
            pose = _pose(near, "near")
            if in_submap:
                pose = compose(Pose(*self.map.graph.submap_poses[submap].tolist()), pose)
        found = matched(self.map, submap, node, pose, window_m, window_deg)
        own_numbers = {
            "submap": self._original_submap(submap),
            "node": self._original_node(node),
        }
        return self._do(found.model_copy(update=own_numbers))

    def pin_node(self, node: int, at: Sequence[float] | None = None) -> Change:
        """Hold a node where it is, or at a pose x, y [m], theta [rad] in the map.

        The first pin moves the whole map, further ones bend it.
        """
        self._require(node, self.map.graph.num_nodes, "node")
        self._require_joined(int(self.map.node_parts[node]), f"node {node}")
        pose = self.map.graph.node_poses[node].tolist() if at is None else at
        return self._do(Pin(node=self._original_node(node), pose=self._as_mapped(pose)))

    def pin_submap(self, submap: int, at: Sequence[float] | None = None) -> Change:
        """Hold a submap where it is, or at a pose x, y [m], theta [rad] in the map."""
        self._require(submap, self.map.graph.num_submaps, "submap")
        self._require_joined(int(self.map.submap_parts[submap]), f"submap {submap}")
        pose = self.map.graph.submap_poses[submap].tolist() if at is None else at
        return self._do(Pin(submap=self._original_submap(submap), pose=self._as_mapped(pose)))

    def set_control_points(self, points: Sequence[Sequence[float]]) -> Change:
        """Move the whole map, without a change of its shape, to surveyed points.

        Parameters
        ----------
        points : two or more, each x and y in the map and x and y as surveyed [m]. A point of the
            map is bound to the node nearest to it, and moves with it if the map is edited before.
        """
        table = as_array(points, "points")
        if table.ndim != 2 or table.shape[1] != 4 or not 2 <= len(table) <= MAX_NUMBERS:
            raise UsageError(
                f"points is {shown(table)}: give 2 to {MAX_NUMBERS} rows x, y, surveyed x, "
                "surveyed y"
            )
        if not (np.isfinite(table).all() and np.abs(table).max() <= _MAX_COORDINATE):
            raise UsageError("points: a coordinate is not finite, or beyond 1,000 km")
        poses, nodes = self.map.graph.node_poses, np.flatnonzero(self.map.node_parts == MAIN_PART)
        bound = []
        for x, y, to_x, to_y in table.tolist():
            apart = np.hypot(poses[nodes, 0] - x, poses[nodes, 1] - y)
            node = int(nodes[np.argmin(apart)])
            to_node = inverse(Pose(*poses[node].tolist()))
            place = transform_points(to_node, np.array([(x, y)]))[0].tolist()
            bound.append(
                SurveyedPoint(
                    node=self._original_node(node), place=tuple(place), surveyed=(to_x, to_y)
                )
            )
        return self._do(ControlPoints(points=bound))

    def align(self) -> Change:
        """Turn the map about its origin so that most walls lie along its axes."""
        turn = angle_to_axes(self.map)
        return self._do(Align(angle=self._applied.tf_map_original.theta + turn))

    def forget_time(self, from_stamp: float, to_stamp: float) -> Change:
        """Leave out the scans from one stamp to another, and their nodes.

        Submaps that only they made are left out; of those that other scans made, too, the cells
        that lie nearer to a node left out than to another. What is left stays where it is.
        """
        first, last = as_number(from_stamp, "from_stamp"), as_number(to_stamp, "to_stamp")
        stamps = self.map.stamps
        if not first <= last:
            raise UsageError(f"from {first} to {last} is no span: give the earlier stamp first")
        inside = (stamps >= first) & (stamps <= last)
        if not inside.any():
            span = f"{stamps.min():.3f} to {stamps.max():.3f}" if len(stamps) else "nothing"
            raise InputError(
                f"no scan has a stamp from {first:.3f} to {last:.3f}: the map is of {span}"
            )
        if inside[self.map.node_scan_index].all():
            raise InputError("nothing would be left of the map; give a shorter span")
        return self._do(ForgetTime(from_stamp=first, to_stamp=last))

    def forget_area(self, x0: float, y0: float, x1: float, y1: float) -> Change:
        """Leave out what was seen in a rectangle along the axes of the map [m]."""
        sides = as_numbers((x0, y0, x1, y1), "the area", 4)
        if not all(abs(side) <= _MAX_COORDINATE for side in sides):
            raise UsageError("the area: a coordinate is not finite, or beyond 1,000 km")
        left, right = sorted((sides[0], sides[2]))
        bottom, top = sorted((sides[1], sides[3]))
        if left == right or bottom == top:
            raise UsageError("the area is empty: give two opposite corners")
        corner = self._as_mapped((left, bottom, 0.0))
        return self._do(ForgetArea(corner=corner, size=(right - left, top - bottom)))

    def split_session(self, session: int, at: float, name: str | None = None) -> Change:
        """Split a session before the first scan with the stamp `at` or a later one.

        Parameters
        ----------
        session : its number.
        at : stamp [s].
        name : of the second part; None: that of the first, and the stamp.
        """
        self._require(session, len(self.map.sessions), "session")
        stamp, one = as_number(at, "at"), self.map.sessions[session]
        firsts = [other.first_scan for other in self.map.sessions]
        scans = ranges(firsts, len(self.map.stamps))[session]
        later = np.flatnonzero(self.map.stamps[scans] >= stamp)
        if len(later) == 0 or later[0] == 0:
            stamps = self.map.stamps[scans]
            span = f"{stamps[0]:.3f} to {stamps[-1]:.3f}" if len(stamps) else "nothing"
            raise InputError(f"session {session} is of {span}: give a stamp within it")
        scan = int(self._applied.kept.scans[scans][later[0]])
        second = name if name is not None else f"{one.name or session} from {stamp:.3f}"
        return self._do(Split(scan=scan, name=_name(second)))

    def rename_session(self, session: int, name: str) -> Change:
        """Give a session another name."""
        self._require(session, len(self.map.sessions), "session")
        return self._do(Rename(scan=self._applied.session_begins[session], name=_name(name)))

    def undo(self, edit: int | None = None) -> Change:
        """Undo an edit; None: the last that is not undone."""
        if edit is None:
            in_force = [number for number, one in enumerate(self.edits) if not one.is_undone]
            if not in_force:
                raise InputError("there is no edit to undo")
            edit = in_force[-1]
        return self._set_undone(edit, is_undone=True)

    def redo(self, edit: int) -> Change:
        """Put an edit that was undone in force again."""
        return self._set_undone(edit, is_undone=False)

    def save(self) -> None:
        """Examine the map and replace all its files, if something was changed.

        Raises
        ------
        OutputError
            They cannot be written, or another program has changed the map meanwhile.
        UsageError
            The editor has no folder.
        """
        if not self._is_changed:
            return
        if self._folder is None:
            raise UsageError("Editor.save: it was given no folder; save its map")
        self._applied = examined(self._applied)
        self._folder.write(self._applied.map)
        self._is_changed = False
        self._saved = self._original, self._applied

    def discard(self) -> None:
        """Forget what was changed since the map was opened or saved."""
        self._original, self._applied = self._saved
        self._is_changed = False

    def edit_of(self, submap: int, node: int) -> int | None:
        """Return the last edit in force that removed or added the closure of a pair, if any did."""
        pair = (self._original_submap(submap), self._original_node(node))
        found = None
        for number, edit in enumerate(self.edits):
            if not edit.is_undone and pair in checked(edit, self._original).pairs_of():
                found = number if edit.kind in {"drop", "add"} else found
        return found

    def _set_undone(self, edit: int, *, is_undone: bool) -> Change:
        self._require(edit, len(self.edits), "edit")
        if self.edits[edit].is_undone is is_undone:
            raise InputError(f"edit {edit}: is {'already undone' if is_undone else 'in force'}")
        edits = list(self.edits)
        edits[edit] = replace(edits[edit], is_undone=is_undone)
        word = "undone" if is_undone else "in force again"
        return self._adopt(edits, edit, f"{described(edits[edit])}: {word}")

    def _do(self, arguments: Arguments) -> Change:
        """Append an edit and apply it."""
        if len(self.edits) >= MAX_EDITS:
            raise InputError(
                f"the map has {MAX_EDITS} edits, and cannot have more; undo some and use 'redo'"
            )
        edit = made(arguments)
        return self._adopt([*self.edits, edit], len(self.edits), described(edit))

    def _adopt(self, edits: Sequence[Edit], number: int, what: str) -> Change:
        before = self._applied
        original = replace(self._original, edits=tuple(edits), edited_quality=None)
        try:
            after = apply_edits(original)
        except ValueError as error:
            raise InputError(str(error)) from error
        if after.map.graph.num_nodes == 0:
            raise InputError("nothing would be left of the map")
        self._original, self._applied, self._is_changed = original, after, True
        return change_of(number, what, before, after, after.fits.get(number))

    def _as_mapped(self, pose: Sequence[float]) -> tuple[float, float, float]:
        """Return a pose of the map in the map as mapped."""
        return compose(inverse(self._applied.tf_map_original), _pose(pose, "the pose"))

    def _original_node(self, node: int) -> int:
        return int(self._applied.kept.nodes[node])

    def _original_submap(self, submap: int) -> int:
        return int(self._applied.kept.submaps[submap])

    @staticmethod
    def _require_joined(part: int, what: str) -> None:
        if part != MAIN_PART:
            raise InputError(
                f"{what}: is in part {part}, which is apart from the map; add a closure first"
            )

    @staticmethod
    def _require(index: int, count: int, what: str) -> None:
        if not 0 <= _index(index, what) < count:
            there = f"the map has {what}s 0 to {count - 1}" if count else f"the map has no {what}s"
            raise InputError(f"{what} {index}: {there}")


def _index(value: object, what: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise UsageError(f"{what} is {shown(value)}: give a whole number")
    return int(value)


def _name(value: object) -> str:
    if not isinstance(value, str) or not 1 <= len(value) <= MAX_NAME or one_line(value) != value:
        raise UsageError(f"the name is {shown(value)}: give 1 to {MAX_NAME} plain characters")
    return value


def _pose(value: object, what: str) -> Pose:
    x, y, theta = as_numbers(value, what, 3)
    if not all(math.isfinite(number) for number in (x, y, theta)):
        raise UsageError(f"{what} is {shown(value)}: give finite numbers")
    if not (abs(x) <= _MAX_COORDINATE and abs(y) <= _MAX_COORDINATE):
        raise UsageError(f"{what} is {shown(value)}: is beyond 1,000 km")
    return Pose(x, y, wrap_angle(theta))
