# SPDX-License-Identifier: Apache-2.0
"""The web application: the packaged page, and one WebSocket for each page that looks."""

from __future__ import annotations

import asyncio
import hmac
from collections.abc import Callable
from contextlib import suppress
from urllib.parse import urlsplit

from starlette.applications import Starlette
from starlette.requests import Request as HttpRequest
from starlette.responses import Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from cartoloop.errors import CartoloopError, UsageError
from cartoloop.sensor.pose import Pose
from cartoloop.viewer import protocol, requests
from cartoloop.viewer.editing import NOT_ALLOWED, Editing
from cartoloop.viewer.pictures import Pictures
from cartoloop.viewer.playback import Playback
from cartoloop.viewer.protocol import MessageType
from cartoloop.viewer.requests import BadRequestError, parse_request
from cartoloop.viewer.site import HEADERS, is_loopback, static_files
from cartoloop.viewer.subscriptions import Subscription
from cartoloop.viewer.view_state import ViewState

REQUEST_PERIOD_S = 0.05
"""No page is answered more often than this."""

_MAX_ANSWERS = 4  # beyond these a page's requests are not read until it takes the answers
_NOT_TEXT, _NO_REQUEST, _TOO_LONG = 1003, 1008, 1009


def create_app(
    state: ViewState,
    playback: Playback | None = None,
    token: str = "",
    on_failure: Callable[[Exception], None] | None = None,
    editing: Editing | None = None,
) -> Starlette:
    """Return the application that shows a state.

    Parameters
    ----------
    state : what is shown; accessed in the application's event loop only.
    playback : playback that pages may pause, or None.
    token : secret that pages must send; "" admits all programs on this machine.
    on_failure : called with what should not have happened; it ends the connection with that page.
    editing : carries out edits; None refuses them.
    """
    static = static_files()
    pictures = Pictures(state)

    async def file(request: HttpRequest) -> Response:
        content = static.get(request.path_params.get("name") or "index.html")
        if content is None:
            return Response("there is no such page", 404, HEADERS, "text/plain")
        return Response(content[0], 200, HEADERS, content[1])

    async def socket(websocket: WebSocket) -> None:
        if not is_welcome(websocket, token):
            await websocket.close()  # before it was accepted: status 403
            return
        await websocket.accept()
        try:
            await _Session(websocket, state, playback, pictures, editing).run()
        except Exception as failure:
            if on_failure is not None:
                on_failure(failure)
            raise

    return Starlette(
        routes=[
            Route("/", file),
            WebSocketRoute("/socket", socket),
            Route("/{name:path}", file),
        ]
    )


def is_welcome(websocket: WebSocket, token: str) -> bool:
    """Return whether a page may look: it is our own, and it knows the token if there is one.

    Without a token, it must have been called by a name of this machine itself: a foreign site whose
    name was made to lead here is no page of ours.
    """
    host = websocket.headers.get("host", "")
    try:
        origin, name = urlsplit(websocket.headers.get("origin", "")).netloc, urlsplit(f"//{host}")
    except ValueError:  # brackets that hold no address
        return False
    if origin != host or not host:
        return False
    if token:
        given = websocket.query_params.get("token", "")
        return hmac.compare_digest(given.encode(), token.encode())
    return is_loopback(name.hostname or "")


