# SPDX-License-Identifier: Apache-2.0
# ruff: noqa: T201 - its output is read by the process that started it
"""Clients that receive all messages and draw nothing, in a process of their own.

Run: ``python -m bench.view.clients URL NUMBER``; prints a line when all have joined, and
a JSON of the bytes that each received when the server has closed.
"""

from __future__ import annotations

import asyncio
import json
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from time import perf_counter, time

from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed
from websockets.typing import Origin

from cartoloop.global_slam.pose_graph import ConstraintKind
from cartoloop.viewer.protocol import MessageType, messages

Seen = tuple[int, float]
"""A number of loop closures, and the time at which a page had them [s, wall clock]."""


@asynccontextmanager
async def joined(url: str) -> AsyncIterator[ClientConnection]:
    """Yield a connection like that of a page at that URL."""
    place, _, query = url.partition("?")
    socket = f"{place.replace('http', 'ws', 1)}socket" + (f"?{query}" if query else "")
    origin = Origin(place.rstrip("/"))
    async with connect(socket, origin=origin, max_size=None, compression=None) as connection:
        yield connection


async def take_all(url: str, number: int) -> list[int]:
    """Return the bytes that each of `number` clients received until the server closed."""
    is_joined = asyncio.Semaphore(0)

    async def look() -> int:
        num_bytes = 0
        async with joined(url) as connection:
            is_joined.release()
            try:
                while True:
                    num_bytes += len(await connection.recv())
            except ConnectionClosed:
                return num_bytes

    pages = [asyncio.create_task(look()) for _ in range(number)]
    for _ in pages:
        await is_joined.acquire()
    print("joined", flush=True)
    return await asyncio.gather(*pages)


async def join_once(url: str) -> tuple[float, int]:
    """Return the time until a client has the whole state [s], and its size in bytes."""
    num_bytes = 0
    start = perf_counter()
    async with joined(url) as connection:
        while True:
            data = await connection.recv()
            assert isinstance(data, bytes)
            num_bytes += len(data)
            if any(kind == MessageType.COMPLETE for kind, _ in messages(data)):
                return perf_counter() - start, num_bytes


async def watch_closures(url: str, is_joined: asyncio.Event) -> list[Seen]:
    """Return the numbers of closures that a client had, with the times, until the server closed."""
    seen: list[Seen] = []
    num_closures = 0
    async with joined(url) as connection:
        is_joined.set()
        try:
            while True:
                data = await connection.recv()
                assert isinstance(data, bytes)
                for kind, payload in messages(data):
                    if kind == MessageType.CONSTRAINTS:
                        num_closures = _closures(payload, num_closures)
                        seen.append((num_closures, time()))
        except ConnectionClosed:
            return seen


def _closures(payload: bytes, before: int) -> int:
    """Return the number of closures after a CONSTRAINTS message, given the number before it."""
    first, count = (int.from_bytes(payload[at : at + 4], "little") for at in (0, 4))
    added = payload[16 + 20 * count :].count(ConstraintKind.LOOP_CLOSURE)
    return added + (before if first else 0)


def main() -> None:
    """Run the clients that the arguments describe."""
    url, number = sys.argv[1:]
    print(json.dumps(asyncio.run(take_all(url, int(number)))))


if __name__ == "__main__":
    main()
