# SPDX-License-Identifier: Apache-2.0
"""The state of the view of a localisation: the map, the answers, states and path so far.

Only the viewer's thread accesses it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from cartoloop.errors import UsageError
from cartoloop.localisation.answer import Answer
from cartoloop.localisation.known_map import KnownMap
from cartoloop.localisation.lines import answer_content
from cartoloop.localisation.start_pose import START_WINDOW_M
from cartoloop.sensor.pose import Pose
from cartoloop.viewer import protocol
from cartoloop.viewer.locate_feed import AskedPose, LocateUpdate
from cartoloop.viewer.locate_history import position_sigma
from cartoloop.viewer.locate_readings import LocateReadings
from cartoloop.viewer.map_blocks import blocks_of, is_on_map, known_log_odds
from cartoloop.viewer.parts import Table
from cartoloop.viewer.playback import Playback
from cartoloop.viewer.protocol import MessageType
from cartoloop.viewer.subscriptions import key_of
from cartoloop.viewer.view_state import ViewState, hello_content

_NO_POINTS = np.zeros((0, 2))
_SHOWN = ("stamp", "state", "map", "score", "runner_up", "agreement", "places")
_KINDS = (
    MessageType.PLAYBACK,
    MessageType.READINGS,
    MessageType.STATES,
    MessageType.LOCALISATION,
    MessageType.SCAN,
)


class LocateState(ViewState):
    """What pages are shown of a localisation.

    Parameters
    ----------
    name : of the recording or the source.
    known : the map.
    readings : figures beside the map.
    ask : has a pose tried that a page gives.
    playback : pace of the recording; None without one.
    """

    def __init__(
        self,
        name: str,
        known: KnownMap,
        readings: LocateReadings,
        ask: Callable[[AskedPose], None],
        playback: Playback | None = None,
    ) -> None:
        log_odds = known_log_odds()
        hello = hello_content(name, known.grid.resolution, log_odds.tolist())
        super().__init__(hello, "locating", _KINDS)
        self.readings = readings
        self._known, self._ask, self._playback = known, ask, playback
        self._last: LocateUpdate | None = None
        self._asked: AskedPose | None = None
        self._poses = Table(MessageType.SUBMAP_POSES, np.zeros((0, 3)), sent_whole=True)
        self._path = Table(MessageType.PATH, np.zeros((0, 3)))
        self.parts |= {
            key_of(MessageType.SUBMAP_POSES): self._poses,
            key_of(MessageType.PATH): self._path,
        }
        blocks = list(blocks_of(known, log_odds))
        for number, block in enumerate(blocks):
            self.parts[key_of(MessageType.SUBMAP_PREVIEW, number)] = block.preview
            self.parts[key_of(MessageType.SUBMAP, number)] = block.cells
        self._poses.set(0, np.tile(np.array(known.tf_map_grid), (len(blocks), 1)))
        self._show_localisation()
        self.refresh()

    def apply(self, update: LocateUpdate) -> None:
        """Take in what has changed."""
        self._last = update
        self.readings.add(update)
        if self._path.set(update.first_point, update.path, adjusted=update.thinned):
            self.subscriptions.note(MessageType.PATH)
        runs = [[stamp, state.value] for stamp, state in update.states]
        self._show_json(MessageType.STATES, {"runs": runs})
        self._show_localisation()
        shown_at = _shown_at(update.answer)
        scan = protocol.scan_message(
            update.num_scans,
            update.answer.stamp,
            shown_at or Pose(0.0, 0.0, 0.0),
            _NO_POINTS if shown_at is None else update.returns,
        )
        self._show(MessageType.SCAN, scan)

    def refresh(self) -> None:
        """Bring readings and playback up to date."""
        is_running = not self.readings.is_over
        paused = is_running and self._playback is not None and self._playback.paused
        self._show_json(MessageType.READINGS, self.readings.content(paused=paused))
        self._show_playback(self._playback, is_running=is_running, can_scrub=False)

    def end(self) -> None:
        """Show that no more scans come."""
        self.readings.end()
        self._show_localisation()
        self.refresh()

    def give_pose(self, tf_map_tracking: Pose) -> int:
        """Have a pose tried at the next scan; return the number of the request.

        Raises
        ------
        UsageError
            It lies outside of the map, or no more scans come.
        """
        if self.readings.is_over:
            raise UsageError("no more scans come: a pose cannot be tried")
        if not is_on_map(self._known, tf_map_tracking, START_WINDOW_M):
            x, y, _ = tf_map_tracking
            raise UsageError(f"x {x:.6g} m, y {y:.6g} m is outside of the map")
        number = 1 if self._asked is None else self._asked.number + 1
        self._asked = AskedPose(number, tf_map_tracking)
        self._ask(self._asked)
        self._show_localisation()
        return number

    def _show_localisation(self) -> None:
        last, usual = self._last, self._known.usual
        content: dict[str, Any] = {
            "stamp": None,
            "state": None,
            "map": None,
            "sigma_m": None,
            "sigma_rad": None,
            "score": None,
            "runner_up": None,
            "agreement": None,
            "places": [],
        }
        if last is not None:
            content |= _answer_content(last.answer)
        content |= {
            "usual_score": _number(usual.score),
            "usual_agreement": _number(usual.agreement),
            "can_give": not self.readings.is_over,
            "given": self._given_content(),
        }
        self._show_json(MessageType.LOCALISATION, content)

    def _given_content(self) -> dict[str, Any] | None:
        asked, tried = self._asked, self._last.tried if self._last else None
        if asked is None:
            return None
        is_tried = tried is not None and tried.number == asked.number
        return {
            "number": asked.number,
            "map": _rounded(asked.tf_map_tracking),
            "fits": tried.fits if is_tried and tried is not None else None,
        }


def _shown_at(answer: Answer) -> Pose | None:
    """Return where a scan is drawn: at the robot's pose, or where it is the likeliest."""
    if answer.tf_map_tracking is not None:
        return answer.tf_map_tracking
    return answer.places[0].tf_map_tracking if answer.places else None


def _answer_content(answer: Answer) -> dict[str, Any]:
    """Return what pages show of an answer, as lines of poses have it."""
    content, sigma = answer_content(answer), position_sigma(answer)
    shown = {key: content[key] for key in _SHOWN}
    if sigma is not None and answer.covariance is not None:
        shown |= {
            "sigma_m": _number(sigma),
            "sigma_rad": _number(math.sqrt(float(answer.covariance[2, 2]))),
        }
    return shown


def _rounded(pose: Pose) -> list[float]:
    return [round(value, 4) for value in pose]


def _number(value: float) -> float | None:
    return round(value, 5) if math.isfinite(value) else None
