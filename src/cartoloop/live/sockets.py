# SPDX-License-Identifier: Apache-2.0
"""Messages over TCP and WebSocket; robots may connect, leave and return.

One thread serves all connections, so that none of them costs more than its socket and its
incomplete line.
"""

from __future__ import annotations

import ipaddress
import selectors
import socket
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from threading import Event
from typing import ClassVar

from cartoloop.errors import InputError
from cartoloop.live.connection import Client, PlainReceiver, Receiver
from cartoloop.live.notices import Notices
from cartoloop.live.source import POLL_S, LineReceiver, Put

MAX_CLIENTS = 16
"""Connections at a time; a robot needs one, or one for each sensor."""

FIRST_MESSAGE_S = 30.0
"""A connection without a first message ends after this time [s]: scanners take seconds to start."""

SILENT_S = 600.0
"""A connection that has sent messages ends after this time without one [s]: a robot that charges
longer connects again."""

ACTIVE_S = 5.0
"""A connection that sent a message within this time keeps its place when all are taken [s]."""

KEEPALIVE_S = 20.0
"""Period at which silent connections are asked whether they still exist [s]."""

MAX_UNFINISHED_BYTES = 96 << 20
"""Incomplete messages of all connections: six of the longest ones [bytes]."""

_CHUNK = 2**16
_BACKLOG = 128
_GOODBYE_S = 1.0
"""Time for the other side to read why it is refused [s]."""


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
        listening.listen(_BACKLOG)
    except OSError as error:
        listening.close()
        raise InputError(
            f"{host}:{port}: cannot listen there: {error.strerror}; choose another port, or end "
            "the program that uses it"
        ) from error
    return listening


