# SPDX-License-Identifier: Apache-2.0
"""The parts of the state: each knows what a page lacks that saw it before, or never.

What a page has seen of a part is a token that the part hands out and is shown again; None stands
for nothing. So a page that fell behind gets one message, not those that it missed. What is made for
one page is kept for the others until the part changes.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from cartoloop.viewer.feed import ConstraintColumns
from cartoloop.viewer.protocol import (
    ConstraintRows,
    constraints_message,
    node_times_message,
    nodes_message,
    submap_poses_message,
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


class SubmapPoses(_Rows):
    """Where the submaps are; few enough to be sent all."""

    def __init__(self) -> None:
        super().__init__()
        self.poses = np.zeros((0, 3))

    def __len__(self) -> int:
        return len(self.poses)

    def set(self, poses: NDArray[np.float64], *, adjusted: bool) -> bool:
        """Replace the poses; return whether they are others."""
        if not adjusted and len(poses) == len(self.poses):
            return False
        self.poses = poses
        self.changed(all_rows=adjusted)
        return True

    def message(self, first: int) -> bytes:
        """Return all rows."""
        return submap_poses_message(self.revision, self.poses)


class NodePoses(_Rows):
    """Where the robot was at each node."""

    def __init__(self) -> None:
        super().__init__()
        self.poses = np.zeros((0, 3))

    def __len__(self) -> int:
        return len(self.poses)

    def set(self, first: int, poses: NDArray[np.float64], *, adjusted: bool) -> bool:
        """Replace the rows from `first` on; return whether any is another."""
        if not adjusted and first + len(poses) == len(self.poses):
            return False
        self.poses = np.concatenate((self.poses[:first], poses))
        self.changed(all_rows=adjusted)
        return True

    def message(self, first: int) -> bytes:
        """Return the rows from `first` on."""
        return nodes_message(self.revision, first, len(self), self.poses[first:])


class NodeTimes(_Rows):
    """When each node was taken."""

    def __init__(self) -> None:
        super().__init__()
        self.stamps = np.zeros(0)

    def __len__(self) -> int:
        return len(self.stamps)

    def set(self, first: int, stamps: NDArray[np.float64]) -> bool:
        """Replace the rows from `first` on; return whether any was added."""
        if len(stamps) == 0:
            return False
        self.stamps = np.concatenate((self.stamps[:first], stamps))
        self.changed(all_rows=False)
        return True

    def message(self, first: int) -> bytes:
        """Return the rows from `first` on."""
        return node_times_message(first, len(self), self.stamps[first:])


class Constraints(_Rows):
    """What ties submaps and nodes together."""

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
            columns: Any = zip(*self._blocks, strict=True) if self._blocks else _NO_COLUMNS
            self._blocks = [ConstraintRows(*map(np.concatenate, columns))]
        return self._blocks[0]

    def set(self, first: int, added: list[ConstraintRows]) -> bool:
        """Add rows at the end, or replace all if `first` is 0; return whether any is another."""
        replaced = first == 0 and self._size > 0
        if not replaced and not any(len(rows.kinds) for rows in added):
            return False
        if replaced:
            self._blocks, self._size = [], 0
        self._blocks += added
        self._size += sum(len(rows.kinds) for rows in added)
        self.changed(all_rows=replaced)
        return True

    def message(self, first: int) -> bytes:
        """Return the rows from `first` on."""
        rows = self.rows
        tail = ConstraintRows(
            rows.index_a[first:],
            rows.index_b[first:],
            rows.relative_poses[first:],
            rows.scores[first:],
            rows.runner_ups[first:],
            rows.kinds[first:],
        )
        return constraints_message(self.revision, first, self._size, tail)


_NO_COLUMNS = [[np.zeros(0, np.uint32)]] * 2 + [
    [np.zeros((0, 3), np.float32)],
    [np.zeros(0, np.float32)],
    [np.zeros(0, np.float32)],
    [np.zeros(0, np.uint8)],
]


def constraint_rows(columns: ConstraintColumns) -> ConstraintRows:
    """Return constraints of the pose graph as they are sent."""
    return ConstraintRows(
        columns.index_a.astype(np.uint32),
        columns.index_b.astype(np.uint32),
        columns.relative_poses.astype(np.float32),
        columns.scores.astype(np.float32),
        columns.runner_ups.astype(np.float32),
        columns.kinds.astype(np.uint8),
    )
