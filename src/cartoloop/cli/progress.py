# SPDX-License-Identifier: Apache-2.0
"""Progress of a run: a bar on a terminal, a line every few seconds elsewhere."""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import perf_counter
from typing import NamedTuple, Protocol, TextIO

from cartoloop.cli.lost_output import styled

_BAR_PERIOD_S = 0.1
"""Time between two updates of the bar [s]: smooth enough to the eye."""

_LINE_PERIOD_S = 5.0
"""Time between two lines [s], so that logs stay short."""


_FIRST_ESTIMATE_S = 3.0
"""The remaining time is estimated after so much mapping [s]: the first scans are quicker."""

_WINDOW_S = 10.0
"""The remaining time is estimated from the pace of so much mapping [s], as the pace changes."""


class _Moment(NamedTuple):
    """How far a run was: time that counts [s], scans, recorded time of these [s]."""

    seconds: float
    num_scans: int
    recorded_s: float


class Display(Protocol):
    """Shows the progress of a run."""

    def show(self, num_scans: int, status: str) -> None:
        """Show the number of scans done, and a status text."""


class Progress:
    """Rate, real-time factor and remaining time of a run over a recording.

    All count from the first scan that was mapped: before it, kernels are loaded or compiled.

    Parameters
    ----------
    num_scans : total number of scans.
    display : shows the progress.
    period : time between two displays [s].
    paused_s : returns the time that does not count for the rate, as compiling [s].
    """

    def __init__(
        self, num_scans: int, display: Display, period: float, paused_s: Callable[[], float]
    ) -> None:
        self._num_scans = num_scans
        self._display = display
        self._period = period
        self._paused_s = paused_s
        self._next = perf_counter() + period
        self._first: _Moment | None = None
        self._recent: deque[_Moment] = deque()

    def update(self, num_scans: int, recorded_s: float, num_loop_closures: int) -> None:
        """Show the progress, once per period.

        Parameters
        ----------
        num_scans : scans done.
        recorded_s : recorded time of these scans [s].
        num_loop_closures : loop closures found.
        """
        now = perf_counter()
        if num_scans == 0 or (now < self._next and self._first is not None):
            return
        moment = _Moment(now - self._paused_s(), num_scans, recorded_s)
        if self._first is None:
            self._first = moment
            self._recent.append(moment)
        if now < self._next:
            return
        self._next = now + self._period
        status = [*self._rates(moment), f"{num_loop_closures} closures"]
        self._display.show(num_scans, ", ".join(status))

    def _rates(self, moment: _Moment) -> Iterator[str]:
        assert self._first is not None
        elapsed = moment.seconds - self._first.seconds
        if elapsed > 0.0:
            yield f"{(moment.num_scans - self._first.num_scans) / elapsed:.0f}/s"
            yield f"{(moment.recorded_s - self._first.recorded_s) / elapsed:.1f}x real time"
        self._recent.append(moment)
        while self._recent[1].seconds < moment.seconds - _WINDOW_S:
            self._recent.popleft()
        before = self._recent[0]
        mapped, left = moment.num_scans - before.num_scans, self._num_scans - moment.num_scans
        if elapsed >= _FIRST_ESTIMATE_S and mapped > 0:
            seconds = max(0, left) * (moment.seconds - before.seconds) / mapped
            yield f"{format_duration(seconds)} left"


class _Lines:
    """Progress as lines of text."""

    def __init__(self, num_scans: int, stream: TextIO) -> None:
        self._num_scans = num_scans
        self._stream = stream

    def show(self, num_scans: int, status: str) -> None:
        self._stream.write(f"{num_scans} of {self._num_scans} scans, {status}\n")
        self._stream.flush()


@contextmanager
def progress(
    num_scans: int, stream: TextIO | None = None, *, paused_s: Callable[[], float] = float
) -> Iterator[Progress]:
    """Yield the progress of a run over `num_scans` scans, shown on a stream (standard error).

    `paused_s` returns the time that does not count for the rate, as compiling [s].
    """
    stream = stream or sys.stderr
    if not stream.isatty():
        yield Progress(num_scans, _Lines(num_scans, stream), _LINE_PERIOD_S, paused_s)
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
    from rich.progress import Progress as Bar

    columns = (BarColumn(10), MofNCompleteColumn(), TextColumn("scans, {task.fields[status]}"))
    with Bar(*columns, console=Console(file=styled(stream)), transient=True) as bar:
        task = bar.add_task("", total=num_scans, status="")

        class _Bar:
            def show(self, num_scans: int, status: str) -> None:
                bar.update(task, completed=num_scans, status=status)

        yield Progress(num_scans, _Bar(), _BAR_PERIOD_S, paused_s)


def format_duration(seconds: float) -> str:
    """Return a duration as text: 40 s, 3 min 20 s, 2 h 5 min."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"
