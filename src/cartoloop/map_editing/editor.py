# SPDX-License-Identifier: Apache-2.0
"""Edits a finished map. Start reading here."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from types import TracebackType
from typing import Generic, Self

from cartoloop.errors import InputError, UsageError
from cartoloop.map_data import Edit
from cartoloop.map_editing.apply import AnyMap, apply_edits
from cartoloop.map_editing.arguments import Arguments, checked, made
from cartoloop.map_editing.change import Change, change_of
from cartoloop.map_editing.closure_list import ClosureRow, closure_rows
from cartoloop.map_editing.descriptions import described
from cartoloop.map_editing.edited_folder import EditedFolder
from cartoloop.map_editing.examination import examined
from cartoloop.map_editing.matching import WINDOW_DEG, WINDOW_M
from cartoloop.map_editing.new_edits import NewEdits, require_index
from cartoloop.map_file.edit_table import MAX_EDITS


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
                "end; finish it with --resume, then edit it"
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
        return self._do(self._new.drop(closures))

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
        return self._do(
            self._new.add(
                submap, node, near, in_submap=in_submap, window_m=window_m, window_deg=window_deg
            )
        )

    def pin_node(self, node: int, at: Sequence[float] | None = None) -> Change:
        """Hold a node where it is, or at a pose x, y [m], theta [rad] in the map.

        The first pin moves the whole map, further ones bend it.
        """
        return self._do(self._new.pin_node(node, at))

    def pin_submap(self, submap: int, at: Sequence[float] | None = None) -> Change:
        """Hold a submap where it is, or at a pose x, y [m], theta [rad] in the map."""
        return self._do(self._new.pin_submap(submap, at))

    def set_control_points(self, points: Sequence[Sequence[float]]) -> Change:
        """Move the whole map, without a change of its shape, to surveyed points.

        Parameters
        ----------
        points : two or more, each x and y in the map and x and y as surveyed [m]. A point of the
            map is bound to the node nearest to it, and moves with it if the map is edited before.
        """
        return self._do(self._new.control_points(points))

    def align(self) -> Change:
        """Turn the map about its origin so that most walls lie along its axes."""
        return self._do(self._new.align())

    def forget_time(self, from_stamp: float, to_stamp: float, session: int | None = None) -> Change:
        """Leave out the scans from one stamp to another, and their nodes.

        Submaps that only they made are left out; of those that other scans made, too, the cells
        that lie nearer to a node left out than to another. What is left stays where it is.

        Parameters
        ----------
        from_stamp, to_stamp : first and last stamp [s].
        session : number of the one whose scans are left out; None: those of all sessions.

        Raises
        ------
        InputError
            There is no such scan, or nothing would be left.
        """
        return self._do(self._new.forget_time(from_stamp, to_stamp, session))

    def forget_session(self, session: int) -> Change:
        """Leave out all scans of a session, as `forget_time` does."""
        return self._do(self._new.forget_session(session))

    def forget_area(self, x0: float, y0: float, x1: float, y1: float) -> Change:
        """Leave out what was seen in a rectangle along the axes of the map [m].

        Raises
        ------
        InputError
            Nothing was seen there.
        """
        return self._do(self._new.forget_area(x0, y0, x1, y1))

    def split_session(self, session: int, at: float, name: str | None = None) -> Change:
        """Split a session before the first scan with the stamp `at` or a later one.

        Parameters
        ----------
        session : its number.
        at : stamp [s].
        name : of the second part; None: that of the first, and the stamp.
        """
        return self._do(self._new.split(session, at, name))

    def rename_session(self, session: int, name: str) -> Change:
        """Give a session another name."""
        return self._do(self._new.rename(session, name))

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
        pair = (self._new.original_submap(submap), self._new.original_node(node))
        found = None
        for number, edit in enumerate(self.edits):
            if not edit.is_undone and pair in checked(edit, self._original).pairs_of():
                found = number if edit.kind in {"drop", "add"} else found
        return found

    @property
    def _new(self) -> NewEdits[AnyMap]:
        return NewEdits(self._applied)

    def _set_undone(self, edit: int, *, is_undone: bool) -> Change:
        require_index(edit, len(self.edits), "edit")
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
