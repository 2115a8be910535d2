# SPDX-License-Identifier: Apache-2.0
"""Serves a state to any number of pages, in a background thread with an event loop."""

from __future__ import annotations

import asyncio
import math
import secrets
import socket
from collections.abc import Callable
from contextlib import suppress
from threading import Event, Thread
from time import perf_counter

import uvicorn

from cartoloop.errors import ServeError
from cartoloop.viewer.app import create_app, is_loopback
from cartoloop.viewer.budget import MAX_REST_S, Budget, Clocks
from cartoloop.viewer.connections import ACCEPTED_AT_ONCE, BoundedConnection
from cartoloop.viewer.editing import Editing
from cartoloop.viewer.playback import Playback
from cartoloop.viewer.requests import MAX_REQUEST_BYTES
from cartoloop.viewer.view_state import ViewState

DEFAULT_HOST, DEFAULT_PORT = "127.0.0.1", 8765

READINGS_PERIOD_S = 0.25
"""Time between two updates of the figures [s]."""

SEND_BUFFER_BYTES = 2**18
"""Size of the send buffer of a connection: little, or a slow page gets old updates [bytes]."""

PING_TIMEOUT_S = 20.0
"""A page that does not answer a ping within this time is disconnected [s]."""

_PORTS_TRIED = 20
"""Number of consecutive ports to try."""

_LOOK_UP_S = 0.2
"""Period of checks whether the thread still runs, while waiting for it [s]."""

NextUpdate = Callable[[], Callable[[], None] | None]
"""Returns what takes the next update into the state, None without one."""

_ANY_HOST = ("0.0.0.0", "::")
_ELSEWHERE = "192.0.2.1"  # reserved for documentation: no host has it


