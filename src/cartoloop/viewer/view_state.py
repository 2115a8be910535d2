# SPDX-License-Identifier: Apache-2.0
"""What pages are shown, whatever it is: parts that change, and the pages that look.

Only the viewer's thread accesses it.
"""

from __future__ import annotations

import secrets
from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import Any

from cartoloop.errors import UsageError
from cartoloop.map_output.colours import DARK, LIGHT
from cartoloop.map_output.occupancy_map import MAX_LOG_ODDS
from cartoloop.map_output.picture import palette
from cartoloop.sensor.pose import Pose
from cartoloop.version import __version__
from cartoloop.viewer import protocol
from cartoloop.viewer.parts import Latest, Part
from cartoloop.viewer.pictures import Drawing
from cartoloop.viewer.playback import Playback
from cartoloop.viewer.protocol import MessageType
from cartoloop.viewer.subscriptions import Key, Subscription, Subscriptions, key_of

_NO_LOCALISATION = "this view shows no localisation: start it with 'cartoloop locate --view'"


class ViewState(ABC):
    """Parts that pages are kept informed of, and answers to what they ask.

    Parameters
    ----------
    hello : content of HELLO but for the mode, see `hello_content`.
    mode : what is shown.
    kinds : the parts that are one message each, of which only the latest counts.

    Attributes
    ----------
    mode : what pages that join now are shown.
    parts : what pages are sent, by key.
    subscriptions : the pages that are connected.
    """

    def __init__(self, hello: dict[str, Any], mode: str, kinds: Iterable[MessageType]) -> None:
        self.subscriptions = Subscriptions()
        self._hello = hello
        self._latest = {kind: Latest() for kind in (MessageType.HELLO, *kinds)}
        self.parts: dict[Key, Part] = {key_of(kind): part for kind, part in self._latest.items()}
        self._set_mode(mode)

    @abstractmethod
    def refresh(self) -> None:
        """Bring readings and playback up to date."""

    def draw_growing(self) -> None:  # noqa: B027 - most have nothing that grows
        """Bring up to date what is drawn less often than all else."""

    def subscribe(self) -> Subscription:
        """Return the subscription of a page that joins now."""
        return self.subscriptions.add(self.parts)

    def unsubscribe(self, subscription: Subscription) -> None:
        """Forget a page that has left."""
        self.subscriptions.remove(subscription)

    # What pages ask for; each raises a LookupError or a CartoloopError where there is no such thing

    def closures(self) -> dict[str, Any]:
        """Return what the record holds of all loop closures."""
        raise LookupError("this view shows no loop closures")

    def closure(self, constraint: int) -> dict[str, Any]:
        """Return the details of a loop closure."""
        raise LookupError(f"this view shows no loop closures: there is no constraint {constraint}")

    def before(self) -> bytes:
        """Return the message of the poses before loop closure."""
        raise LookupError("this view shows no poses before loop closure")

    def node_scan(self, node: int) -> bytes:
        """Return the message of a node's points."""
        raise LookupError(f"there is no node {node}")

    def give_pose(self, tf_map_tracking: Pose) -> int:
        """Have a pose of the robot tried that a user gives; return the number of the request."""
        raise UsageError(_NO_LOCALISATION)

    # What pictures are made of, see `pictures.Drawable`

    @property
    def version(self) -> object:
        """An object that is replaced when the map changes."""
        return self

    @property
    def is_over(self) -> bool:
        """Whether nothing changes any more."""
        return True

    def drawing(self) -> Drawing:
        """Return what a picture of the map is made of."""
        raise LookupError("this view draws no picture of the map")

    def _show(self, kind: MessageType, message: bytes) -> None:
        """Replace the message of a part that is only one message."""
        if self._latest[kind].set(message):
            self.subscriptions.note(kind)

    def _show_json(self, kind: MessageType, content: dict[str, Any]) -> None:
        self._show(kind, protocol.json_message(kind, content))

    def _show_playback(
        self, playback: Playback | None, *, is_running: bool, can_scrub: bool
    ) -> None:
        """Show the pace; pages may change it while a recording is being read."""
        playing = playback is not None and is_running
        content = {
            "paused": playback is not None and playback.paused and playing,
            "speed": playback.speed if playback is not None else None,
            "can_pause": playing,
            "can_set_speed": playing,
            "can_scrub": can_scrub,
        }
        self._show_json(MessageType.PLAYBACK, content)

    def _set_mode(self, mode: str) -> None:
        """Set what pages that join from now on are shown."""
        self.mode = mode
        message = protocol.json_message(MessageType.HELLO, self._hello | {"mode": mode})
        self._latest[MessageType.HELLO].set(message)  # pages that have joined keep theirs


def hello_content(name: str, resolution: float, log_odds: list[float]) -> dict[str, Any]:
    """Return the content of HELLO but for the mode.

    Parameters
    ----------
    name : of the recording, the source or the map.
    resolution : edge of a cell of the map [m].
    log_odds : evidence of each value of a cell.
    """
    return {
        "protocol": protocol.PROTOCOL_VERSION,
        "program": f"cartoloop {__version__}",
        "session": secrets.token_hex(8),
        "name": name,
        "mode": "",
        "frame": "map",
        "resolution": resolution,
        "log_odds": log_odds,
        "max_log_odds": MAX_LOG_ODDS,
        "palette": palette().tolist(),
        "colours": {"light": LIGHT._asdict(), "dark": DARK._asdict()},
    }
