# SPDX-License-Identifier: Apache-2.0
"""Timing programs in turn on a machine that other programs use too."""

from __future__ import annotations

import gc
import math
from collections.abc import Callable, Mapping
from time import perf_counter


def alternate(
    programs: Mapping[str, Callable[[], object]], repeats: int, min_sample_s: float = 0.005
) -> dict[str, list[float]]:
    """Return seconds a call, `repeats` samples for each program.

    Parameters
    ----------
    programs : what to time, by name. Each is called once before, untimed, so that compilation
        and the first use of memory do not count.
    repeats : number of rounds; in each, every program is timed once, so that a busy moment of
        the machine affects all of them alike.
    min_sample_s : a sample is a loop of as many calls as fill this time [s], so that the
        resolution of the clock does not matter.
    """
    calls: dict[str, int] = {}
    for name, program in programs.items():
        program()
        seconds = _time(program, 1)
        calls[name] = max(1, math.ceil(min_sample_s / max(seconds, 1e-7)))
    samples: dict[str, list[float]] = {name: [] for name in programs}
    for _ in range(repeats):
        for name, program in programs.items():
            samples[name].append(_time(program, calls[name]))
    return samples


def _time(program: Callable[[], object], calls: int) -> float:
    """Return the mean seconds of a call."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        start = perf_counter()
        for _ in range(calls):
            program()
        return (perf_counter() - start) / calls
    finally:
        if collecting:
            gc.enable()
