# SPDX-License-Identifier: Apache-2.0
"""Several recordings, one after the other, as if they were one."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace

from cartoloop.readers.fingerprint import joint_fingerprint
from cartoloop.readers.log import EventGenerator, Log, LogPass, LogProblem
from cartoloop.sensor.sensor_profile import SensorProfile
from cartoloop.sensor.time_repair import TimeReport


class LogChain:
    """Recordings in a row; see `cartoloop.readers.log.Log` for what it offers.

    Where a recording does not begin after the end of the one before, its times (never its stamps)
    are shifted so that it begins one scan period later.

    Parameters
    ----------
    logs : in the order of time, at least one.

    Raises
    ------
    ValueError
        There are no logs.
    """

    def __init__(self, logs: Sequence[Log]) -> None:
        if not logs:
            raise ValueError("a chain needs at least one log")
        self._logs = tuple(logs)
        self.name = " + ".join(log.name for log in logs)
        self.fingerprint = joint_fingerprint([log.fingerprint for log in logs])
        self.num_scans = sum(log.num_scans for log in logs)
        self.duration = sum(log.duration for log in logs)
        self._latest = _ChainProblems(logs)

    @property
    def description(self) -> str:
        """Contents of the first recording: some lines for the user."""
        return self._logs[0].description

    @property
    def profile(self) -> SensorProfile:
        """Properties of the first recording's scanner; each scan carries its own geometry."""
        return self._logs[0].profile

    @property
    def time_report(self) -> TimeReport:
        """What was wrong with the time stamps, in sum; gaps and resets are in `problems`."""
        reports = [log.time_report for log in self._logs]
        return TimeReport(
            num_stamps=sum(r.num_stamps for r in reports),
            num_missing=sum(r.num_missing for r in reports),
            num_backwards=sum(r.num_backwards for r in reports),
            largest_backwards=max(r.largest_backwards for r in reports),
            num_repeated=sum(r.num_repeated for r in reports),
            num_wild=sum(r.num_wild for r in reports),
            num_repaired=sum(r.num_repaired for r in reports),
            period=reports[0].period,
        )

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
        """The first problems of each recording: of opening, and of the pass begun last."""
        return self._latest.kept

    @property
    def num_problems(self) -> int:
        """Number of problems, including those not kept in `problems`."""
        return self._latest.count

    def __iter__(self) -> LogPass:
        """Begin a pass: one recording after the other, times never running backwards."""
        passes = [iter(log) for log in self._logs]
        self._latest = _ChainProblems(passes)
        return LogPass(self, _in_a_row(passes), self._latest)


class _ChainProblems:
    """The problems of several recordings, or of one pass over each."""

    def __init__(self, parts: Sequence[Log | LogPass]) -> None:
        self._parts = tuple(parts)

    @property
    def skipped(self) -> dict[str, int]:
        """Number of skipped lines or messages by reason."""
        total: dict[str, int] = {}
        for part in self._parts:
            for reason, count in part.skipped.items():
                total[reason] = total.get(reason, 0) + count
        return total

    @property
    def num_lost_scans(self) -> int:
        """Number of these that would have been scans."""
        return sum(part.num_lost_scans for part in self._parts)

    @property
    def kept(self) -> list[LogProblem]:
        """The first problems of each recording."""
        return [problem for part in self._parts for problem in part.problems]

    @property
    def count(self) -> int:
        """Number of problems, including those not kept."""
        return sum(part.num_problems for part in self._parts)


def _in_a_row(passes: Sequence[LogPass]) -> EventGenerator:
    end = None
    for events in passes:
        shift = None
        with closing(events):
            for event in events:
                if shift is None:
                    late = end is None or event.time > end
                    period = events.log.time_report.period
                    shift = 0.0 if end is None or late else end + period - event.time
                shifted = replace(event, time=event.time + shift) if shift else event
                end = shifted.time
                yield shifted
