# SPDX-License-Identifier: Apache-2.0
"""A robot that is mapped for hours while everything goes wrong, in compressed time.

Hours of its day take minutes, since the stamps run faster than the clock. Meanwhile connections
break or are reset, floods and garbage come, others open connections and say nothing, clocks jump,
and the disk is full for a while. Each scan must be mapped or counted, and the memory must not grow
with time.

With ``drives_again`` the map grows, too: while the robot stands as well, a node every five seconds.
Without, it drives once and then stands, and a scan from where it stands is no new node: then
memory in use that grows is lost, but for the pose of each scan. What the allocators keep to use it
again grows for some hours.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from bench.environment import environment
from bench.record import Figure, Record, Row
from bench.soak.held import Held
from bench.soak.robot import Robot
from bench.soak.senders import Network, Watched
from bench.soak.socket_senders import tcp_network, web_socket_network
from cartoloop.config import Config
from cartoloop.live.live_run import LiveOptions, map_live
from cartoloop.live.message_loop import MessageOptions
from cartoloop.runtime.process_memory import relax_gc, set_malloc_thresholds


def _dds_network() -> Network:
    from bench.soak.dds_sender import DdsNetwork

    return DdsNetwork()


NETWORKS: dict[str, Callable[[], Network]] = {
    "tcp": tcp_network,
    "ws": web_socket_network,
    "dds": _dds_network,
}
"""Kinds of sources."""

_NO_NODES_WHILE_STANDING = {"motion_filter": {"max_time_seconds": 1e9}}


@dataclass
class SoakResult:
    """What came of a day.

    Attributes
    ----------
    faults : number of each kind.
    sent, received, mapped : scans that were sent, that came, and those with a pose.
    lost : scans that were on their way in connections that were reset.
    missing : scans that did not come though their connection was closed properly.
    bad_lines : lines that were sent damaged, or of no known kind.
    skipped : what the report counts, by reason; odometry that comes late is of no line sent.
    settled, end : what the process held after a quarter of the day, and at its end.
    wall_s : time that it took [s].
    """

    faults: Counter[str] = field(default_factory=Counter)
    sent: int = 0
    received: int = 0
    mapped: int = 0
    lost: int = 0
    missing: int = 0
    bad_lines: int = 0
    skipped: dict[str, int] = field(default_factory=dict)
    settled: Held = field(default_factory=Held)
    end: Held = field(default_factory=Held)
    wall_s: float = 0.0

    @property
    def num_late(self) -> int:
        """Number of readings of the odometry that were skipped, as after a jump of the clock."""
        return sum(n for reason, n in self.skipped.items() if reason.startswith("odometry"))

    @property
    def num_skipped(self) -> int:
        """Number of scans and lines that were skipped."""
        return sum(self.skipped.values()) - self.num_late

    @property
    def uncounted(self) -> int:
        """Number of scans and bad lines received that were neither mapped nor counted."""
        return self.received + self.bad_lines - self.mapped - self.num_skipped

    @property
    def unaccounted(self) -> int:
        """Number of scans and bad lines that were neither mapped, counted nor lost."""
        return self.missing + abs(self.uncounted)

    @property
    def bytes_per_scan(self) -> float:
        """Growth of the memory [bytes]."""
        scans = self.end.scans - self.settled.scans
        return 1e6 * (self.end.memory_mb - self.settled.memory_mb) / scans if scans else math.nan

    def row(self, kind: str, hours: float, *, drives_again: bool) -> Row:
        """Return the figures for the record; `kind` is that of the source."""
        settled, end = self.settled, self.end
        return Row(
            {
                "source": kind,
                "hours": hours,
                "drives": "each half hour" if drives_again else "once",
            },
            {
                "faults": Figure.exact(sum(self.faults.values()), better=None),
                "scans sent": Figure.exact(self.sent, better=None),
                "mapped": Figure(self.mapped, better="more"),
                "cut off": Figure(self.lost, better=None),
                "unaccounted": Figure.exact(self.unaccounted),
                "memory after a quarter": Figure(settled.memory_mb, "MB"),
                "memory": Figure(end.memory_mb, "MB"),
                "memory in use after a quarter": _figure(settled.in_use_mb, "MB"),
                "memory in use": _figure(end.in_use_mb, "MB"),
                "nodes after a quarter": Figure(settled.nodes, better=None),
                "nodes": Figure(end.nodes, better=None),
                "time": Figure(self.wall_s, "s"),
            },
        )

    def table(self) -> str:
        """Return the figures for the terminal."""
        return "\n".join(
            (
                f"faults         {sum(self.faults.values())}: "
                + ", ".join(f"{count} {kind}" for kind, count in sorted(self.faults.items())),
                f"scans          {self.sent} sent, {self.received} received, {self.mapped} mapped; "
                f"{self.lost} lost in connections that were reset",
                f"bad lines      {self.bad_lines} sent, {self.num_skipped} skipped",
                f"odometry       {self.num_late} readings came late, and were skipped",
                f"unaccounted    {self.unaccounted}",
                f"memory         {self.settled.memory_mb:.0f} MB with {self.settled.nodes} nodes, "
                f"in the end {self.end.memory_mb:.0f} MB with {self.end.nodes}: "
                f"{self.bytes_per_scan:.0f} bytes per scan",
                f"in use         {self.settled.in_use_mb:.1f} MB, {self.settled.blocks} objects; "
                f"in the end {self.end.in_use_mb:.1f} MB, {self.end.blocks}",
                f"time           {self.wall_s:.0f} s",
            )
        )


def record_of(results: Mapping[str, SoakResult], hours: float, *, drives_again: bool) -> Record:
    """Return the record of days of that length, by kind of source."""
    rows = tuple(
        result.row(kind, hours, drives_again=drives_again) for kind, result in results.items()
    )
    return Record("soak", rows, environment())


def _figure(value: float, unit: str) -> Figure:
    """Return a figure that was measured once; 0 where it is unknown."""
    return Figure(value if math.isfinite(value) else 0.0, unit)


def soak(
    kind: str,
    hours: float,
    num_faults: int,
    out: Path,
    seed: int = 0,
    *,
    drives_again: bool = True,
) -> SoakResult:
    """Map a day of a robot and return what came of it.

    Parameters
    ----------
    kind : of source, of `NETWORKS`.
    hours : length of the day.
    num_faults : spread over it evenly.
    out : folder of the map.
    seed : of the faults.
    drives_again : whether the robot goes on driving after its first stop, and the map grows.
    """
    set_malloc_thresholds()
    relax_gc()
    start = time.perf_counter()
    network = NETWORKS[kind]()
    robot = Robot(network, hours, num_faults, seed, drives_again=drives_again)
    config = Config() if drives_again else Config(local_slam=_NO_NODES_WHILE_STANDING)
    try:
        result = map_live(
            Watched(network.source, robot.account.came),
            config,
            out,
            LiveOptions(MessageOptions(waits=True, end_after=network.end_after)),
            observer=robot,
            stop=robot.stop,
            overwrite=True,
        )
    finally:
        robot.thread.join()
        if robot.failure is not None:
            raise robot.failure
    account, report = robot.account, result.report
    return SoakResult(
        faults=robot.faults,
        sent=account.num_sent,
        received=account.num_came,
        mapped=report.input.scans,
        lost=account.num_lost,
        missing=account.num_missing,
        bad_lines=robot.bad_lines,
        skipped=dict(report.skipped),
        settled=robot.settled,
        end=robot.end,
        wall_s=time.perf_counter() - start,
    )
