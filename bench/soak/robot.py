# SPDX-License-Identifier: Apache-2.0
"""A robot that sends the scans of a day, and has faults happen."""

from __future__ import annotations

import resource
import time
from collections import Counter
from collections.abc import Callable
from random import Random
from threading import Thread

import numpy as np

from bench.soak.account import Account
from bench.soak.day import PERIOD_S, day
from bench.soak.held import Held, held
from bench.soak.senders import Network, Sender, Silent
from cartoloop.live.live_run import LiveObserver
from cartoloop.live.sockets import MAX_CLIENTS
from cartoloop.mapper import Mapper
from cartoloop.sensor.events import LaserScan
from cartoloop.stop_request import StopRequest

SETTLED = 0.25
"""Share of the day after which memory is compared with that at the end: all is built up by then."""


_FLOOD = 2000
"""Messages of a flood."""

_TICK_S = 1e-3

_LIMIT_S = 600.0
"""Time for scans to come: long after that, they never will [s]."""


class Robot(LiveObserver):
    """Sends a day of scans in a thread, and has faults happen.

    Parameters
    ----------
    network : connects it to the source.
    hours, num_faults : length of the day, and the faults spread over it evenly.
    drives_again : whether it goes on driving after its first stop.
    seed : of the faults.

    Attributes
    ----------
    account : of the scans.
    faults : number of each kind.
    bad_lines : lines that were sent damaged, or of no known kind.
    settled, end : what the process held after a quarter of the day, and at last.
    failure : why the day ended early.
    """

    def __init__(
        self,
        network: Network,
        hours: float,
        num_faults: int,
        seed: int,
        *,
        drives_again: bool = True,
    ) -> None:
        self._end_s = 3600.0 * hours
        self._fault_period_s = self._end_s / max(num_faults, 1)
        self._drives_again = drives_again
        self.account = Account(round(self._end_s / PERIOD_S) + 1)
        self.faults: Counter[str] = Counter()
        self.bad_lines = 0
        self.settled, self.end = Held(), Held()
        self._network = network
        self._random = Random(seed)
        self._numbers = np.random.default_rng(seed)
        self._shift_s = 0.0
        self._flooded = 0
        self._silent: list[Silent] = []
        self._possible: dict[str, Callable[[Sender], Sender]] = {
            "drop": self._drop,
            "reset": self._reset,
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
        """Begin to send once the source is open."""
        if line.endswith("(Ctrl-C ends)") and not self.thread.ident:
            self.thread.start()

    def changed(self, mapper: Mapper) -> None:
        """Measure the memory when the map is of a quarter of the day, and when it is of more."""
        scans = mapper.num_scans
        if scans >= self.end.scans + 100:
            self.end = held(scans, mapper.num_nodes)
            if not self.settled.scans and scans * PERIOD_S >= SETTLED * self._end_s:
                self.settled = self.end

    def _run(self) -> None:
        try:
            self._send_all()
        except Exception as failure:  # noqa: BLE001 - raised where the robot was started
            self.failure, self.stop.made = failure, True
        finally:
            _limit_files(resource.RLIM_INFINITY)

    def _send_all(self) -> None:
        sender = self._network.connect()
        next_fault = 0.5 * self._fault_period_s  # none at the very end: what comes then is too late
        for time_s, event in day(self._end_s, self._numbers, drives_again=self._drives_again):
            while time_s >= next_fault:
                next_fault += self._fault_period_s
                kind = self._random.choice(list(self._possible))
                sender = self._possible[kind](sender)
                self.faults[kind] += 1
            stamp = time_s + self._shift_s
            if isinstance(event, LaserScan):
                self._wait_until(lambda: self.account.num_ahead < self._network.max_ahead)
                stamp = self.account.stamp(stamp)
            sender.send(event, stamp)
        sender.end()
        for connection in self._silent:
            connection.close()

    def _drop(self, sender: Sender) -> Sender:
        """Break off in the middle of a message, and connect again."""
        self.bad_lines += sender.break_off()
        return self._connect_again()

    def _reset(self, sender: Sender) -> Sender:
        """Reset the connection, and connect again."""
        # What came before the scans on their way is not lost: no flood, no message damaged.
        sent = self.account.num_sent - self._flooded
        self._wait_until(lambda: self.account.num_ahead < max(sent, 1))
        self.account.cut()
        sender.cut()
        return self._connect_again()

    def _connect_again(self) -> Sender:
        self.account.connected()
        return self._network.connect()

    def _flood(self, sender: Sender) -> Sender:
        self.bad_lines += sender.flood(_FLOOD)
        self._flooded = self.account.num_sent
        return sender

    def _wait_until(self, is_true: Callable[[], bool]) -> None:
        deadline = time.monotonic() + _LIMIT_S
        while not is_true() and not self.stop.made:
            if time.monotonic() > deadline:
                raise TimeoutError("scans that were sent do not come")
            time.sleep(_TICK_S)

    def _garbage(self, sender: Sender) -> Sender:
        other = self._network.connect()
        self.bad_lines += other.send_garbage(self._random.randbytes(5000))
        other.close()
        return sender

    def _half_open(self, sender: Sender) -> Sender:
        while len(self._silent) >= MAX_CLIENTS:
            self._silent.pop(0).close()
        self._silent.append(self._network.connect_silent())
        return sender

    def _clock_jump(self, sender: Sender) -> Sender:
        self._shift_s += self._random.choice((-3600.0, -60.0, 60.0, 3600.0, 1e6))
        return sender

    def _full_disk(self, sender: Sender) -> Sender:
        """Have writes fail until the next time."""
        now, _ = resource.getrlimit(resource.RLIMIT_FSIZE)
        _limit_files(1000 if now == resource.RLIM_INFINITY else resource.RLIM_INFINITY)
        return sender


def _limit_files(num_bytes: int) -> None:
    """Let this process write no longer files, as if the disk were full."""
    _, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (num_bytes, hard))
