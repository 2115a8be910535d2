# SPDX-License-Identifier: Apache-2.0
"""Counts how often the verdict is right on maps with known truth."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from bench.environment import environment
from bench.record import Case as RowCase
from bench.record import Figure, Record, Row
from bench.verdict.cases import Case, Truth, make_map
from bench.verdict.faults import FAULTS
from cartoloop.errors import CartoloopError
from cartoloop.simulation import WORLDS

CHOSEN_ON = ("office", "corridor", "ring", "flat")
"""Worlds on whose seeds 0 to 11 the limits of the verdict were chosen."""

FIRST_CHECKED_SEED = 500
"""Seeds from here on were not looked at when the limits were chosen."""

CHECKED_ONLY = ("wings", "hall", "bare")
"""Worlds that were not looked at when the limits were chosen, as far as the program has them."""

ROUTES = {"office": 3, "wings": 3, "hall": 3}
"""Worlds that take longer to map: used with one seed in as many as given."""


@dataclass(frozen=True)
class Judged:
    """A map, its truth and the verdict.

    Attributes
    ----------
    case, truth : of the map.
    verdict : on it.
    examine_share : processor time of the examination over that of the whole mapping.
    """

    case: Case
    truth: Truth
    verdict: str
    examine_share: float

    @property
    def is_flagged(self) -> bool:
        """Whether it is called doubtful or wrong."""
        return self.verdict != "good"


def cases(maps: int, first_seed: int = FIRST_CHECKED_SEED) -> Iterator[Case]:
    """Yield at least `maps` cases: all worlds and faults for one seed after the other."""
    worlds = [world for world in (*CHOSEN_ON, *CHECKED_ONLY) if world in WORLDS]
    count, seed = 0, first_seed
    while count < maps:
        for world in worlds:
            if (seed - first_seed) % ROUTES.get(world, 1):
                continue
            for name, fault in FAULTS.items():
                # As many that are to be right as may fail: each of the few, more often.
                for again in range(1 if fault.is_fault else RIGHT_SEEDS):
                    yield Case(world, seed + AGAIN * again, name)
                    count += 1
        seed += 1


CLEAR = (0.2, 0.4)
"""Errors below are clearly none, above clearly gross [m]."""

PLACE_ERROR_M = 0.5
"""A scan that is farther from the truth is reason enough for doubt [m], also in a map that is right
in the mean, and where places are visited again."""

RIGHT_SEEDS, AGAIN = 3, 1000
"""Seeds for which a recording without a fault is mapped, where one with a fault is for one."""


def run(maps: int, progress: Callable[[str], None], first_seed: int = FIRST_CHECKED_SEED) -> Record:
    """Return the rates over simulated maps.

    Parameters
    ----------
    maps : number of maps, half of them wrong or nearly.
    progress : called with a line for each map.
    first_seed : of the worlds.
    """
    judged = []
    for case in cases(maps, first_seed):
        try:
            judged.append(_judge(case))
        except CartoloopError as error:
            progress(f"{case.name}: not mapped: {error}")
            continue
        one = judged[-1]
        kind = "wrong" if one.truth.is_wrong else "right"
        progress(
            f"{case.name}: mean {one.truth.mean:.2f} m, revisits {one.truth.revisits:.2f} m, "
            f"{kind}; called {one.verdict}"
        )
    return Record("verdict", tuple(_rows(judged)), environment())


def _judge(case: Case) -> Judged:
    result, truth = make_map(case)
    stages = result.report.stages
    total = sum(stage.total_s for stage in stages.values())
    return Judged(case, truth, result.quality.verdict, stages["examine"].total_s / total)


def _rows(judged: Sequence[Judged]) -> Iterator[Row]:
    yield _row({"maps": "all"}, judged)
    clear = [one for one in judged if not CLEAR[0] < one.truth.error <= CLEAR[1]]
    yield _row({"maps": "without errors of 0.2 to 0.4 m"}, clear, "what is nearly wrong left out")
    whole = [one for one in judged if one.truth.is_wrong or one.truth.largest <= PLACE_ERROR_M]
    yield _row({"maps": f"without right ones with a scan off by {PLACE_ERROR_M} m"}, whole)
    for world in dict.fromkeys(one.case.world for one in judged):
        note = "limits chosen on other seeds" if world in CHOSEN_ON else "world not looked at"
        yield _row({"world": world}, [one for one in judged if one.case.world == world], note)
    for fault in FAULTS:
        yield _row({"fault": fault}, [one for one in judged if one.case.fault == fault])


def _row(case: RowCase, judged: Sequence[Judged], notes: str = "") -> Row:
    """Return the confusion of the verdict over some maps."""
    counts = Counter((_truth(one), one.verdict) for one in judged)
    wrong = [one for one in judged if one.truth.is_wrong]
    right = [one for one in judged if not one.truth.is_wrong]
    figures = {"maps": Figure.exact(len(judged), better=None)}
    for truth in ("right", "wrong"):
        for verdict in ("good", "doubtful", "wrong"):
            figures[f"{truth}, called {verdict}"] = Figure.exact(
                counts[truth, verdict], better=None
            )
    if wrong:
        share = sum(one.is_flagged for one in wrong) / len(wrong)
        figures["wrong ones flagged"] = Figure.exact(100.0 * share, "%", "more")
    if right:
        share = sum(one.is_flagged for one in right) / len(right)
        figures["right ones flagged"] = Figure.exact(100.0 * share, "%", "less")
    if judged:
        shares = [100.0 * one.examine_share for one in judged]
        figures["examination"] = Figure.of_samples(shares, "% of the time")
    return Row(case, figures, notes)


def _truth(one: Judged) -> str:
    return "wrong" if one.truth.is_wrong else "right"