class _Listener(ABC):
    """A listening socket for robots.

    A new connection takes the place of one that never sent a message, or of the one that is silent
    for longest, when all are taken; only those that sent a message just now keep theirs.

    Parameters
    ----------
    host, port : where to listen; port 0 is any free one.
    clock : that never jumps [s].
    """

    scheme: ClassVar[str]

    def __init__(
        self, host: str, port: int, *, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._host, self._port = host, port
        self._socket: socket.socket | None = None
        self._clock = clock
        self._clients: list[Client] = []
        self._accepts_from = 0.0

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

    def run(self, put: Put, notices: Notices, stop: Event) -> None:
        """Pass on the messages of all senders; nothing that they do ends it."""
        assert self._socket is not None
        self._put, self._notices = put, notices
        self._socket.setblocking(False)
        with self._socket, selectors.DefaultSelector() as self._selector:
            self._selector.register(self._socket, selectors.EVENT_READ)
            while not stop.is_set():
                for key, _ in self._selector.select(POLL_S):
                    if key.data is None:
                        self._accept(self._socket)
                    elif key.data in self._clients:  # not closed in this round
                        self._receive(key.data)
                self._enforce_limits()
            for client in list(self._clients):
                client.receiver.say_goodbye()
                self._send(client)
                self._close(client)

    @abstractmethod
    def _receiver(self, lines: LineReceiver) -> Receiver:
        """Return the protocol of a new connection."""

    def _accept(self, listening: socket.socket) -> None:
        now = self._clock()
        try:
            connection, address = listening.accept()
        except (BlockingIOError, ConnectionAbortedError, InterruptedError):
            return
        except OSError as error:
            # Too many open files, as a rule: not asked again at once, because it would not end.
            self._notices.note("connection refused", f"{self.name}: {error.strerror}")
            self._selector.unregister(listening)
            self._accepts_from = now + POLL_S
            return
        if not self._make_room(now):
            detail = f"{self.name}: {MAX_CLIENTS} senders are active already"
            self._notices.note("connection refused", detail)
            connection.close()
            return
        where = f"{address[0]}:{address[1]}"
        connection.setblocking(False)
        _keep_alive(connection)
        lines = LineReceiver(self._put, self._notices, where)
        receiver = self._receiver(lines)
        client = Client(connection, where, lines, receiver, now, now, now + KEEPALIVE_S)
        self._clients.append(client)
        self._selector.register(connection, selectors.EVENT_READ, client)
        self._notices.note("connected", f"{where} connected")

    def _make_room(self, now: float) -> bool:
        """Close a connection if all places are taken; return whether one is free."""
        if len(self._clients) < MAX_CLIENTS:
            return True
        client = min(
            self._clients, key=lambda c: (c.closes_at is None, c.has_spoken, c.last_message)
        )
        if client.has_spoken and now - client.last_message < ACTIVE_S:
            return False
        self._drop(client, "its place was needed")
        return True

    def _receive(self, client: Client) -> None:
        try:
            data = client.socket.recv(_CHUNK)
        except (BlockingIOError, InterruptedError):
            return
        except OSError as error:
            client.lines.reset()
            self._close(client, f"lost: {error.strerror or error}")
            return
        if not data:
            self._close(client, None if client.closes_at is None else "")
            return
        if client.closes_at is not None:
            return  # nothing it sends matters any more
        num_lines = client.lines.num_lines
        try:
            client.receiver.feed(data)
        except Exception as error:  # noqa: BLE001 - a fault in one connection ends no other
            self._notices.skip("message skipped: unexpected error")
            self._drop(client, f"unexpected {type(error).__name__}: {error}")
            return
        self._send(client)
        now = self._clock()  # parsing takes time, and a full queue may hold it up
        client.last_sign = now
        client.unfinished += len(data)
        if client.lines.num_lines > num_lines:
            client.last_message, client.unfinished = now, client.lines.num_unfinished
        if client.receiver.is_over and client in self._clients:
            self._say_end(client, client.receiver.end())
            with suppress(OSError):
                client.socket.shutdown(socket.SHUT_WR)
            client.closes_at = now + _GOODBYE_S

    def _send(self, client: Client) -> None:
        if not (answer := client.receiver.answer()):
            return
        try:
            sent = client.socket.send(answer)
        except OSError:
            sent = 0
        if sent < len(answer):
            self._drop(client, "it does not read the answers")

    def _enforce_limits(self) -> None:
        now = self._clock()
        if 0.0 < self._accepts_from <= now and self._socket is not None:
            self._accepts_from = 0.0
            self._selector.register(self._socket, selectors.EVENT_READ)
        for client in list(self._clients):
            limit = SILENT_S if client.has_spoken else FIRST_MESSAGE_S
            if client.closes_at is not None:
                if now >= client.closes_at:
                    self._close(client, "")
            elif now - client.last_message > limit:
                self._drop(client, f"no message in {limit:.0f} s")
            elif client.receiver.answers_pings and now - client.last_sign > 3.0 * KEEPALIVE_S:
                self._drop(client, "it does not answer")
            elif now >= client.next_ping:
                client.next_ping = now + KEEPALIVE_S
                client.receiver.ping()
                self._send(client)
        while sum(client.unfinished for client in self._clients) > MAX_UNFINISHED_BYTES:
            largest = max(self._clients, key=lambda client: client.unfinished)
            self._drop(largest, "incomplete messages fill the memory")

    def _drop(self, client: Client, reason: str) -> None:
        """Close a connection that this side ends."""
        client.lines.reset()
        client.receiver.say_goodbye()
        with suppress(OSError):
            client.socket.send(client.receiver.answer())
        self._close(client, f"closed: {reason}")

    def _close(self, client: Client, reason: str | None = None) -> None:
        """Forget a connection; `reason` is None where its protocol knows, "" if it was said."""
        if client not in self._clients:
            return
        self._clients.remove(client)
        self._selector.unregister(client.socket)
        client.socket.close()
        if reason is None:
            reason = client.receiver.end()
        if reason:
            self._say_end(client, reason)

    def _say_end(self, client: Client, reason: str) -> None:
        detail = f"{client.where} {reason}, after {client.lines.num_lines} messages"
        self._notices.note("disconnected", detail)


class TcpSource(_Listener):
    """Newline-delimited JSON from all programs that connect."""

    scheme = "tcp"

    def _receiver(self, lines: LineReceiver) -> Receiver:
        return PlainReceiver(lines)


class WebSocketSource(_Listener):
    """The same messages over WebSocket; a WebSocket message holds one or several lines."""

    scheme = "ws"

    def _receiver(self, lines: LineReceiver) -> Receiver:
        from cartoloop.live.web_socket import WebSocketReceiver

        return WebSocketReceiver(lines)


def _keep_alive(connection: socket.socket) -> None:
    """Have the operating system notice that the other side is gone, where it can."""
    with suppress(OSError):
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for option, value in (
            ("TCP_KEEPIDLE", KEEPALIVE_S),
            ("TCP_KEEPINTVL", 5),
            ("TCP_KEEPCNT", 3),
        ):
            if hasattr(socket, option):
                connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), int(value))
