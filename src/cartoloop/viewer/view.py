# SPDX-License-Identifier: Apache-2.0
"""A view of a map: of one that is being made, or of a finished one."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from cartoloop.map_output.map_facts import map_facts, saved_facts
from cartoloop.viewer.editing import Editing, edits_content
from cartoloop.viewer.feed import Feed, whole
from cartoloop.viewer.live_state import LiveState
from cartoloop.viewer.opening import Opening
from cartoloop.viewer.playback import Playback
from cartoloop.viewer.readings import PARTLY_MAPPED, STOPPED, Readings
from cartoloop.viewer.server import ViewServer
from cartoloop.viewer.site import DEFAULT_HOST, DEFAULT_PORT

if TYPE_CHECKING:
    from cartoloop.config import Config
    from cartoloop.map_editing.editor import Editor
    from cartoloop.mapper import Mapper
    from cartoloop.result import Result
    from cartoloop.sensor.events import SensorEvent


class LiveView:
    """Serves the view of a map while it is being made, and after.

    The mapping thread calls `before_event` and `after_event`; neither waits for any page, except
    where the operator wants the recording slower.

    Parameters
    ----------
    name : of the recording or the source.
    config : that of the mapper.
    scans_total, duration_s : of the recording; None for a live source.
    speed : pace of the recording, 1 being real time; None as fast as possible.
    host, port : where it is served.
    live : whether the scans come from a scanner that does not wait.

    Raises
    ------
    ServeError
        It cannot be served there.
    """

    def __init__(
        self,
        name: str,
        config: Config,
        *,
        scans_total: int | None = None,
        duration_s: float | None = None,
        speed: float | None = None,
        host: str = DEFAULT_HOST,
        port: int = DEFAULT_PORT,
        live: bool = False,
    ) -> None:
        self._playback = None if live else Playback(speed)
        self._readings = Readings(scans_total, duration_s, live=live)
        self._state = LiveState(
            name,
            "live" if live else "recording",
            config.local_slam.submaps,
            self._readings,
            self._playback,
        )
        self._feed = Feed()
        self._server = ViewServer(self._state, self._next_update, self._playback, host, port)

    @property
    def url(self) -> str:
        """What a browser must open."""
        return self._server.url

    @property
    def failure(self) -> Exception | None:
        """The failure that ended the view, or None; mapping continues without it."""
        return self._server.failure

    @property
    def paused_s(self) -> float:
        """Time that mapping was paused by the operator [s]."""
        return self._playback.paused_s if self._playback is not None else 0.0

    def before_event(
        self, mapper: Mapper, event: SensorEvent, is_stopped: Callable[[], bool]
    ) -> None:
        """Return when it is time for an event, which is at once unless it is to be slowed."""
        if self._playback is not None:
            self._playback.wait_for(event.time, is_stopped, lambda: self.after_event(mapper))

    def after_event(self, mapper: Mapper) -> None:
        """Notify the view that the map may have changed; also called while no event arrives.

        It takes in one change at a time: what came too quickly is seen with the next call.
        """
        self._feed.after_event(mapper)

    def finishing(
        self, stage: str = "closing the last loops", mapper: Mapper | None = None
    ) -> None:
        """Show the stage of finishing, and the present map if there is a mapper."""
        has_map = mapper is not None and mapper.last_scan is not None
        update = self._feed.update(mapper) if mapper is not None and has_map else None

        def show() -> None:
            self._readings.end("finishing", stage)
            for news in (self._feed.take(), update):
                if news is not None:
                    self._state.apply(news)
            self._state.refresh()

        self._server.call(show)

    def finished(self, result: Result, failure: Exception | None = None) -> None:
        """Show the finished map, or what was mapped until a stop or a failure."""
        facts = map_facts(result)

        def show() -> None:
            self._feed.take()
            self._readings.real_time_factor = result.report.real_time_factor
            if failure is not None:
                self._readings.end("failed", str(failure))
            else:
                _end(self._readings, result)
            self._state.apply(whole(result))
            self._state.show_facts(facts)
            self._state.refresh()

        self._server.call_and_wait(show)

    def _next_update(self) -> Callable[[], None] | None:
        update = self._feed.take()
        return None if update is None else partial(self._state.apply, update)

    def close(self) -> None:
        """Close all connections."""
        self._server.close()


def serve_result(
    result: Result,
    name: str,
    host: str = DEFAULT_HOST,
    port: int = DEFAULT_PORT,
    *,
    editor: Editor[Result] | None = None,
    opening: Opening | None = None,
) -> ViewServer:
    """Serve the view of a finished map and return the running server.

    Parameters
    ----------
    result : the map.
    name : under which it is shown.
    host, port : where it is served.
    editor : of the map, if pages may edit it.
    opening : what was served there until now; the view takes its place.

    Raises
    ------
    ServeError
        It cannot be served there.
    """
    readings = Readings(result.report.input.scans, result.report.input.duration_s)
    state = LiveState(name, "finished", result.config.local_slam.submaps, readings)
    readings.real_time_factor = result.report.real_time_factor or None
    _end(readings, result)
    state.apply(whole(result))
    state.show_facts(saved_facts(result) or map_facts(result))
    editing = None
    if editor is not None:
        editing = Editing(editor, state)
        state.show_edits(edits_content(editor, can_edit=True))
    state.refresh()
    return ViewServer(state, host=host, port=port, editing=editing, opening=opening)


def _end(readings: Readings, result: Result) -> None:
    if result.report.finished:
        readings.end("finished")
    else:
        was_examined = result.quality.verdict != "unknown"  # which comes after the last pass
        readings.end("stopped", PARTLY_MAPPED if was_examined else STOPPED)
