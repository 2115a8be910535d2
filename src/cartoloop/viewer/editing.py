# SPDX-License-Identifier: Apache-2.0
"""Edits that pages ask for: carried out one by one, saved, and shown to all pages."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

import numpy as np

from cartoloop.errors import InputError
from cartoloop.map_output.map_facts import map_facts
from cartoloop.viewer import requests
from cartoloop.viewer.feed import whole

if TYPE_CHECKING:
    from cartoloop.map_editing.change import Change
    from cartoloop.map_editing.editor import Editor
    from cartoloop.result import Result
    from cartoloop.viewer.live_state import LiveState

NOT_ALLOWED = "this view does not edit: start it with 'cartoloop view OUT --edit'"
"""Said to pages that ask for an edit where none is allowed."""


class Editing:
    """Carries out the edits of pages; its methods are called in the server's event loop.

    Parameters
    ----------
    editor : of the map that is shown.
    state : shows it.
    """

    def __init__(self, editor: Editor[Result], state: LiveState) -> None:
        self._editor = editor
        self._state = state
        self._lock = asyncio.Lock()

    def edit_of(self, submap: int, node: int) -> int | None:
        """Return the number of the edit that removed or added the closure of a pair, if one did."""
        return None if self._lock.locked() else self._editor.edit_of(submap, node)

    async def carry_out(self, request: requests.EditRequest) -> str:
        """Edit the map, save it and show it; return what was changed, in words.

        Raises
        ------
        CartoloopError
            It cannot be done or saved; the map stays as it was.
        """
        async with self._lock:
            text, facts = await asyncio.to_thread(self._edited, request)
            self._state.apply(whole(self._editor.map))
            self._state.show_facts(facts)
            self._state.show_edits(edits_content(self._editor, can_edit=True))
            self._state.refresh()
        return text

    def _edited(self, request: requests.EditRequest) -> tuple[str, Any]:
        """Edit and save the map in a thread of its own: it takes a second or more."""
        editor, before = self._editor, self._editor.map
        try:
            change = self._change(request)
            if not _has_same_contents(before, editor.map):
                raise InputError(
                    f"edit {change.number}: changes scans or cells, which this page cannot show; "
                    "use 'cartoloop edit', and open the map again"
                )
            editor.save()
        except BaseException:
            editor.discard()
            raise
        return change.text, map_facts(editor.map)

    def _change(self, request: requests.EditRequest) -> Change:
        editor = self._editor
        match request:
            case requests.DropClosure():
                row = editor.map.closures.find(request.submap, request.node)
                if row is None:
                    raise InputError(
                        f"submap {request.submap}, node {request.node}: there is no such closure"
                    )
                return editor.drop_closures(row)
            case requests.UndoEdit():
                return editor.undo(request.edit)
            case requests.RedoEdit():
                return editor.redo(request.edit)


def edits_content(editor: Editor[Result], *, can_edit: bool) -> dict[str, Any]:
    """Return the content of an EDITS message."""
    edits = zip(editor.edits, editor.described(), strict=True)
    return {
        "can_edit": can_edit,
        "edits": [
            {"edit": number, "what": what, "is_undone": edit.is_undone}
            for number, (edit, what) in enumerate(edits)
        ],
    }


def _has_same_contents(before: Result, after: Result) -> bool:
    """Return whether two states of a map have the same nodes and the same cells."""
    return (
        np.array_equal(before.node_scan_index, after.node_scan_index)
        and np.array_equal(before.stamps, after.stamps)
        and len(before.submap_grids) == len(after.submap_grids)
        and all(
            one.is_same(other)
            for one, other in zip(before.submap_grids, after.submap_grids, strict=True)
        )
    )
