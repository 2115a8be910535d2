# SPDX-License-Identifier: Apache-2.0
"""Connections over TCP and WebSocket: lines of JSON."""

from __future__ import annotations

import json
import socket
import struct
from collections.abc import Callable
from contextlib import ExitStack

import numpy as np
from websockets.sync.client import connect

from bench.soak.senders import Sender, Silent
from cartoloop.live.sockets import TcpSource, WebSocketSource
from cartoloop.live.source import Source
from cartoloop.sensor.events import LaserScan, Odometry, SensorEvent

MAX_AHEAD = 100
"""Scans on their way at a time: by so much a mapper may be behind a robot."""

_UNFINISHED = b'{"type": "scan", "ranges": [1.0, 2.'
_UNKNOWN = b'{"type": "battery", "volts": 24.1}\n'
_END = b'{"type": "end"}\n'


class TcpSender:
    """Lines over TCP."""

    def __init__(self, address: tuple[str, int]) -> None:
        self._socket = socket.create_connection(address)

    def send(self, event: SensorEvent, stamp: float) -> None:
        """Send a message."""
        self._socket.sendall(_line(event, stamp))

    def flood(self, count: int) -> int:
        """Send lines of an unknown kind."""
        self._socket.sendall(_UNKNOWN * count)
        return count

    def send_garbage(self, data: bytes) -> int:
        """Send a line of nonsense."""
        self._socket.sendall(data.replace(b"\n", b" ") + b"\n")
        return 1

    def break_off(self) -> int:
        """Close it in the middle of a line."""
        self._socket.sendall(_UNFINISHED)
        self.close()
        return 1

    def cut(self) -> None:
        """Reset it in the middle of a line."""
        self._socket.sendall(_UNFINISHED)
        _reset_on_close(self._socket)
        self._socket.close()

    def close(self) -> None:
        """Close it when all was read."""
        self._socket.shutdown(socket.SHUT_WR)
        while self._socket.recv(1000):
            pass
        self._socket.close()

    def end(self) -> None:
        """Announce the end, and close it."""
        self._socket.sendall(_END)
        self.close()


class WebSocketSender:
    """Lines over WebSocket.

    The source is held up while its queue is full, as ``--no-drop`` wants it, and answers neither
    pings nor the end of the connection until it has read what came before: it is waited for.
    """

    def __init__(self, address: tuple[str, int]) -> None:
        self._context = ExitStack()
        self._connection = self._context.enter_context(
            connect(
                "ws://{}:{}".format(*address),
                compression=None,
                open_timeout=None,
                ping_interval=None,
                close_timeout=None,
            )
        )

    def send(self, event: SensorEvent, stamp: float) -> None:
        """Send a message."""
        self._connection.send(_line(event, stamp))

    def flood(self, count: int) -> int:
        """Send lines of an unknown kind, in one message."""
        self._connection.send(_UNKNOWN * count)
        return count

    def send_garbage(self, data: bytes) -> int:
        """Send a message of nonsense."""
        self._connection.send(data.replace(b"\n", b" "))
        return 1

    def break_off(self) -> int:
        """Close it: a message of a WebSocket is whole or nothing."""
        self.close()
        return 0

    def cut(self) -> None:
        """Reset it."""
        _reset_on_close(self._connection.socket)
        self._connection.close_socket()
        self._context.close()

    def close(self) -> None:
        """Close it when all was read."""
        self._context.close()

    def end(self) -> None:
        """Announce the end, and close it."""
        self._connection.send(_END)
        self.close()


class SocketNetwork:
    """A source that listens, and connections to it."""

    max_ahead = MAX_AHEAD
    end_after = None

    def __init__(
        self,
        source: TcpSource | WebSocketSource,
        sender: Callable[[tuple[str, int]], Sender],
    ) -> None:
        self._source = source
        self._sender = sender

    @property
    def source(self) -> Source:
        """The source."""
        return self._source

    def connect(self) -> Sender:
        """Return a connection."""
        return self._sender(self._source.address)

    def connect_silent(self) -> Silent:
        """Return a TCP connection that sends nothing."""
        return socket.create_connection(self._source.address)


def tcp_network() -> SocketNetwork:
    """Return a source of lines over TCP, at a free port of this machine."""
    return SocketNetwork(TcpSource("127.0.0.1", 0), TcpSender)


def web_socket_network() -> SocketNetwork:
    """Return a source of lines over WebSocket, at a free port of this machine."""
    return SocketNetwork(WebSocketSource("127.0.0.1", 0), WebSocketSender)


def _line(event: SensorEvent, stamp: float) -> bytes:
    """Return a message, rounded as robots send them."""
    if isinstance(event, Odometry):
        x, y, theta = event.tf_odom_tracking
        content: dict[str, object] = {"type": "odometry", "x": x, "y": y, "theta": theta}
    else:
        assert isinstance(event, LaserScan)
        geometry = event.geometry
        content = {
            "type": "scan",
            "angle_min": geometry.angle_min,
            "angle_increment": geometry.angle_increment,
            "range_max": 30.0,
            "ranges": np.round(event.ranges, 3).tolist(),
        }
    return json.dumps({**content, "stamp": stamp}).encode() + b"\n"


def _reset_on_close(connection: socket.socket) -> None:
    """Let the end of a connection be a reset, without what was not sent yet."""
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
