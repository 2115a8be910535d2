# SPDX-License-Identifier: Apache-2.0
"""The parts of the state: each makes the messages that bring a page up to date.

What a page has seen of a part is a token that the part hands out and is shown again; None stands
for nothing. So a page that fell behind gets one message, not those that it missed. What is made for
one page is kept for the others until the part changes.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Protocol

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.viewer.protocol import (
    ConstraintRows,
    MessageType,
    constraints_message,
    table_message,
)

Token = tuple[int, int]
"""What a page has seen of a part."""


class Part(Protocol):
    """Something that pages are kept informed of."""

    def news(self, seen: Token | None) -> tuple[bytes, Token]:
        """Return the message, if any, for a page that has seen this, and what it has seen then."""


class Latest:
    """A part that is one message; the latest counts."""

    def __init__(self) -> None:
        self._message = b""
        self._version = 0

    def set(self, message: bytes) -> bool:
        """Replace the message; return whether it is another one."""
        if message == self._message:
            return False
        self._message = message
        self._version += 1
        return True

    def news(self, seen: Token | None) -> tuple[bytes, Token]:
        """Return the message unless it was seen."""
        token = (0, self._version)
        return (b"" if seen == token else self._message), token


class _Rows(ABC):
    """A table that grows at its end, and whose older rows may change all at once."""

    def __init__(self) -> None:
        self.revision = 0
        self._made: dict[Token | None, bytes] = {}

    @abstractmethod
    def __len__(self) -> int: ...

    @abstractmethod
    def message(self, first: int) -> bytes:
        """Return the message of the rows from `first` on."""

    def changed(self, *, all_rows: bool) -> None:
        """Note that rows were added, or that all are others."""
        self.revision += all_rows
        self._made.clear()

    def news(self, seen: Token | None) -> tuple[bytes, Token]:
        """Return the rows that were added, or all if older ones have changed."""
        token = (self.revision, len(self))
        if seen == token or (seen is None and token == (0, 0)):
            return b"", token
        if seen not in self._made:
            same = seen is not None and seen[0] == self.revision
            self._made[seen] = self.message(seen[1] if same and seen is not None else 0)
        return self._made[seen], token


class Table(_Rows):
    """Poses, times or points, one row each.

    Parameters
    ----------
    kind : SUBMAP_POSES, NODES, NODE_TIMES or PATH.
    values : the rows, none at first: poses or points, shape (0, 3), or times, shape (0,).
    sent_whole : whether all rows are sent whenever one is added.

    Attributes
    ----------
    values : float64, all rows.
    """

    def __init__(self, kind: MessageType, values: FloatArray, *, sent_whole: bool = False) -> None:
        super().__init__()
        self.values = values
        self._kind = kind
        self._sent_whole = sent_whole

    def __len__(self) -> int:
        return len(self.values)

    def set(self, first: int, rows: FloatArray, *, adjusted: bool = False) -> bool:
        """Replace the rows from `first` on; return whether the table has changed.

        `adjusted` says that older rows have changed; otherwise rows were only added.
        """
        if not adjusted and first + len(rows) == len(self.values):
            return False
        self.values = np.concatenate((self.values[:first], rows))
        self.changed(all_rows=adjusted)
        return True

    def message(self, first: int) -> bytes:
        """Return the rows from `first` on."""
        return table_message(
            self._kind, self.revision, 0 if self._sent_whole else first, self.values
        )


class ConstraintTable(_Rows):
    """The constraints between submaps and nodes."""

    def __init__(self) -> None:
        super().__init__()
        self._blocks: list[ConstraintRows] = []
        self._size = 0

    def __len__(self) -> int:
        return self._size

    @property
    def rows(self) -> ConstraintRows:
        """All constraints."""
        if len(self._blocks) != 1:
            columns = zip(*(self._blocks or [_NO_ROWS]), strict=True)
            self._blocks = [ConstraintRows._make(map(np.concatenate, columns))]
        return self._blocks[0]

    def set(self, first: int, added: list[ConstraintRows]) -> bool:
        """Add rows at the end, or replace all if `first` is 0; return whether any is another."""
        replaced = first == 0 and self._size > 0
        if not replaced and not any(len(rows.kinds) for rows in added):
            return False
        if replaced:
            self._blocks, self._size = [], 0
        self._blocks += [
            rows._replace(relative_poses=rows.relative_poses.astype(np.float32)) for rows in added
        ]
        self._size += sum(len(rows.kinds) for rows in added)
        self.changed(all_rows=replaced)
        return True

    def message(self, first: int) -> bytes:
        """Return the rows from `first` on."""
        rows = self.rows
        tail = ConstraintRows._make(column[first:] for column in rows)
        return constraints_message(self.revision, first, self._size, tail)


_NO_ROWS = ConstraintRows(
    np.zeros(0, np.int64),
    np.zeros(0, np.int64),
    np.zeros((0, 3), np.float32),
    np.zeros(0, np.int64),
    np.zeros(0, np.int32),
)
