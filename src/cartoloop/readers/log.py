# SPDX-License-Identifier: Apache-2.0
"""What every recording offers, whatever its format, and the troubles found while reading it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Literal, NamedTuple, Protocol

from cartoloop.sensor.events import SensorEvent
from cartoloop.sensor.sensor_profile import SensorProfile
from cartoloop.sensor.time_repair import TimeReport

Severity = Literal["error", "warning", "note"]

# A log with a fault on each line must not fill the memory, nor the user's screen.
MAX_PROBLEMS = 50
MAX_PROBLEMS_PER_KIND = 5


def short_name(path: Path) -> str:
    """Return the last component of a path as text, whatever bytes the file system has in it."""
    return os.fsencode(path.name).decode("utf-8", "replace")


class Problem(NamedTuple):
    """Something wrong with a recording: how bad, one line that says what and where, what kind."""

    severity: Severity
    message: str
    kind: str = ""


class Problems:
    """The problems and the skipped lines of one pass: all are counted, the first are kept.

    Attributes
    ----------
    kept : the problems that are kept, in the order they were found.
    count : how many there were in all.
    skipped : how many lines were skipped, by reason.
    """

    def __init__(self) -> None:
        self.kept: list[Problem] = []
        self.count = 0
        self.skipped: dict[str, int] = {}
        self._kinds: dict[str, int] = {}

    def add(self, severity: Severity, message: str, kind: str = "") -> None:
        """Note a problem; of those of one `kind` only the first few are kept."""
        self.count += 1
        number = self._kinds[kind] = self._kinds.get(kind, 0) + 1
        rare = not kind or number <= MAX_PROBLEMS_PER_KIND
        if rare and len(self.kept) < MAX_PROBLEMS:
            self.kept.append(Problem(severity, message, kind))

    def copy(self) -> Problems:
        """Return a copy that is counted on independently."""
        other = Problems()
        other.kept, other.count = list(self.kept), self.count
        other.skipped, other._kinds = dict(self.skipped), dict(self._kinds)
        return other

    def skip(self, reason: str, message: str = "") -> None:
        """Count a skipped line under `reason`; with a `message` it is a problem as well."""
        self.skipped[reason] = self.skipped.get(reason, 0) + 1
        if message:
            self.add("warning", message, reason)


class TellsProblems:
    """The part of a :class:`Log` that tells what was wrong: in opening it, and in the last pass."""

    _current: Problems

    @property
    def skipped(self) -> dict[str, int]:
        """How many lines or messages were skipped, by reason; grows while iterating."""
        return self._current.skipped

    @property
    def problems(self) -> list[Problem]:
        """The first problems found, each one line with its place; grows while iterating."""
        return self._current.kept

    @property
    def num_problems(self) -> int:
        """How many problems were found, including those not kept in `problems`."""
        return self._current.count


class Log(Protocol):
    """A recording: iterate over it, as often as wanted, for its events in their true order."""

    @property
    def name(self) -> str:
        """Short name of the recording."""

    @property
    def description(self) -> str:
        """What is in it, and what is used of it: some lines for the user."""

    @property
    def num_scans(self) -> int:
        """How many scans there are; a few may prove unusable while iterating."""

    @property
    def duration(self) -> float:
        """Repaired time from the first to the last event [s]."""

    @property
    def profile(self) -> SensorProfile:
        """What the recording says of its (first) scanner."""

    @property
    def time_report(self) -> TimeReport:
        """What was wrong with the time stamps."""

    @property
    def skipped(self) -> dict[str, int]:
        """How many lines or messages were skipped, by reason; grows while iterating."""

    @property
    def problems(self) -> list[Problem]:
        """The first problems found, each one line with its place; grows while iterating."""

    @property
    def num_problems(self) -> int:
        """How many problems were found, including those not kept in `problems`."""

    def __iter__(self) -> Iterator[SensorEvent]:
        """Yield the events in file order, times never running backwards."""
