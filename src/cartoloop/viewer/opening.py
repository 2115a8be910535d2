# SPDX-License-Identifier: Apache-2.0
"""Serves the page and a saved picture of a map while the map is being read.

It knows as much of HTTP as it takes to answer a browser that asks for files of the page. All other
connections, such as the WebSocket of the page, wait unread until the view takes them over.
"""

from __future__ import annotations

import hmac
import socket
from contextlib import suppress
from selectors import EVENT_READ, EVENT_WRITE, DefaultSelector
from threading import Event, Thread
from time import perf_counter
from urllib.parse import parse_qs, urlsplit

from cartoloop.viewer.site import HEADERS, Listening, is_loopback, static_files

PICTURE_PATH = "opening.png"

_MAX_CONNECTIONS = 128
"""More than these stay in the queue of the system."""

_MAX_HEAD_BYTES = 8192
"""Longer requests are left to the view [bytes]."""

_PERIOD_S = 0.02
"""Period of checks whether the view takes over [s]."""

_LAST_SENDS_S = 5.0
"""What was not taken this long after the view took over is not sent any more [s]."""

_BEFORE = b'<p id="empty"'
_STATE, _READING = b">connecting<", b">reading the map<"
_IMAGE = b'<img id="opening" class="opening" alt="The map as it was saved" src="%s">\n'


class Opening:
    """A running server of the picture.

    Parameters
    ----------
    picture : as a PNG.
    place : where it is served; taken over by the view.

    Attributes
    ----------
    place : as given.
    """

    def __init__(self, picture: bytes, place: Listening) -> None:
        self._files = static_files()
        self._picture = picture
        self.place = place
        self._selector = DefaultSelector()
        self._unread: list[socket.socket] = []
        self._sending: dict[socket.socket, memoryview] = {}
        self._is_ending = Event()
        self._thread = Thread(target=self._run, name="opening", daemon=True)
        self._has_ended = Event()
        place.socket.setblocking(False)
        self._thread.start()

    def end(self) -> list[socket.socket]:
        """Accept no more; return the connections that the view must answer."""
        self._is_ending.set()
        self._has_ended.wait()
        return self._unread

    def close(self) -> None:
        """End, and close all connections and the place, unless the view has taken them over."""
        if not self._is_ending.is_set():
            for connection in [*self.end(), self.place.socket]:
                connection.close()

    def _run(self) -> None:
        self._selector.register(self.place.socket, EVENT_READ)
        try:
            while not self._is_ending.is_set():
                self._step(_PERIOD_S)
        finally:
            self._selector.unregister(self.place.socket)
            for key in list(self._selector.get_map().values()):
                if (connection := key.fileobj) not in self._sending:
                    self._selector.unregister(connection)
                    self._unread.append(connection)  # type: ignore[arg-type]  # all are sockets
            self._has_ended.set()
        end = perf_counter() + _LAST_SENDS_S
        while self._sending and perf_counter() < end:
            self._step(_PERIOD_S)
        for connection in self._sending:
            connection.close()
        self._selector.close()

    def _step(self, timeout: float) -> None:
        for key, _ in self._selector.select(timeout):
            connection = key.fileobj
            assert isinstance(connection, socket.socket)
            if connection is self.place.socket:
                self._accept()
            elif connection in self._sending:
                self._send(connection)
            else:
                self._answer(connection)

    def _accept(self) -> None:
        num_connections = len(self._selector.get_map()) + len(self._unread)
        if num_connections > _MAX_CONNECTIONS:
            self._is_ending.wait(_PERIOD_S)
            return
        try:
            connection, _ = self.place.socket.accept()
        except OSError:  # it has gone again, or too many files are open
            self._is_ending.wait(_PERIOD_S)
            return
        connection.setblocking(False)
        self._selector.register(connection, EVENT_READ)

    def _answer(self, connection: socket.socket) -> None:
        """Answer a request for a file; leave all else unread."""
        self._selector.unregister(connection)
        try:
            head = connection.recv(_MAX_HEAD_BYTES, socket.MSG_PEEK)
            answer = self._content(head) if head else None
            if answer is None:
                self._unread.append(connection)
                return
            connection.recv(len(head))
        except OSError:  # it has gone again
            connection.close()
            return
        self._sending[connection] = memoryview(answer)
        self._selector.register(connection, EVENT_WRITE)

    def _send(self, connection: socket.socket) -> None:
        """Send what the connection takes; close it after the last byte."""
        left = self._sending[connection]
        try:
            left = left[connection.send(left) :]
        except BlockingIOError:
            return
        except OSError:  # it has gone
            left = left[:0]
        self._sending[connection] = left
        if not left:
            self._selector.unregister(connection)
            del self._sending[connection]
            connection.close()

    def _content(self, head: bytes) -> bytes | None:
        """Return the answer to a request; None if it is not for a file, or not all of a request."""
        if not (head.startswith(b"GET /") and head.endswith(b"\r\n\r\n")):
            return None
        first, *lines = head.decode("latin-1").split("\r\n")
        words = first.split(" ")
        if len(words) != 3:
            return None
        path, _, query = words[1][1:].partition("?")
        may_look = self._may_look(lines, query)
        if path == PICTURE_PATH and may_look:
            return _answer(self._picture, "image/png")
        found = self._files.get(path or "index.html")
        if found is None:
            return None
        content, kind = found
        if path in ("", "index.html") and may_look:
            token = f"?token={self.place.token}" if self.place.token else ""
            image = _IMAGE % (PICTURE_PATH + token).encode()
            content = content.replace(_BEFORE, image + _BEFORE, 1).replace(_STATE, _READING, 1)
        return _answer(content, kind)

    def _may_look(self, lines: list[str], query: str) -> bool:
        """Return whether a request knows the token, or called this machine by a name of itself."""
        token = self.place.token
        if token:
            given = parse_qs(query).get("token", [""])[0]
            return hmac.compare_digest(given.encode(), token.encode())
        hosts = [line[5:].strip() for line in lines if line[:5].lower() == "host:"]
        with suppress(ValueError):  # brackets that hold no address
            return len(hosts) == 1 and is_loopback(urlsplit(f"//{hosts[0]}").hostname or "")
        return False


def _answer(content: bytes, kind: str) -> bytes:
    """Return an answer with all its headers."""
    headers = HEADERS | {
        "Content-Type": f"{kind}; charset=utf-8" if kind.startswith("text/") else kind,
        "Content-Length": str(len(content)),
        "Cross-Origin-Resource-Policy": "same-origin",
        "Connection": "close",
    }
    lines = ["HTTP/1.1 200 OK", *(f"{name}: {value}" for name, value in headers.items())]
    return "\r\n".join([*lines, "", ""]).encode("latin-1") + content