class ViewServer:
    """A running server.

    Parameters
    ----------
    state : what is shown; from now on it belongs to the server's thread.
    next_update : called in the server's thread; None where the state does not change.
    playback : what pages may pause.
    host, port : where it is served; where the port is taken, one of the next.
    editing : carries out the edits of pages; None where they may not edit.

    Attributes
    ----------
    failure : the first thing that went wrong, if any did.
    url : what a browser on this machine, or on another if the host allows that, must open.

    Raises
    ------
    ServeError
        It cannot be served there.
    """

    def __init__(
        self,
        state: ViewState,
        next_update: NextUpdate | None = None,
        playback: Playback | None = None,
        host: str = DEFAULT_HOST,
        port: int = DEFAULT_PORT,
        editing: Editing | None = None,
    ) -> None:
        self._state = state
        self._next_update = next_update
        self._playback = playback
        self.failure: Exception | None = None
        token = "" if is_loopback(host) else secrets.token_urlsafe(16)
        self._socket = _listen(host, port)
        self.port: int = self._socket.getsockname()[1]
        self.url = _url(host, self.port, token)
        config = uvicorn.Config(
            create_app(state, playback, token, self._note, editing),
            http=BoundedConnection,
            backlog=ACCEPTED_AT_ONCE,
            ws="websockets-sansio",
            ws_max_size=MAX_REQUEST_BYTES,
            ws_per_message_deflate=False,
            ws_ping_timeout=PING_TIMEOUT_S,
            lifespan="off",
            log_config=None,
            log_level="critical",
            access_log=False,
            server_header=False,
            timeout_graceful_shutdown=1,
        )
        self._server = uvicorn.Server(config)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._is_up = Event()
        self._thread = Thread(target=self._run, name="viewer", daemon=True)
        self._thread.start()
        self._is_up.wait()

    @property
    def num_connections(self) -> int:
        """How many connections there are, of pages and others."""
        return len(self._server.server_state.connections)

    def call(self, task: Callable[[], None]) -> None:
        """Run a task in the server's thread, soon; an exception is kept in `failure`."""

        def run() -> None:
            try:
                task()
            except Exception as failure:  # noqa: BLE001 - kept in `failure`; mapping must go on
                self._note(failure)

        if self._loop is not None and self._thread.is_alive():
            with suppress(RuntimeError):  # the loop has just been closed
                self._loop.call_soon_threadsafe(run)

    def call_and_wait(self, task: Callable[[], None], timeout: float = 60.0) -> None:
        """Run a task in the server's thread, and return when it is done."""
        done = Event()

        def run() -> None:
            try:
                task()
            finally:
                done.set()

        self.call(run)
        end = perf_counter() + timeout
        while self._thread.is_alive() and perf_counter() < end and not done.wait(_LOOK_UP_S):
            pass  # a thread that ends does no more

    def close(self) -> None:
        """Close all connections and end the thread."""
        self._server.should_exit = True
        self._thread.join(timeout=5.0)
        self._socket.close()

    def _run(self) -> None:
        try:
            asyncio.run(self._serve())
        except Exception as failure:  # noqa: BLE001 - kept in `failure`; mapping must go on
            self._note(failure)
        finally:
            self._is_up.set()

    async def _serve(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._is_up.set()
        updating = asyncio.create_task(self._update())
        updating.add_done_callback(self._note_failure)
        try:
            await self._server.serve(sockets=[self._socket])
        finally:
            updating.cancel()

    def _note_failure(self, task: asyncio.Task[None]) -> None:
        if not task.cancelled() and isinstance(failure := task.exception(), Exception):
            self._note(failure)
            self._server.should_exit = True  # pages must not believe what is no longer kept up

    def _note(self, failure: Exception) -> None:
        self.failure = self.failure or failure

    async def _update(self) -> None:
        """Take in updates as they come, draw growing submaps as often as that is cheap enough."""
        budget, refreshed, is_drawn = Budget(), -math.inf, True
        while True:
            now = Clocks.now()
            take_in = self._next_update() if self._next_update is not None else None
            flat_out = take_in is not None and self._is_flat_out
            budget.begin(now, flat_out=flat_out)
            if take_in is not None:
                take_in()
                is_drawn = False
            if not is_drawn and budget.may_draw(now, flat_out=flat_out):
                budget.draw(now)
                is_drawn = True
                self._state.draw_growing()
            if now.wall - refreshed >= READINGS_PERIOD_S:
                self._state.refresh()
                refreshed = now.wall
            await asyncio.sleep(budget.pause_s(Clocks.now()))
            with suppress(TimeoutError):  # without pages, seldom is enough
                async with asyncio.timeout(MAX_REST_S):
                    await self._state.subscriptions.is_watched.wait()

    @property
    def _is_flat_out(self) -> bool:
        """Whether a recording is mapped as fast as it can be."""
        playback = self._playback
        return playback is not None and playback.speed is None and not playback.paused


def _listen(host: str, port: int) -> socket.socket:
    """Return a listening socket at the first port that is free."""
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    except (OSError, OverflowError) as error:
        raise ServeError(
            f"--view-host {host}: there is no such host ({error}); give an address of this machine"
        ) from error
    last: OSError | None = None
    for number in range(port, min(port + _PORTS_TRIED, 2**16) if port else 1):
        listening = socket.socket(family, socket.SOCK_STREAM)
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        # inherited by connections: what the system holds for a slow page is old when it arrives
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        try:
            listening.bind((address[0], number))
            listening.listen()
            return listening
        except OSError as error:
            listening.close()
            last = error
    reason = last.strerror if last else "no such port"
    raise ServeError(
        f"the viewer cannot be served on {host}, ports {port} and following: {reason}; choose "
        "another with --view-port"
    )


def _own_address() -> str:
    """Return the address by which others reach this machine, its name if it has none."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe, suppress(OSError):
        probe.connect((_ELSEWHERE, 9))  # sends nothing: the system only chooses a route
        return str(probe.getsockname()[0])
    return socket.gethostname()


def _url(host: str, port: int, token: str) -> str:
    name = _own_address() if host in _ANY_HOST else host
    if ":" in name:
        name = f"[{name}]"
    return f"http://{name}:{port}/" + (f"?token={token}" if token else "")
