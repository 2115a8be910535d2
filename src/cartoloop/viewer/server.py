# SPDX-License-Identifier: Apache-2.0
"""Serves a state to any number of pages, in a background thread with an event loop."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from contextlib import suppress
from threading import Event, Thread
from time import perf_counter

import uvicorn

from cartoloop.viewer.app import create_app
from cartoloop.viewer.budget import MAX_REST_S, Budget, Clocks
from cartoloop.viewer.connections import ACCEPTED_AT_ONCE, BoundedConnection
from cartoloop.viewer.editing import Editing
from cartoloop.viewer.opening import Opening
from cartoloop.viewer.playback import Playback
from cartoloop.viewer.requests import MAX_REQUEST_BYTES
from cartoloop.viewer.site import DEFAULT_HOST, DEFAULT_PORT, listen, url_of
from cartoloop.viewer.view_state import ViewState

READINGS_PERIOD_S = 0.25
"""Time between two updates of the figures [s]."""

PING_TIMEOUT_S = 20.0
"""A page that does not answer a ping within this time is disconnected [s]."""

_START_PERIOD_S = 0.005
"""Period of checks whether connections can be answered [s]."""

_LOOK_UP_S = 0.2
"""Period of checks whether the thread still runs, while waiting for it [s]."""

NextUpdate = Callable[[], Callable[[], None] | None]
"""Returns what takes the next update into the state, None without one."""


class ViewServer:
    """A running server.

    Parameters
    ----------
    state : what is shown; from now on it belongs to the server's thread.
    next_update : called in the server's thread; None where the state does not change.
    playback : what pages may pause.
    host, port : where it is served; where the port is taken, one of the next.
    editing : carries out the edits of pages; None where they may not edit.
    opening : what was served at that host until now; its place and connections are taken over.

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
        opening: Opening | None = None,
    ) -> None:
        self._state = state
        self._next_update = next_update
        self._playback = playback
        self.failure: Exception | None = None
        place = listen(host, port) if opening is None else opening.place
        self._opening = opening
        self._socket = place.socket
        self.port: int = place.port
        self.url = url_of(host, place)
        config = uvicorn.Config(
            create_app(state, playback, place.token, self._note, editing),
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
        taking_over = asyncio.create_task(self._take_over())
        taking_over.add_done_callback(self._note_failure)
        try:
            await self._server.serve(sockets=[self._socket])
        finally:
            updating.cancel()
            taking_over.cancel()

    async def _take_over(self) -> None:
        """Answer the connections that were made before there was a view."""
        if self._opening is None:
            return
        while not self._server.started:
            await asyncio.sleep(_START_PERIOD_S)
        for connection in self._opening.end():

            def protocol() -> BoundedConnection:
                state = self._server.lifespan.state
                return BoundedConnection(self._server.config, self._server.server_state, state)

            assert self._loop is not None
            with suppress(OSError):  # it has gone again
                await self._loop.connect_accepted_socket(protocol, connection)

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
