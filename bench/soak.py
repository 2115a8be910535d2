# SPDX-License-Identifier: Apache-2.0
"""A robot that is mapped for hours while everything goes wrong, in compressed time.

Its day: it drives around a ring of corridors, stands for half an hour, drives back, and so on.
Hours of it take minutes, since the stamps run faster than the clock. Meanwhile connections break,
floods and garbage come, others open connections and say nothing, clocks jump, and the disk is full
for a while. Each scan must be mapped or counted, and the memory must not grow with time.
"""

from __future__ import annotations

import json
import resource
import socket
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from threading import Thread
from typing import Protocol

import numpy as np
from websockets.sync.client import connect

from cartoloop.live.live_run import LiveObserver, LiveOptions, map_live
from cartoloop.live.sockets import MAX_CLIENTS, TcpSource, WebSocketSource
from cartoloop.runtime.process_memory import relax_gc, set_malloc_thresholds
from cartoloop.sensor.events import LaserScan, Odometry, SensorEvent
from cartoloop.simulation import ring, simulate
from cartoloop.stop_request import StopRequest

STANDS_S = 1800.0
"""Time between two drives [s]."""

_SETTLED = 0.25
"""Share of the day after which memory is compared with that at the end: all is built up by then."""

_NOISE_M = 0.01
_PERIOD_S = 0.2


class _Sender(Protocol):
    """A connection of the robot."""

    def send(self, data: bytes) -> None:
        """Send lines."""

    def close(self) -> None:
        """Close the connection."""


class _Tcp:
    def __init__(self, address: tuple[str, int]) -> None:
        self._socket = socket.create_connection(address)

    def send(self, data: bytes) -> None:
        self._socket.sendall(data)

    def close(self) -> None:
        # Until all that is under way was read, so that what comes after cannot overtake it.
        self._socket.shutdown(socket.SHUT_WR)
        while self._socket.recv(1000):
            pass
        self._socket.close()


class _WebSocket:
    def __init__(self, address: tuple[str, int]) -> None:
        self._context = ExitStack()
        self._connection = self._context.enter_context(
            connect("ws://{}:{}".format(*address), compression=None)
        )

    def send(self, data: bytes) -> None:
        self._connection.send(data)

    def close(self) -> None:
        self._context.close()


SOURCES: dict[str, tuple[type[TcpSource | WebSocketSource], Callable[[tuple[str, int]], _Sender]]]
SOURCES = {"tcp": (TcpSource, _Tcp), "ws": (WebSocketSource, _WebSocket)}


@dataclass
class SoakResult:
    """What came of a day.

    Attributes
    ----------
    faults : number of each kind.
    sent, mapped : scans that were sent whole, and those with a pose.
    bad_lines : lines that were sent damaged, or of no known kind.
    skipped : what the report counts, by reason.
    settled_mb, end_mb : memory after a quarter of the day, and at its end [MB].
    wall_s : time that it took [s].
    """

    faults: Counter[str] = field(default_factory=Counter)
    sent: int = 0
    mapped: int = 0
    bad_lines: int = 0
    skipped: dict[str, int] = field(default_factory=dict)
    settled_mb: float = 0.0
    end_mb: float = 0.0
    wall_s: float = 0.0

    @property
    def unaccounted(self) -> int:
        """Number of scans and bad lines that were neither mapped nor counted."""
        return self.sent + self.bad_lines - self.mapped - sum(self.skipped.values())

    def table(self) -> str:
        """Return the figures for the terminal."""
        return "\n".join(
            (
                f"faults         {sum(self.faults.values())}: "
                + ", ".join(f"{count} {kind}" for kind, count in sorted(self.faults.items())),
                f"scans          {self.sent} sent, {self.mapped} mapped",
                f"bad lines      {self.bad_lines} sent, {sum(self.skipped.values())} skipped",
                f"unaccounted    {self.unaccounted}",
                f"memory         {self.settled_mb:.0f} MB, in the end {self.end_mb:.0f} MB",
                f"time           {self.wall_s:.0f} s",
            )
        )


