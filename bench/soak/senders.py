# SPDX-License-Identifier: Apache-2.0
"""Sources, and the connections of a robot to them: lines of JSON over TCP or WebSocket."""

from __future__ import annotations

import json
import socket
import struct
from collections.abc import Callable
from contextlib import ExitStack
from threading import Event
from typing import Protocol

import numpy as np
from websockets.sync.client import connect

from cartoloop.live.messages import LiveMessage
from cartoloop.live.notices import Notices
from cartoloop.live.sockets import TcpSource, WebSocketSource
from cartoloop.live.source import Put, Source
from cartoloop.sensor.events import LaserScan, Odometry, SensorEvent

UNFINISHED = b'{"type": "scan", "ranges": [1.0, 2.'
"""The beginning of a message."""


class Sender(Protocol):
    """A connection of the robot."""

    def send(self, data: bytes) -> None:
        """Send lines."""

    def close(self) -> None:
        """Close the connection when all was read; what comes later cannot overtake it then."""

    def break_off(self) -> int:
        """Close it in the middle of a message; return the number of messages that are damaged."""

    def cut(self) -> None:
        """Reset it at once (RST): what is on its way is lost."""


Connect = Callable[[tuple[str, int]], Sender]
"""Returns a connection to an address."""


class TcpSender:
    """Lines over TCP."""

    def __init__(self, address: tuple[str, int]) -> None:
        self._socket = socket.create_connection(address)

    def send(self, data: bytes) -> None:
        """Send lines."""
        self._socket.sendall(data)

    def close(self) -> None:
        """Close the connection when all was read."""
        self._socket.shutdown(socket.SHUT_WR)
        while self._socket.recv(1000):
            pass
        self._socket.close()

    def break_off(self) -> int:
        """Close it in the middle of a message."""
        self.send(UNFINISHED)
        self.close()
        return 1

    def cut(self) -> None:
        """Reset the connection in the middle of a message."""
        self.send(UNFINISHED)
        _reset_on_close(self._socket)
        self._socket.close()


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

    def send(self, data: bytes) -> None:
        """Send lines."""
        self._connection.send(data)

    def close(self) -> None:
        """Close the connection when all was read."""
        self._context.close()

    def break_off(self) -> int:
        """Close it: a message of a WebSocket is whole or nothing."""
        self.close()
        return 0

    def cut(self) -> None:
        """Reset the connection."""
        _reset_on_close(self._connection.socket)
        self._connection.close_socket()
        self._context.close()


SOURCES: dict[str, tuple[type[TcpSource | WebSocketSource], Connect]]
SOURCES = {"tcp": (TcpSource, TcpSender), "ws": (WebSocketSource, WebSocketSender)}


class Watched:
    """A source of which each scan is reported when it comes.

    Parameters
    ----------
    source : the source.
    came : called with the stamp of each scan, in the thread of the source.
    """

    def __init__(self, source: Source, came: Callable[[float], None]) -> None:
        self._source = source
        self._came = came

    @property
    def name(self) -> str:
        """Its name in the report."""
        return self._source.name

    def open(self) -> str:
        """Open the source; return a line that describes it."""
        return self._source.open()

    def run(self, put: Put, notices: Notices, stop: Event) -> None:
        """Pass on messages until the source ends or `stop` is set."""

        def report(message: LiveMessage) -> None:
            if isinstance(message, LaserScan):
                self._came(message.stamp)
            put(message)

        self._source.run(report, notices, stop)


def line(event: SensorEvent, stamp: float) -> bytes:
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
