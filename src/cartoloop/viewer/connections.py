# SPDX-License-Identifier: Apache-2.0
"""A limit on connections: too many must not keep mapping from opening its files."""

from __future__ import annotations

from asyncio import Transport

from uvicorn.protocols.http.h11_impl import H11Protocol

MAX_CONNECTIONS = 256
"""Fewer than the files that a process may have open, commonly 1024."""

ACCEPTED_AT_ONCE = 64
"""Number of connections that are accepted before they are checked."""


class BoundedConnection(H11Protocol):
    """A connection that makes room where there are too many: first go those that ask nothing."""

    def connection_made(  # type: ignore[override]  # as the class above has it
        self, transport: Transport
    ) -> None:
        """Take in a connection."""
        super().connection_made(transport)
        if len(self.connections) <= MAX_CONNECTIONS:
            return
        idle = [other for other in self.connections if other is not self and _is_idle(other)]
        for connection in idle or [self]:
            connection.transport.abort()


def _is_idle(connection: object) -> bool:
    """Return whether a connection belongs to no page and is idle."""
    if not isinstance(connection, H11Protocol):
        return False
    return connection.cycle is None or connection.cycle.response_complete
