# SPDX-License-Identifier: Apache-2.0
"""The state of the view: the map and its figures, as the parts that pages are sent.

Only the viewer's thread accesses it.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from cartoloop.config import SubmapConfig
from cartoloop.global_slam.pose_graph import ConstraintKind
from cartoloop.map_output.evidence_sum import cell_log_odds
from cartoloop.map_output.map_facts import MapFacts
from cartoloop.session import MAIN_PART, Session
from cartoloop.viewer import protocol
from cartoloop.viewer.closure_details import closure_details, closure_list
from cartoloop.viewer.feed import Update
from cartoloop.viewer.parts import ConstraintTable, Table
from cartoloop.viewer.pictures import Drawing
from cartoloop.viewer.protocol import MessageType
from cartoloop.viewer.readings import OVER, Readings
from cartoloop.viewer.submap_parts import SubmapParts
from cartoloop.viewer.subscriptions import key_of
from cartoloop.viewer.view_state import ViewState, hello_content

if TYPE_CHECKING:
    from cartoloop.viewer.playback import Playback

_READS = 3
"""How often something is read of the record of closures while it changes."""

Mode = Literal["recording", "live", "finished"]


class LiveState(ViewState):
    """The state of a map that grows, or has grown.

    Parameters
    ----------
    name : of the recording or of the map.
    mode : what is shown.
    config : of the submaps.
    readings : figures beside the map.
    playback : pace of the recording; None without one.

    Attributes
    ----------
    mode : what is shown now; "finished" once mapping is over.
    last : the latest update, None before the first.
    """

    def __init__(
        self,
        name: str,
        mode: Mode,
        config: SubmapConfig,
        readings: Readings,
        playback: Playback | None = None,
    ) -> None:
        log_odds = cell_log_odds(config)
        super().__init__(hello_content(name, config.resolution, log_odds.tolist()), mode, _LATEST)
        self.readings = readings
        self.last: Update | None = None
        self._name = name
        self._facts: MapFacts | None = None
        self._playback = playback
        self._config = config
        self._submaps = SubmapParts(log_odds)
        self._poses = Table(MessageType.SUBMAP_POSES, np.zeros((0, 3)), sent_whole=True)
        self._nodes = Table(MessageType.NODES, np.zeros((0, 3)))
        self._times = Table(MessageType.NODE_TIMES, np.zeros(0))
        self._constraints = ConstraintTable()
        self.parts |= {
            key_of(MessageType.SUBMAP_POSES): self._poses,
            key_of(MessageType.NODES): self._nodes,
            key_of(MessageType.NODE_TIMES): self._times,
            key_of(MessageType.CONSTRAINTS): self._constraints,
        }
        self._num_found = 0
        self.refresh()

    def apply(self, update: Update) -> None:
        """Take in what has changed, except for the growing submaps."""
        self.last = update
        self.readings.add(update)
        if self._poses.set(0, update.submap_poses, adjusted=update.adjusted):
            self.subscriptions.note(MessageType.SUBMAP_POSES)
        if self._nodes.set(update.first_node, update.node_poses, adjusted=update.adjusted):
            self.subscriptions.note(MessageType.NODES)
        first_time = len(self._nodes) - len(update.node_stamps)
        if self._times.set(first_time, update.node_stamps):
            self.subscriptions.note(MessageType.NODE_TIMES)
        rows = [update.constraints]
        if update.rejected is not None:
            rows.append(update.rejected)
        revision = self._constraints.revision
        if self._constraints.set(update.first_constraint, rows):
            self.subscriptions.note(MessageType.CONSTRAINTS)
        self._apply_finished(update)
        if update.quality is not None:
            self._show_json(MessageType.QUALITY, asdict(update.quality))
        if update.sessions:
            content = [_session_content(session) for session in update.sessions]
            self._show_json(MessageType.SESSIONS, {"sessions": content})
        scan = protocol.scan_message(update.num_scans, update.stamp, update.pose, update.returns)
        if update.num_scans:
            self._show(MessageType.SCAN, scan)
        if update.num_found != self._num_found or self._constraints.revision != revision:
            self._num_found = update.num_found
            self._show_latest_closure()

    def refresh(self) -> None:
        """Bring readings and playback up to date."""
        if self.readings.phase in OVER and self.mode != "finished":
            self._set_mode("finished")
        paused = self._playback is not None and self._playback.paused
        counts = {
            "nodes": len(self._nodes),
            "submaps": len(self._poses),
            "constraints": len(self._constraints),
            "loop_closures": self._num_loop_closures(),
        }
        self._show_json(MessageType.READINGS, self.readings.content(counts, paused=paused))
        phase = self.readings.phase
        self._show_playback(
            self._playback,
            is_running=phase in ("starting", "mapping"),
            can_scrub=phase in OVER,
        )

    def show_facts(self, facts: MapFacts) -> None:
        """Show the facts of the map, which grows no more."""
        self._facts = facts
        self._show_json(MessageType.FACTS, {"described": facts.described()} | asdict(facts))

    def show_edits(self, content: dict[str, Any]) -> None:
        """Show the edits of the map, as the content of an EDITS message."""
        self._show_json(MessageType.EDITS, content)

    def closures(self) -> dict[str, Any]:
        """Return what the record holds of all loop closures.

        Raises
        ------
        LookupError
            There is none yet, or the mapping thread is changing it.
        """
        last = self.last
        if last is None:
            raise LookupError("there is no map yet")
        return _read(lambda: closure_list(self._constraints.rows, last.closures))

    def before(self) -> bytes:
        """Return the message of the poses before loop closure.

        Raises
        ------
        LookupError
            The map still grows.
        """
        if self.last is None or self.last.before is None:
            raise LookupError("the poses before loop closure are known when mapping has ended")
        return protocol.before_message(*self.last.before)

    def closure(self, constraint: int) -> dict[str, Any]:
        """Return the details of a loop closure.

        Raises
        ------
        LookupError
            There is no such closure, or the mapping thread is changing the record.
        """
        last = self.last
        if last is None:
            raise LookupError("there is no map yet")
        return _read(
            lambda: closure_details(
                constraint,
                self._constraints.rows,
                self._poses.values,
                self._nodes.values,
                last.node_points,
                last.closures,
            )
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
        pose = self._nodes.values[node]
        return protocol.scan_message(
            node,
            float(self._times.values[node]),
            (float(pose[0]), float(pose[1]), float(pose[2])),
            points[node],
            MessageType.NODE_SCAN,
        )

    @property
    def version(self) -> object:
        """The latest update: another object when the map has changed."""
        return self.last

    @property
    def is_over(self) -> bool:
        """Whether the map is finished."""
        return self.readings.phase in OVER

    def drawing(self) -> Drawing:
        """Return what a picture of the present map is made of."""
        grids = self._submaps.grids()
        known = [submap for submap in grids if submap < len(self._poses)]
        nodes = self._nodes.values
        parts = self.last.submap_parts if self.last is not None else None
        if parts is not None and self.last is not None:
            known = [submap for submap in known if parts[submap] == MAIN_PART]
            nodes = nodes[self.last.node_parts == MAIN_PART]
        return Drawing(
            [grids[submap] for submap in known],
            self._poses.values[known],
            nodes,
            self._config,
            self._caption(),
        )

    def _caption(self) -> list[str]:
        """Return the name, and the facts once they are known."""
        if self._facts is None:
            return [self._name]
        return replace(self._facts, name=self._name).caption()

    def draw_growing(self) -> None:
        """Bring the growing submaps up to date, which costs more than all else."""
        active = self.last.active if self.last is not None else ()
        for submap, texture in self._submaps.grow(active).items():
            self.parts[key_of(MessageType.SUBMAP, submap)] = texture
            self.subscriptions.note(MessageType.SUBMAP, submap)

    def _apply_finished(self, update: Update) -> None:
        for submap, (preview, texture) in self._submaps.finish(update.finished).items():
            self.parts[key_of(MessageType.SUBMAP_PREVIEW, submap)] = preview
            self.parts[key_of(MessageType.SUBMAP, submap)] = texture
            self.subscriptions.note(MessageType.SUBMAP_PREVIEW, submap)
            self.subscriptions.note(MessageType.SUBMAP, submap)

    def _num_loop_closures(self) -> int:
        return int(np.count_nonzero(self._constraints.rows.kinds == ConstraintKind.LOOP_CLOSURE))

    def _show_latest_closure(self) -> None:
        kinds = self._constraints.rows.kinds
        closures = np.flatnonzero(kinds == ConstraintKind.LOOP_CLOSURE)
        if len(closures) == 0:
            return
        with suppress(LookupError):  # the last pass is changing the record: with the next update
            self._show_json(MessageType.LATEST_CLOSURE, self.closure(int(closures[-1])))


_LATEST = (
    MessageType.PLAYBACK,
    MessageType.READINGS,
    MessageType.QUALITY,
    MessageType.FACTS,
    MessageType.SESSIONS,
    MessageType.EDITS,
    MessageType.LATEST_CLOSURE,
    MessageType.SCAN,
)
"""Parts that are one message each: only the latest counts."""


def _read(details: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Return what is read from the mapper's own record of closures, which grows meanwhile.

    Raises
    ------
    LookupError
        There is no such thing, or columns of different lengths were seen again and again.
    """
    for _ in range(_READS):
        try:
            return details()
        except ValueError:  # NumPy's: one column had grown, another one not yet
            continue
    raise LookupError("the record of closures is changing; try again")


def _session_content(session: Session) -> dict[str, Any]:
    return {
        "name": session.name,
        "first_node": session.first_node,
        "first_submap": session.first_submap,
        "part": session.part,
    }
