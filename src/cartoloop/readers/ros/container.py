# SPDX-License-Identifier: Apache-2.0
"""The messages of a recording as bytes, for all kinds of files."""

from __future__ import annotations

import weakref
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from cartoloop.plain_text import one_line
from cartoloop.readers.log import ProblemSeverity
from cartoloop.readers.ros.unpacking import Budget, limit_library, spending

if TYPE_CHECKING:
    from rosbags.interfaces import Connection


@dataclass(frozen=True, slots=True)
class BagFinding:
    """A problem of a recording or a remark, and what to do about it.

    Attributes
    ----------
    severity : ``error`` (part of the recording is lost), ``warning`` or ``note``.
    code : short name of the kind of finding, the same in all recordings.
    message : what is wrong, where; one line.
    remedy : what to do, or "".
    topic : the topic concerned, or "".
    count : number of occurrences.
    stamp : of the first occurrence, as recorded [s]; None if it does not concern one moment.
    """

    severity: ProblemSeverity
    code: str
    message: str
    remedy: str = ""
    topic: str = ""
    count: int = 1
    stamp: float | None = None

    @property
    def line(self) -> str:
        """Message and remedy."""
        return f"{self.message}; {self.remedy}" if self.remedy else self.message


class Channel(NamedTuple):
    """A stream of messages of one type.

    Attributes
    ----------
    key : identifies it in `Container.messages`.
    topic, msgtype : names; the type as ROS 2 writes it.
    is_ros1 : how its messages are encoded.
    num_messages : number of messages, as the file states.
    """

    key: int
    topic: str
    msgtype: str
    is_ros1: bool
    num_messages: int


class Container(Protocol):
    """A file or folder with messages.

    Attributes
    ----------
    kind : of recording, for the user.
    channels : its streams of messages.
    damage : what is wrong with it, or ""; known after the first pass.
    notes : other remarks for the user.
    needs : an object that must live as long as this one.
    """

    kind: str
    channels: list[Channel]
    damage: str
    notes: list[BagFinding]
    needs: object

    def messages(self, keys: Collection[int]) -> Iterator[tuple[int, int, bytes]]:
        """Yield key, time of recording [ns] and bytes, in the order of recording. Never raises."""


class LibraryContainer:
    """A recording that rosbags opens; closed when it is no longer used.

    Parameters
    ----------
    reader : of rosbags, not yet open; anything it raises means that the file is damaged.
    num_bytes : size of the file or files.
    """

    def __init__(
        self,
        reader: Any,  # noqa: ANN401 - untyped
        kind: str,
        is_ros1: bool,
        num_bytes: int,
    ) -> None:
        self.kind = kind
        self.damage = ""
        self.notes: list[BagFinding] = []
        self.needs: object = None
        self._reader = reader
        self._num_bytes = num_bytes
        limit_library()
        with spending(Budget(num_bytes)):
            reader.open()
        weakref.finalize(self, reader.close)
        self._connections: list[Connection] = list(reader.connections)
        self.channels = [
            Channel(key, one_line(str(c.topic)), one_line(str(c.msgtype)), is_ros1, c.msgcount)
            for key, c in enumerate(self._connections)
        ]

    def messages(self, keys: Collection[int]) -> Iterator[tuple[int, int, bytes]]:
        """Yield key, time of recording [ns] and bytes, in the order of recording. Never raises."""
        # An empty selection means all to the library.
        if not keys:
            return
        chosen = [self._connections[key] for key in sorted(keys)]
        key_of = {id(connection): key for key, connection in enumerate(self._connections)}
        stream = self._reader.messages(chosen)
        budget = Budget(self._num_bytes)
        while True:
            try:
                with spending(budget):
                    connection, time, data = next(stream)
            except StopIteration:
                return
            except Exception as error:  # noqa: BLE001 - on damaged files it raises anything
                self.damage = reason_of(error)
                return
            key = key_of.get(id(connection))
            if key is not None and key in keys:  # a damaged file gives one number to two topics
                yield key, recorded_time(time), message_bytes(data)


def message_bytes(data: object) -> bytes:
    """Return the bytes of a message; none where a database holds something else, as no value."""
    return bytes(data) if isinstance(data, bytes | bytearray | memoryview) else b""


def recorded_time(time: object) -> int:
    """Return a time of recording [ns]; 0 where a database holds something else."""
    return time if isinstance(time, int) else 0


def reason_of(error: BaseException) -> str:
    """Return the message of an error in one line."""
    text = " ".join(str(error).split()).rstrip(".")
    return one_line(text[:200]) or type(error).__name__


class ChainedContainer:
    """Several files of one recording, one after the other."""

    def __init__(self, parts: list[Container], kind: str) -> None:
        self._parts = parts
        self.kind = kind
        self.notes = [note for part in parts for note in part.notes]
        self.damage = ""
        self.needs: object = None
        self.channels = []
        self._places: list[tuple[int, int]] = []
        for number, part in enumerate(parts):
            for channel in part.channels:
                self.channels.append(channel._replace(key=len(self._places)))
                self._places.append((number, channel.key))

    def messages(self, keys: Collection[int]) -> Iterator[tuple[int, int, bytes]]:
        """Yield key, time of recording [ns] and bytes, in the order of recording. Never raises."""
        for number, part in enumerate(self._parts):
            wanted = {self._places[key][1]: key for key in keys if self._places[key][0] == number}
            for key, time, data in part.messages(wanted):
                yield wanted[key], time, data
            self.damage = self.damage or part.damage
