# SPDX-License-Identifier: Apache-2.0
"""Durations of named stages, cheap enough to measure every scan."""

from __future__ import annotations

from array import array
from dataclasses import dataclass
from time import perf_counter
from types import TracebackType


@dataclass(frozen=True, slots=True)
class StageSummary:
    """The durations of one stage.

    Attributes
    ----------
    calls : number of calls.
    total_s : total time [s].
    median_ms, p99_ms : of one call [ms].
    """

    calls: int
    total_s: float
    median_ms: float
    p99_ms: float


class _Stage:
    """Measures one stage; not reentrant."""

    __slots__ = ("durations", "start")

    def __init__(self) -> None:
        self.durations = array("d")
        self.start = 0.0

    def __enter__(self) -> None:
        self.start = perf_counter()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.durations.append(perf_counter() - self.start)


class StageTimer:
    """Durations of all calls of all stages, 8 bytes for each call.

    `measure` is for the mapping thread; a stage must not be nested in itself. Worker threads
    measure their own times and pass them to `record`.
    """

    def __init__(self) -> None:
        self._stages: dict[str, _Stage] = {}

    def measure(self, stage: str) -> _Stage:
        """Return the context manager that measures its body as one call of `stage`."""
        try:
            return self._stages[stage]
        except KeyError:
            # setdefault, because a worker thread may record the first call of it meanwhile.
            return self._stages.setdefault(stage, _Stage())

    def record(self, stage: str, seconds: float) -> None:
        """Add one call of `stage` with its duration [s]; safe from any thread."""
        self.measure(stage).durations.append(seconds)

    def summary(self) -> dict[str, StageSummary]:
        """Return the summary of each stage that ran, in the order of their first call."""
        return {
            name: _summary(stage.durations)
            for name, stage in list(self._stages.items())
            if stage.durations
        }


def _summary(durations: array[float]) -> StageSummary:
    ordered = sorted(durations)
    last = len(ordered) - 1
    return StageSummary(
        calls=len(ordered),
        total_s=sum(ordered),
        median_ms=1e3 * (ordered[last // 2] + ordered[(last + 1) // 2]) / 2.0,
        # the nearest rank: 99 of 100 calls took no longer
        p99_ms=1e3 * ordered[-(-99 * len(ordered) // 100) - 1],
    )
