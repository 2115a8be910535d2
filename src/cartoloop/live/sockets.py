# SPDX-License-Identifier: Apache-2.0
"""Messages over TCP and WebSocket; robots may connect, leave and return."""

from __future__ import annotations

import ipaddress
import socket
from contextlib import suppress
from threading import BoundedSemaphore, Event, Thread
from typing import TYPE_CHECKING, ClassVar

from cartoloop.errors import InputError
from cartoloop.live.notices import Notices
from cartoloop.live.source import MAX_LINE_BYTES, POLL_S, LineReceiver, Put

if TYPE_CHECKING:
    from websockets.sync.server import ServerConnection

MAX_CLIENTS = 16
"""Connections at a time; a robot needs one, or one for each sensor."""

_CHUNK = 2**16


def is_loopback(host: str) -> bool:
    """Return whether only this machine can reach a host."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def listen(host: str, port: int) -> socket.socket:
    """Return a listening socket.

    Raises
    ------
    InputError
        It cannot be opened.
    """
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        listening = socket.socket(family, socket.SOCK_STREAM)
    except (OSError, OverflowError, UnicodeError) as error:
        raise InputError(
            f"{host}:{port}: there is no such host or port ({error}); give an address of this "
            "machine"
        ) from error
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind(address)
        listening.listen()
    except OSError as error:
        listening.close()
        raise InputError(
            f"{host}:{port}: cannot listen there: {error.strerror}; choose another port, or end "
            "the program that uses it"
        ) from error
    return listening


class _Listener:
    """A listening socket for robots.

    Parameters
    ----------
    host, port : where to listen; port 0 is any free one.
    """

    scheme: ClassVar[str]

    def __init__(self, host: str, port: int) -> None:
        self._host, self._port = host, port
        self._socket: socket.socket | None = None
        self._free = BoundedSemaphore(MAX_CLIENTS)

    @property
    def name(self) -> str:
        """What it is called in the report."""
        return f"{self.scheme}://{self._host}:{self._port}"

    @property
    def address(self) -> tuple[str, int]:
        """Host and port where it listens."""
        return self._host, self._port

    def open(self) -> str:
        """Listen; return where."""
        self._socket = listen(self._host, self._port)
        self._port = self._socket.getsockname()[1]
        return f"listening on {self.name}"


class TcpSource(_Listener):
    """Newline-delimited JSON from all programs that connect."""

    scheme = "tcp"

    def run(self, put: Put, notices: Notices, stop: Event) -> None:
        """Pass on the messages of all senders."""
        assert self._socket is not None
        self._socket.settimeout(POLL_S)
        while not stop.is_set():
            try:
                client, address = self._socket.accept()
            except TimeoutError:
                continue
            except OSError as error:
                notices.note("connection refused", f"{self.name}: {error.strerror}")
                stop.wait(POLL_S)
                continue
            if not self._free.acquire(blocking=False):
                notices.note("connection refused", f"{self.name}: more than {MAX_CLIENTS} senders")
                client.close()
                continue
            where = f"{address[0]}:{address[1]}"
            Thread(
                target=self._serve,
                args=(client, where, put, notices, stop),
                name=f"sender {where}",
                daemon=True,
            ).start()
        self._socket.close()

    def _serve(
        self, client: socket.socket, where: str, put: Put, notices: Notices, stop: Event
    ) -> None:
        notices.note("connected", f"{where} connected")
        lines = LineReceiver(put, notices, where)
        reason = "disconnected"
        try:
            client.settimeout(POLL_S)
            while not stop.is_set():
                try:
                    data = client.recv(_CHUNK)
                except TimeoutError:
                    continue
                if not data:
                    break
                lines.feed(data)
        except OSError as error:
            reason = f"lost: {error.strerror or error}"
            lines.reset()
        finally:
            client.close()
            self._free.release()
        lines.end()
        notices.note("disconnected", f"{where} {reason}, after {lines.num_lines} messages")


class WebSocketSource(_Listener):
    """The same messages over WebSocket; a WebSocket message holds one or several lines.

    Pages in a browser are refused: otherwise any page that a user visits could send scans.
    """

    scheme = "ws"

    def run(self, put: Put, notices: Notices, stop: Event) -> None:
        """Pass on the messages of all senders."""
        from websockets.sync.server import serve

        assert self._socket is not None

        def receive(connection: ServerConnection) -> None:
            if self._free.acquire(blocking=False):
                try:
                    self._serve(connection, put, notices, stop)
                finally:
                    self._free.release()
            else:
                notices.note("connection refused", f"{self.name}: more than {MAX_CLIENTS} senders")

        with serve(
            receive, sock=self._socket, origins=[None], max_size=MAX_LINE_BYTES, compression=None
        ) as server:
            Thread(target=server.serve_forever, name="web socket", daemon=True).start()
            stop.wait()
            server.shutdown()

    def _serve(self, connection: ServerConnection, put: Put, notices: Notices, stop: Event) -> None:
        from websockets.exceptions import ConnectionClosed

        where = "{}:{}".format(*connection.remote_address[:2])
        notices.note("connected", f"{where} connected")
        lines = LineReceiver(put, notices, where)
        reason = "disconnected"
        try:
            while not stop.is_set():
                with suppress(TimeoutError):
                    message = connection.recv(timeout=POLL_S)
                    lines.feed(message.encode() if isinstance(message, str) else message)
                    lines.end()
        except ConnectionClosed as error:
            if error.rcvd is None or error.rcvd.code not in (1000, 1001):
                reason = f"lost: {error}"
        notices.note("disconnected", f"{where} {reason}, after {lines.num_lines} messages")
