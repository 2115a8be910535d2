# SPDX-License-Identifier: Apache-2.0
"""The pages that are connected, and for each the parts of the state that it lacks.

There is no queue: a changed part is noted for each page, and its message is made when the page can
take it.
"""

from __future__ import annotations

from asyncio import Event
from collections.abc import Iterable, Mapping

from cartoloop.viewer import protocol
from cartoloop.viewer.parts import Part, Token
from cartoloop.viewer.protocol import MessageType

Key = tuple[int, int]
"""Identifies a part: its position in the order of sending, and the number of a submap."""

BUNDLE_BYTES = 256 * 1024
"""Size from which a WebSocket message is sent [bytes]; the state may change before the next."""

_ORDER = (
    MessageType.HELLO, MessageType.PLAYBACK, MessageType.READINGS, MessageType.SUBMAP_POSES,
    MessageType.NODES, MessageType.NODE_TIMES, MessageType.SUBMAP_PREVIEW,
    MessageType.SUBMAP, MessageType.CONSTRAINTS, MessageType.QUALITY,
    MessageType.FACTS, MessageType.SESSIONS, MessageType.EDITS, MessageType.LATEST_CLOSURE,
    MessageType.PATH, MessageType.STATES, MessageType.LOCALISATION, MessageType.SCAN,
)  # fmt: skip


def key_of(kind: MessageType, submap: int = 0) -> Key:
    """Return the key of a part."""
    return _ORDER.index(kind), submap


class Subscription:
    """What one page has seen, and which parts have changed since.

    Attributes
    ----------
    changed : set whenever there is something to send.
    """

    def __init__(self, keys: Iterable[Key]) -> None:
        self.changed = Event()
        self.changed.set()
        self._dirty = set(keys)
        self._seen: dict[Key, Token] = {}
        self._is_complete = False

    def note(self, key: Key) -> None:
        """Note that a part has changed."""
        self._dirty.add(key)
        self.changed.set()

    def bundle(self, parts: Mapping[Key, Part]) -> bytes:
        """Return the next messages for this page, b"" if it is up to date."""
        messages: list[bytes] = []
        size = 0
        for key in sorted(self._dirty):
            self._dirty.discard(key)
            message, self._seen[key] = parts[key].news(self._seen.get(key))
            if message:
                messages.append(message)
                size += len(message)
            if size >= BUNDLE_BYTES:
                return b"".join(messages)
        if not self._is_complete:
            self._is_complete = True
            messages.append(protocol.json_message(MessageType.COMPLETE, {}))
        self.changed.clear()
        return b"".join(messages)


class Subscriptions:
    """The pages that are connected.

    Attributes
    ----------
    is_watched : set while at least one page is connected.
    """

    def __init__(self) -> None:
        self.is_watched = Event()
        self._all: set[Subscription] = set()

    def add(self, keys: Iterable[Key]) -> Subscription:
        """Return the subscription of a new page, which lacks all parts."""
        subscription = Subscription(keys)
        self._all.add(subscription)
        self.is_watched.set()
        return subscription

    def remove(self, subscription: Subscription) -> None:
        """Forget a page that has left."""
        self._all.discard(subscription)
        if not self._all:
            self.is_watched.clear()

    def note(self, kind: MessageType, submap: int = 0) -> None:
        """Note for all pages that a part has changed."""
        key = key_of(kind, submap)
        for subscription in self._all:
            subscription.note(key)
