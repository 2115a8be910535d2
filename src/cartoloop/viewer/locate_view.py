# SPDX-License-Identifier: Apache-2.0
"""The view of a localisation: the map, where the robot may be, and poses that are given by hand."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import partial

from cartoloop.localisation.answer import Answer
from cartoloop.localisation.localizer import Localizer
from cartoloop.sensor.events import SensorEvent
from cartoloop.viewer.locate_feed import LocateFeed
from cartoloop.viewer.locate_readings import LocateReadings
from cartoloop.viewer.locate_state import LocateState
from cartoloop.viewer.playback import Playback
from cartoloop.viewer.server import ViewServer
from cartoloop.viewer.site import DEFAULT_HOST, DEFAULT_PORT


class LocateView:
    """Serves the view of a localisation while it runs, and after.

    The thread that localises calls `paced` and `after_answer`; neither waits for any page, except
    where the operator wants the recording slower.

    Parameters
    ----------
    localizer : whose answers are shown, and which pages may give poses.
    name : of the recording or the source.
    scans_total, duration_s : of the recording; None for a live source.
    speed : pace of the recording, 1 being real time; None as fast as possible.
    host, port : where it is served.
    live : whether the scans come from a scanner that does not wait.

    Attributes
    ----------
    feed : brings answers to the view, and given poses to the localiser.

    Raises
    ------
    ServeError
        It cannot be served there.
    """

    def __init__(
        self,
        localizer: Localizer,
        name: str,
        *,
        scans_total: int | None = None,
        duration_s: float | None = None,
        speed: float | None = None,
        host: str = DEFAULT_HOST,
        port: int = DEFAULT_PORT,
        live: bool = False,
    ) -> None:
        self._playback = None if live else Playback(speed)
        self.feed = LocateFeed(localizer)
        self._state = LocateState(
            name,
            localizer.known_map,
            LocateReadings(scans_total, duration_s, live=live),
            self.feed.ask,
            self._playback,
        )
        self._server = ViewServer(self._state, self._next_update, self._playback, host, port)

    @property
    def url(self) -> str:
        """What a browser must open."""
        return self._server.url

    @property
    def failure(self) -> Exception | None:
        """The failure that ended the view, or None; localisation continues without it."""
        return self._server.failure

    def paced(
        self, events: Iterable[SensorEvent], is_stopped: Callable[[], bool]
    ) -> Iterator[SensorEvent]:
        """Yield the events of a recording when it is time for them, at once unless slowed."""
        for event in events:
            if self._playback is not None:
                self._playback.wait_for(event.time, is_stopped, self.feed.offer)
            yield event

    def after_answer(self, answer: Answer) -> None:
        """Show an answer, and give the localiser a pose that a page has sent, for the next scan."""
        self.feed.after_answer(answer)

    def idle(self) -> None:
        """Show what came too quickly before; to be called while no scan arrives."""
        self.feed.offer()

    def finished(self) -> None:
        """Show that no more scans come."""

        def show() -> None:
            for update in (self.feed.take(), self.feed.update()):
                if update is not None:
                    self._state.apply(update)
            self._state.end()

        self._server.call_and_wait(show)

    def close(self) -> None:
        """Close all connections."""
        self._server.close()

    def _next_update(self) -> Callable[[], None] | None:
        update = self.feed.take()
        return None if update is None else partial(self._state.apply, update)
