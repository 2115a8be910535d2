# SPDX-License-Identifier: Apache-2.0
"""The state that pages are kept informed of, and what each of them has seen of it.

Lives in the viewer's thread alone. There is no queue: the state notes for each page which parts
have changed since that page was told, and makes the messages when the page can take them.
"""

from __future__ import annotations

import secrets
from asyncio import Event
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np

import cartoloop
from cartoloop.config import SubmapConfig
from cartoloop.global_slam.pose_graph import ConstraintKind
from cartoloop.map_output.occupancy_map import MAX_LOG_ODDS, cell_log_odds
from cartoloop.map_output.picture import palette
from cartoloop.viewer import protocol
from cartoloop.viewer.closure_details import closure_details
from cartoloop.viewer.feed import Update
from cartoloop.viewer.parts import (
    Constraints,
    Latest,
    NodePoses,
    NodeTimes,
    Part,
    SubmapPoses,
    Token,
    constraint_rows,
)
from cartoloop.viewer.pictures import Drawing
from cartoloop.viewer.previews import Preview
from cartoloop.viewer.protocol import MessageType, Texture
from cartoloop.viewer.readings import Readings
from cartoloop.viewer.textures import FinishedTexture, GrowingTexture

if TYPE_CHECKING:
    from cartoloop.submaps.finished_grid import FinishedGrid
    from cartoloop.viewer.playback import Playback

Mode = Literal["recording", "live", "finished"]

Key = tuple[int, int]
"""Names a part: its turn when a page joins, and the number of a submap."""

_Made = TypeVar("_Made")

BUNDLE_BYTES = 256 * 1024
"""About so much is sent at a time; between two, the state may change."""

_TEXTURE_THREADS = 4

_TURNS = (
    MessageType.HELLO, MessageType.PLAYBACK, MessageType.READINGS, MessageType.SUBMAP_POSES,
    MessageType.NODES, MessageType.NODE_TIMES, MessageType.SUBMAP_PREVIEW,
    MessageType.SUBMAP, MessageType.CONSTRAINTS, MessageType.LATEST_CLOSURE, MessageType.SCAN,
)  # fmt: skip


def key_of(kind: MessageType, submap: int = 0) -> Key:
    """Return the name of a part."""
    return _TURNS.index(kind), submap


class Subscription:
    """What one page has seen, and which parts have changed since.

    Attributes
    ----------
    changed : set whenever there is something to send.
    """

    def __init__(self, keys: Iterable[Key]) -> None:
        self.changed = Event()
        self.changed.set()
        self._dirty = set(keys)
        self._seen: dict[Key, Token] = {}
        self._is_complete = False

    def note(self, key: Key) -> None:
        """Note that a part has changed."""
        self._dirty.add(key)
        self.changed.set()

    def bundle(self, parts: dict[Key, Part]) -> bytes:
        """Return the next messages for this page, b"" where it has all."""
        messages: list[bytes] = []
        size = 0
        for key in sorted(self._dirty):
            self._dirty.discard(key)
            message, self._seen[key] = parts[key].news(self._seen.get(key))
            if message:
                messages.append(message)
                size += len(message)
            if size >= BUNDLE_BYTES:
                return b"".join(messages)
        if not self._is_complete:
            self._is_complete = True
            messages.append(protocol.json_message(MessageType.COMPLETE, {}))
        self.changed.clear()
        return b"".join(messages)