class _Session:
    """One connection with one page."""

    def __init__(
        self,
        websocket: WebSocket,
        state: ViewState,
        playback: Playback | None,
        pictures: Pictures,
        editing: Editing | None,
    ) -> None:
        self._websocket = websocket
        self._state = state
        self._playback = playback
        self._pictures = pictures
        self._editing = editing
        self._answers: asyncio.Queue[bytes] = asyncio.Queue(_MAX_ANSWERS)

    async def run(self) -> None:
        """Inform the page and answer it until one of the two has had enough."""
        subscription = self._state.subscribe()
        sending = asyncio.create_task(self._send(subscription))
        receiving = asyncio.create_task(self._receive(subscription))
        try:
            done, _ = await asyncio.wait((sending, receiving), return_when=asyncio.FIRST_COMPLETED)
        finally:
            self._state.unsubscribe(subscription)
            for task in (sending, receiving):
                task.cancel()
            await asyncio.gather(sending, receiving, return_exceptions=True)
        with suppress(WebSocketDisconnect):
            for task in done:
                if (close := task.result()) is not None:
                    with suppress(RuntimeError):  # it has just been closed
                        await self._websocket.close(*close)

    async def _send(self, subscription: Subscription) -> None:
        """Send answers and what has changed; each send waits until the page takes it."""
        while True:
            await subscription.changed.wait()
            while not self._answers.empty():
                await self._send_bytes(self._answers.get_nowait())
            if bundle := subscription.bundle(self._state.parts):
                await self._send_bytes(bundle)

    async def _send_bytes(self, data: bytes) -> None:
        try:
            await self._websocket.send_bytes(data)
        except (
            RuntimeError
        ) as error:  # the layer below has reported the broken protocol to the peer
            raise WebSocketDisconnect(1006) from error

    async def _receive(self, subscription: Subscription) -> tuple[int, str] | None:
        """Answer requests; return code and reason where the connection must end for one."""
        while True:
            received = await self._websocket.receive()
            if received["type"] == "websocket.disconnect":
                return None
            text = received.get("text")
            if text is None:
                return _NOT_TEXT, "requests are text"
            if len(text) > requests.MAX_REQUEST_BYTES:
                return _TOO_LONG, "requests are short"
            try:
                answer = await self._answer(parse_request(text))
            except BadRequestError as error:
                return _NO_REQUEST, str(error)[:100]
            if answer:
                await self._answers.put(answer)
                subscription.changed.set()
            await asyncio.sleep(REQUEST_PERIOD_S)

    async def _answer(self, request: requests.Request) -> bytes:
        """Carry out a request; return the answer, b"" if the answer is the change of state."""
        match request:
            case requests.Ping():
                return protocol.json_message(MessageType.PONG, {"id": request.id})
            case requests.Play() | requests.Pause() | requests.Speed():
                self._steer(request)
                return b""
            case _:
                try:
                    return await self._look_up(request)
                except (LookupError, CartoloopError) as error:
                    problem = {"id": request.id, "text": str(error)}
                    return protocol.json_message(MessageType.PROBLEM, problem)

    def _steer(self, request: requests.Play | requests.Pause | requests.Speed) -> None:
        if self._playback is None:
            return
        match request:
            case requests.Play():
                self._playback.play()
            case requests.Pause():
                self._playback.pause()
            case requests.Speed():
                self._playback.set_speed(request.value)
        self._state.refresh()

    async def _change(self, request: requests.EditRequest | requests.SetPose) -> bytes:
        """Carry out what changes the map, or says where the robot is."""
        if isinstance(request, requests.SetPose):
            given = {"id": request.id, "number": self._state.give_pose(Pose(*request.pose))}
            return protocol.json_message(MessageType.GIVEN, given)
        if self._editing is None:
            raise UsageError(NOT_ALLOWED)
        edited = {"id": request.id, "text": await self._editing.carry_out(request)}
        return protocol.json_message(MessageType.EDITED, edited)

    async def _look_up(
        self, request: requests.Query | requests.EditRequest | requests.SetPose
    ) -> bytes:
        match request:
            case (
                requests.DropClosure()
                | requests.UndoEdit()
                | requests.RedoEdit()
                | requests.SetPose()
            ):
                return await self._change(request)
            case requests.ClosureDetails():
                content = self._state.closure(request.constraint) | {"id": request.id}
                if self._editing is not None:
                    edit = self._editing.edit_of(content["submap"], content["node"])
                    content["edit"] = edit
                return protocol.json_message(MessageType.CLOSURE, content)
            case requests.AllClosures():
                content = self._state.closures() | {"id": request.id}
                return protocol.json_message(MessageType.CLOSURES, content)
            case requests.Before():
                return protocol.answer_message(request.id, self._state.before())
            case requests.NodeScan():
                return protocol.answer_message(request.id, self._state.node_scan(request.node))
            case requests.Picture():
                picture = protocol.message(MessageType.PICTURE, await self._pictures.latest())
                return protocol.answer_message(request.id, picture)
