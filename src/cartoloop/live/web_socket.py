# SPDX-License-Identifier: Apache-2.0
"""The protocol of WebSocket on the bytes of one connection: handshake, frames, pings."""

from __future__ import annotations

from typing import ClassVar

from websockets.frames import Frame, Opcode
from websockets.http11 import Request
from websockets.protocol import State
from websockets.server import ServerProtocol

from cartoloop.live.source import MAX_LINE_BYTES, LineReceiver

_DATA = (Opcode.TEXT, Opcode.BINARY, Opcode.CONT)
_NORMAL_CLOSES = (1000, 1001)


class WebSocketReceiver:
    """Takes messages out of the bytes of a WebSocket, and has the bytes to answer.

    Pages in a browser are refused: otherwise any page that a user visits could send scans.

    Parameters
    ----------
    lines : receives the content of the messages; the end of a message is that of a line.
    """

    answers_pings: ClassVar[bool] = True

    def __init__(self, lines: LineReceiver) -> None:
        self._lines = lines
        self._protocol = ServerProtocol(origins=[None], max_size=MAX_LINE_BYTES)

    def feed(self, data: bytes) -> None:
        """Add the next bytes."""
        self._protocol.receive_data(data)
        for event in self._protocol.events_received():
            if isinstance(event, Request):
                if self._protocol.eof_sent:
                    continue  # what follows the request is nonsense: it was refused already
                self._protocol.send_response(self._protocol.accept(event))
            elif isinstance(event, Frame) and event.opcode in _DATA:
                self._lines.feed(bytes(event.data))
                if event.fin:
                    self._lines.end()

    def end(self) -> str:
        """Note that the connection ended; return how."""
        self._protocol.receive_eof()
        self._lines.reset()  # a message without its end
        received = self._protocol.close_rcvd
        if received is not None and received.code in _NORMAL_CLOSES:
            return "disconnected"
        if self._protocol.handshake_exc is not None:
            return f"refused: {self._protocol.handshake_exc}"
        return "lost: the connection was not closed properly"

    def ping(self) -> None:
        """Ask the other side whether it is still there; any answer will do."""
        if self._is_open:
            self._protocol.send_ping(b"")

    def say_goodbye(self) -> None:
        """Announce to the other side that this program ends."""
        if self._is_open:
            self._protocol.send_close(1001)

    @property
    def _is_open(self) -> bool:
        """Whether the handshake is done, and neither side has begun to close the connection."""
        return self._protocol.state is State.OPEN and self._protocol.close_rcvd is None

    def answer(self) -> bytes:
        """Return the bytes to send, each once."""
        return b"".join(self._protocol.data_to_send())

    @property
    def is_over(self) -> bool:
        """Whether the connection is to be closed once the answer is sent."""
        return self._protocol.close_expected()