class _Robot(LiveObserver):
    """Sends a day of scans in a thread, and has faults happen."""

    def __init__(
        self,
        source: TcpSource | WebSocketSource,
        kind: str,
        hours: float,
        num_faults: int,
        seed: int,
    ) -> None:
        self.result = SoakResult()
        self._source = source
        self._connect = SOURCES[kind][1]
        self._random = Random(seed)
        self._numbers = np.random.default_rng(seed)
        self._end_s = 3600.0 * hours
        self._fault_period_s = self._end_s / max(num_faults, 1)
        self._shift_s = 0.0
        self._silent: list[socket.socket] = []
        self._faults: dict[str, Callable[[_Sender], _Sender]] = {
            "drop": self._drop,
            "flood": self._flood,
            "garbage": self._garbage,
            "half-open": self._half_open,
            "clock jump": self._clock_jump,
            "full disk": self._full_disk,
        }
        self.thread = Thread(target=self._run, name="robot", daemon=True)
        self.stop = StopRequest()
        self.failure: Exception | None = None

    def say(self, line: str) -> None:
        """Begin to send once the source listens."""
        if line.startswith("listening"):
            self.thread.start()

    def _run(self) -> None:
        try:
            self._drive()
        except Exception as failure:  # noqa: BLE001 - raised where the robot was started
            self.failure, self.stop.made = failure, True
        finally:
            _limit_files(resource.RLIM_INFINITY)

    def _drive(self) -> None:
        sender = self._connect(self._source.address)
        next_fault = self._fault_period_s
        for time_s, event in _day(self._end_s, self._numbers):
            while time_s >= next_fault:
                next_fault += self._fault_period_s
                kind = self._random.choice(list(self._faults))
                sender = self._faults[kind](sender)
                self.result.faults[kind] += 1
            sender.send(_line(event, time_s + self._shift_s))
            self.result.sent += isinstance(event, LaserScan)
            if time_s >= _SETTLED * self._end_s and not self.result.settled_mb:
                self.result.settled_mb = _held_mb()
        self.result.end_mb = _held_mb()
        sender.send(b'{"type": "end"}\n')
        sender.close()
        for connection in self._silent:
            connection.close()

    def _drop(self, sender: _Sender) -> _Sender:
        """Break off in the middle of a message, and connect again."""
        if isinstance(sender, _Tcp):  # a message of a WebSocket is whole or nothing
            sender.send(b'{"type": "scan", "ranges": [1.0, 2.')
            self.result.bad_lines += 1
        sender.close()
        return self._connect(self._source.address)

    def _flood(self, sender: _Sender) -> _Sender:
        sender.send(b'{"type": "battery", "volts": 24.1}\n' * 2000)
        self.result.bad_lines += 2000
        return sender

    def _garbage(self, sender: _Sender) -> _Sender:
        other = self._connect(self._source.address)
        with suppress(OSError):
            other.send(self._random.randbytes(5000).replace(b"\n", b" ") + b"\n")
            self.result.bad_lines += 1
        other.close()
        return sender

    def _half_open(self, sender: _Sender) -> _Sender:
        while len(self._silent) >= MAX_CLIENTS:
            self._silent.pop(0).close()
        self._silent.append(socket.create_connection(self._source.address))
        return sender

    def _clock_jump(self, sender: _Sender) -> _Sender:
        self._shift_s += self._random.choice((-3600.0, -60.0, 60.0, 3600.0, 1e6))
        return sender

    def _full_disk(self, sender: _Sender) -> _Sender:
        """Have writes fail until the next time."""
        now, _ = resource.getrlimit(resource.RLIMIT_FSIZE)
        _limit_files(1000 if now == resource.RLIM_INFINITY else resource.RLIM_INFINITY)
        return sender


def soak(kind: str, hours: float, num_faults: int, out: Path, seed: int = 0) -> SoakResult:
    """Map a day of a robot and return what came of it.

    Parameters
    ----------
    kind : of source, of `SOURCES`.
    hours : length of the day.
    num_faults : spread over it evenly.
    out : folder of the map.
    """
    set_malloc_thresholds()
    relax_gc()
    start = time.perf_counter()
    source = SOURCES[kind][0]("127.0.0.1", 0)
    robot = _Robot(source, kind, hours, num_faults, seed)
    try:
        result = map_live(
            source,
            None,
            out,
            LiveOptions(waits=True),
            observer=robot,
            stop=robot.stop,
            overwrite=True,
        )
    finally:
        robot.thread.join()
        if robot.failure is not None:
            raise robot.failure
    robot.result.mapped = result.report.input.scans
    robot.result.skipped = dict(result.report.skipped)
    robot.result.wall_s = time.perf_counter() - start
    return robot.result


def _day(end_s: float, numbers: np.random.Generator) -> Iterator[tuple[float, SensorEvent]]:
    """Yield events with their times [s]: a drive, a long stop, the drive backwards, and so on."""
    there = list(simulate(ring(), seed=1, duration=60.0).events())
    time_s = 0.0
    while time_s < end_s:
        for event in there:
            time_s += _PERIOD_S if isinstance(event, LaserScan) else 0.0
            if time_s >= end_s:
                return
            yield time_s, event
        last = next(event for event in reversed(there) if isinstance(event, LaserScan))
        for _ in range(round(min(STANDS_S, max(end_s - time_s, 0.0)) / _PERIOD_S)):
            time_s += _PERIOD_S
            ranges = last.ranges + numbers.normal(0.0, _NOISE_M, len(last.ranges))
            yield time_s, LaserScan(time_s, time_s, np.maximum(ranges, 0.05), last.geometry)
        there.reverse()


def _line(event: SensorEvent, stamp: float) -> bytes:
    """Return a message, rounded as robots send them."""
    if isinstance(event, Odometry):
        x, y, theta = event.tf_odom_tracking
        content: dict[str, object] = {"type": "odometry", "x": x, "y": y, "theta": theta}
    else:
        assert isinstance(event, LaserScan)
        geometry = event.geometry
        content = {
            "type": "scan",
            "angle_min": geometry.angle_min,
            "angle_increment": geometry.angle_increment,
            "range_max": 30.0,
            "ranges": np.round(event.ranges, 3).tolist(),
        }
    return json.dumps({**content, "stamp": stamp}).encode() + b"\n"


def _limit_files(num_bytes: int) -> None:
    """Let this process write no longer files, as if the disk were full."""
    _, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (num_bytes, hard))


def _held_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / 1e6
