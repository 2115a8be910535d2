# SPDX-License-Identifier: Apache-2.0
"""The interface of recordings of all formats, and the problems found while reading them."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import Literal, NamedTuple, Protocol, cast

from cartoloop.plain_text import one_line
from cartoloop.sensor.events import SensorEvent
from cartoloop.sensor.sensor_profile import SensorProfile
from cartoloop.sensor.time_repair import TimeReport

ProblemSeverity = Literal["error", "warning", "note"]
EventGenerator = Generator[SensorEvent, None, None]

MAX_PROBLEMS = 50
"""Problems kept of one recording: one with a fault on each line must not fill the memory."""

MAX_PROBLEMS_PER_KIND = 5
"""Problems kept of one kind, so that a frequent kind does not hide the others."""


def short_name(path: Path) -> str:
    """Return the last component of a path as plain text, also where it is not valid UTF-8."""
    return one_line(os.fsencode(path.name).decode("utf-8", "replace"))


class LogProblem(NamedTuple):
    """A problem of a recording: its severity, one line with what and where, and its kind."""

    severity: ProblemSeverity
    message: str
    kind: str = ""


class Problems(Protocol):
    """The problems and the skipped lines of one pass, to be read."""

    @property
    def kept(self) -> list[LogProblem]:
        """The first problems, in the order they were found."""

    @property
    def count(self) -> int:
        """Number of problems, including those not kept."""

    @property
    def skipped(self) -> dict[str, int]:
        """Number of skipped lines or messages by reason."""

    @property
    def num_lost_scans(self) -> int:
        """Number of these that would have been scans."""


class ProblemLog:
    """Collects the problems and the skipped lines of one pass: counts all, keeps the first.

    Attributes
    ----------
    kept : the problems that are kept, in the order they were found.
    count : number of problems, including those not kept.
    skipped : number of skipped lines or messages by reason.
    num_lost_scans : number of these that would have been scans.
    """

    def __init__(self) -> None:
        self.num_lost_scans = 0
        self.kept: list[LogProblem] = []
        self.count = 0
        self.skipped: dict[str, int] = {}
        self._kinds: dict[str, int] = {}

    def add(self, severity: ProblemSeverity, message: str, kind: str = "") -> None:
        """Add a problem; only the first few of one `kind` are kept."""
        self.count += 1
        message = one_line(message)
        number = self._kinds[kind] = self._kinds.get(kind, 0) + 1
        rare = not kind or number <= MAX_PROBLEMS_PER_KIND
        if rare and len(self.kept) < MAX_PROBLEMS:
            self.kept.append(LogProblem(severity, message, kind))

    def skip(self, reason: str, message: str = "", *, is_scan: bool = False) -> None:
        """Count a skipped line under `reason`; with a `message` it is a problem as well.

        With `is_scan`, a scan is lost.
        """
        self.skipped[reason] = self.skipped.get(reason, 0) + 1
        self.num_lost_scans += is_scan
        if message:
            self.add("warning", message, reason)

    def copy(self) -> ProblemLog:
        """Return a copy that is independent of this one."""
        other = ProblemLog()
        other.kept, other.count = list(self.kept), self.count
        other.skipped, other._kinds = dict(self.skipped), dict(self._kinds)
        other.num_lost_scans = self.num_lost_scans
        return other


class LogPass(Iterator[SensorEvent]):
    """One pass over a recording: yields its events and has the problems found so far.

    Several passes over one recording are independent of each other.

    Attributes
    ----------
    log : the recording.
    """

    def __init__(self, log: Log, events: EventGenerator, problems: Problems) -> None:
        self.log = log
        self._events = events
        self._found = problems

    def __next__(self) -> SensorEvent:
        """Return the next event."""
        return next(self._events)

    def close(self) -> None:
        """End the pass early and release the file."""
        self._events.close()

    @property
    def skipped(self) -> dict[str, int]:
        """Number of skipped lines or messages by reason, so far."""
        return self._found.skipped

    @property
    def num_lost_scans(self) -> int:
        """Number of these that would have been scans, so far."""
        return self._found.num_lost_scans

    @property
    def problems(self) -> list[LogProblem]:
        """The first problems, each one line with its place: of opening, and so far."""
        return self._found.kept

    @property
    def num_problems(self) -> int:
        """Number of problems, including those not kept in `problems`."""
        return self._found.count


class Log(Protocol):
    """A recording: iterate over it, any number of times, for its events in their true order."""

    @property
    def name(self) -> str:
        """Short name of the recording."""

    @property
    def fingerprint(self) -> str:
        """By what the recording is known again; "" where nothing is known."""

    @property
    def description(self) -> str:
        """Contents of the recording and what is used of it: some lines for the user."""

    @property
    def num_scans(self) -> int:
        """Number of scans; a few may prove unusable while iterating."""

    @property
    def duration(self) -> float:
        """Repaired time from the first to the last event [s]."""

    @property
    def profile(self) -> SensorProfile:
        """Properties of the (first) scanner, estimated from its scans."""

    @property
    def time_report(self) -> TimeReport:
        """What was wrong with the time stamps."""

    @property
    def skipped(self) -> dict[str, int]:
        """Number of skipped lines or messages by reason, of the pass begun last."""

    @property
    def num_lost_scans(self) -> int:
        """Number of these that would have been scans, as far as is known."""

    @property
    def problems(self) -> list[LogProblem]:
        """The first problems: of opening, and of the pass begun last."""

    @property
    def num_problems(self) -> int:
        """Number of problems, including those not kept in `problems`."""

    def __iter__(self) -> LogPass:
        """Begin a pass: its events are in file order, their times never run backwards."""


class LogBase(ABC):
    """Common part of the recordings: passes and their problems.

    A subclass has the other members of :class:`Log` and calls ``super().__init__()`` first.
    """

    fingerprint = ""

    def __init__(self) -> None:
        self._found = ProblemLog()  # while opening; does not change afterwards
        self._latest: Problems = self._found

    @abstractmethod
    def _events(self, problems: ProblemLog) -> EventGenerator:
        """Yield the events of one pass; add faults to `problems`."""

    def __iter__(self) -> LogPass:
        """Begin a pass; bad lines and messages are skipped and counted."""
        problems = self._found.copy()
        self._latest = problems
        return LogPass(cast(Log, self), self._events(problems), problems)

    @property
    def skipped(self) -> dict[str, int]:
        """Number of skipped lines or messages by reason, of the pass begun last."""
        return self._latest.skipped

    @property
    def num_lost_scans(self) -> int:
        """Number of these that would have been scans, of the pass begun last."""
        return self._latest.num_lost_scans

    @property
    def problems(self) -> list[LogProblem]:
        """The first problems, each one line with its place: of opening, of the last pass."""
        return self._latest.kept

    @property
    def num_problems(self) -> int:
        """Number of problems, including those not kept in `problems`."""
        return self._latest.count
