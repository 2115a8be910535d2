# SPDX-License-Identifier: Apache-2.0
"""Several recordings, one after the other, as if they were one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from cartoloop.readers.log import Log, Problem
from cartoloop.sensor.events import SensorEvent
from cartoloop.sensor.sensor_profile import SensorProfile
from cartoloop.sensor.time_repair import TimeReport


class LogChain:
    """Recordings in a row; see `cartoloop.readers.log.Log` for what it offers.

    Where a recording does not begin after the end of the one before, its times (never its stamps)
    are shifted so that it begins one scan period later.

    Parameters
    ----------
    logs : in the order of time, at least one.
    """

    def __init__(self, logs: Sequence[Log]) -> None:
        if not logs:
            raise ValueError("a chain needs at least one log")
        self._logs = tuple(logs)
        self.name = " + ".join(log.name for log in logs)
        self.num_scans = sum(log.num_scans for log in logs)
        self.duration = sum(log.duration for log in logs)

    @property
    def description(self) -> str:
        """What is in the first recording."""
        return self._logs[0].description

    @property
    def profile(self) -> SensorProfile:
        """What the first recording says of its scanner; scans carry the geometry of their own."""
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
        """How many lines were skipped, by reason; grows while iterating."""
        total: dict[str, int] = {}
        for log in self._logs:
            for reason, count in log.skipped.items():
                total[reason] = total.get(reason, 0) + count
        return total

    @property
    def problems(self) -> list[Problem]:
        """The first problems of each recording; grows while iterating."""
        return [problem for log in self._logs for problem in log.problems]

    @property
    def num_problems(self) -> int:
        """How many problems were found, including those not kept in `problems`."""
        return sum(log.num_problems for log in self._logs)

    def __iter__(self) -> Iterator[SensorEvent]:
        """Yield the events of one recording after the other, times never running backwards."""
        end = None
        for log in self._logs:
            shift = None
            for event in log:
                if shift is None:
                    late = end is None or event.time > end
                    shift = (
                        0.0 if end is None or late else end + log.time_report.period - event.time
                    )
                shifted = replace(event, time=event.time + shift) if shift else event
                end = shifted.time
                yield shifted