class LiveState:
    """The state of a map that grows, or has grown.

    Parameters
    ----------
    name : of the recording or of the map.
    mode : what is shown.
    config : of the submaps.
    readings : figures beside the map.
    playback : pace of the recording; None where there is nothing to be played.

    Attributes
    ----------
    is_watched : set as long as any page looks.
    """

    def __init__(
        self,
        name: str,
        mode: Mode,
        config: SubmapConfig,
        readings: Readings,
        playback: Playback | None = None,
    ) -> None:
        self.readings = readings
        self.last: Update | None = None
        self._playback = playback
        self._log_odds = cell_log_odds(config)
        self._poses, self._nodes, self._times = SubmapPoses(), NodePoses(), NodeTimes()
        self._constraints = Constraints()
        self._scan, self._readings = Latest(), Latest()
        self._playback_part, self._closure = Latest(), Latest()
        self._config = config
        self._growing: dict[int, GrowingTexture] = {}
        self._finished: dict[int, FinishedGrid] = {}
        self._num_found = 0
        self._closure_rows = np.zeros(0, dtype=np.int32)
        self._hello, self._hello_content = Latest(), self._greeting(name, config)
        self._set_mode(mode)
        self.parts: dict[Key, Part] = {
            key_of(MessageType.HELLO): self._hello,
            key_of(MessageType.PLAYBACK): self._playback_part,
            key_of(MessageType.READINGS): self._readings,
            key_of(MessageType.SUBMAP_POSES): self._poses,
            key_of(MessageType.NODES): self._nodes,
            key_of(MessageType.NODE_TIMES): self._times,
            key_of(MessageType.CONSTRAINTS): self._constraints,
            key_of(MessageType.LATEST_CLOSURE): self._closure,
            key_of(MessageType.SCAN): self._scan,
        }
        self._subscriptions: set[Subscription] = set()
        self.is_watched = Event()
        self.refresh()

    def subscribe(self) -> Subscription:
        """Return what a page that joins now is to be sent: all."""
        subscription = Subscription(self.parts)
        self._subscriptions.add(subscription)
        self.is_watched.set()
        return subscription

    def unsubscribe(self, subscription: Subscription) -> None:
        """Forget a page that has left."""
        self._subscriptions.discard(subscription)
        if not self._subscriptions:
            self.is_watched.clear()

    def apply(self, update: Update) -> None:
        """Take in what has changed, all but the submaps that still grow."""
        self.last = update
        self.readings.add(update)
        if self._poses.set(update.submap_poses, adjusted=update.adjusted):
            self._note(MessageType.SUBMAP_POSES)
        if self._nodes.set(update.first_node, update.node_poses, adjusted=update.adjusted):
            self._note(MessageType.NODES)
        first_time = len(self._nodes) - len(update.node_stamps)
        if self._times.set(first_time, update.node_stamps):
            self._note(MessageType.NODE_TIMES)
        rows = [constraint_rows(update.constraints)]
        closure_rows = [update.constraints.closure_rows]
        if update.rejected is not None:
            rows.append(constraint_rows(update.rejected))
            closure_rows.append(update.rejected.closure_rows)
        self._closure_rows = np.concatenate(
            (self._closure_rows[: update.first_constraint], *closure_rows)
        )
        revision = self._constraints.revision
        if self._constraints.set(update.first_constraint, rows):
            self._note(MessageType.CONSTRAINTS)
        self._apply_finished(update)
        scan = protocol.scan_message(update.num_scans, update.stamp, update.pose, update.returns)
        if update.num_scans and self._scan.set(scan):
            self._note(MessageType.SCAN)
        if update.num_found != self._num_found or self._constraints.revision != revision:
            self._num_found = update.num_found
            self._show_latest_closure()

    def refresh(self) -> None:
        """Bring readings and playback up to date."""
        if self.readings.phase == "finished" and self.mode != "finished":
            self._set_mode("finished")
        paused = self._playback is not None and self._playback.paused
        counts = {
            "nodes": len(self._nodes),
            "submaps": len(self._poses),
            "constraints": len(self._constraints),
            "loop_closures": self._num_loop_closures(),
        }
        content = self.readings.content(counts, paused=paused)
        if self._readings.set(protocol.json_message(MessageType.READINGS, content)):
            self._note(MessageType.READINGS)
        playing = self._playback is not None and self.readings.phase in ("starting", "mapping")
        content = {
            "paused": paused and playing,
            "speed": self._playback.speed if self._playback is not None else None,
            "can_pause": playing,
            "can_set_speed": playing,
            "can_scrub": self.readings.phase == "finished",
        }
        if self._playback_part.set(protocol.json_message(MessageType.PLAYBACK, content)):
            self._note(MessageType.PLAYBACK)

    def closure(self, constraint: int) -> dict[str, Any]:
        """Return the details of a loop closure.

        Raises
        ------
        LookupError
            There is no such closure.
        """
        points = self.last.node_points if self.last is not None else ()
        window = self._window_of(constraint)
        return closure_details(
            constraint, self._constraints.rows, self._poses.poses, self._nodes.poses, points, window
        )

    def node_scan(self, node: int) -> bytes:
        """Return the message of a node's points.

        Raises
        ------
        LookupError
            There is no such node.
        """
        points = self.last.node_points if self.last is not None else ()
        if node >= min(len(self._nodes), len(self._times), len(points)):
            raise LookupError(f"there is no node {node}")
        pose = self._nodes.poses[node]
        return protocol.scan_message(
            node,
            float(self._times.stamps[node]),
            (float(pose[0]), float(pose[1]), float(pose[2])),
            points[node],
            MessageType.NODE_SCAN,
        )

    def drawing(self) -> Drawing:
        """Return what a picture of the map as it stands is made of."""
        grids = {submap: texture.grid() for submap, texture in self._growing.items()}
        grids |= self._finished
        known = [submap for submap in sorted(grids) if submap < len(self._poses)]
        return Drawing(
            [grids[submap] for submap in known],
            self._poses.poses[known],
            self._nodes.poses,
            self._config,
        )

    def _note(self, kind: MessageType, submap: int = 0) -> None:
        key = key_of(kind, submap)
        for subscription in self._subscriptions:
            subscription.note(key)

    def draw_growing(self) -> None:
        """Bring the submaps that still grow up to date, which costs more than all else."""
        for grid in self.last.active if self.last is not None else ():
            if grid.submap in self._finished:
                continue
            if grid.submap not in self._growing:
                self._growing[grid.submap] = GrowingTexture(grid.submap)
                self.parts[key_of(MessageType.SUBMAP, grid.submap)] = self._growing[grid.submap]
            if self._growing[grid.submap].set(grid):
                self._note(MessageType.SUBMAP, grid.submap)

    def _apply_finished(self, update: Update) -> None:
        new = {
            submap: grid for submap, grid in update.finished.items() if submap not in self._finished
        }

        def parts(submap: int) -> tuple[Preview, FinishedTexture]:
            growing = self._growing.get(submap)
            version = growing.version + 1 if growing else 1
            packed = new[submap]
            grid = Texture(packed.cells, packed.origin_x, packed.origin_y, packed.resolution)
            return Preview(submap, grid, self._log_odds), FinishedTexture(submap, version, grid)

        for submap, (preview, finished) in zip(new, _map_all(parts, list(new)), strict=True):
            self.parts[key_of(MessageType.SUBMAP_PREVIEW, submap)] = preview
            self.parts[key_of(MessageType.SUBMAP, submap)] = finished
            self._growing.pop(submap, None)
            self._note(MessageType.SUBMAP_PREVIEW, submap)
            self._note(MessageType.SUBMAP, submap)
        self._finished |= new

    def _num_loop_closures(self) -> int:
        return int(np.count_nonzero(self._constraints.rows.kinds == ConstraintKind.LOOP_CLOSURE))

    def _show_latest_closure(self) -> None:
        kinds = self._constraints.rows.kinds
        closures = np.flatnonzero(kinds == ConstraintKind.LOOP_CLOSURE)
        if len(closures) == 0:
            return
        content = self.closure(int(closures[-1]))
        if self._closure.set(protocol.json_message(MessageType.LATEST_CLOSURE, content)):
            self._note(MessageType.LATEST_CLOSURE)

    def _window_of(self, constraint: int) -> dict[str, Any] | None:
        """Return the search window of a constraint, None where it was not requested."""
        if self.last is None or constraint >= len(self._closure_rows):
            return None
        closures, row = self.last.closures, int(self._closure_rows[constraint])
        if not 0 <= row < closures.num_requested:
            return None
        return {
            "tf_submap_node": closures.predicted[row].tolist(),
            "linear_m": float(closures.linear_window[row]),
            "angular_rad": float(closures.angular_window[row]),
        }

    def _set_mode(self, mode: Mode) -> None:
        """Tell pages that join from now on what they look at."""
        self.mode: Mode = mode
        content = self._hello_content | {"mode": mode}
        self._hello.set(protocol.json_message(MessageType.HELLO, content))

    def _greeting(self, name: str, config: SubmapConfig) -> dict[str, Any]:
        return {
            "protocol": protocol.PROTOCOL_VERSION,
            "program": f"cartoloop {cartoloop.__version__}",
            "session": secrets.token_hex(8),
            "name": name,
            "mode": "",
            "frame": "map",
            "resolution": config.resolution,
            "log_odds": self._log_odds.tolist(),
            "max_log_odds": MAX_LOG_ODDS,
            "palette": palette().tolist(),
        }


def _map_all(make: Callable[[int], _Made], submaps: Sequence[int]) -> Iterable[_Made]:
    """Return what is made of each submap; of many in threads, for to compress them takes long."""
    if len(submaps) <= 2:
        return [make(submap) for submap in submaps]
    with ThreadPoolExecutor(_TEXTURE_THREADS) as threads:
        return list(threads.map(make, submaps))
