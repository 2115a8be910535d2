# SPDX-License-Identifier: Apache-2.0
"""The parts of the benchmark: changed recordings, worlds, sparse recordings, two scanners."""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from bench.command_runs import run_command
from bench.robustness.carmen_text import read_carmen
from bench.robustness.changes import (
    CHANGES,
    UNCHANGED,
    Change,
    NothingLeft,
    changed_log,
    changed_relations,
    check_relations_left,
)
from bench.robustness.log_changes import noise
from bench.robustness.one_map import OneMap, map_log
from bench.robustness.runs import Run, RunStore
from bench.robustness.simulated_worlds import (
    SimulatedWorld,
    handicapped_worlds,
    simulated_worlds,
)
from cartoloop.errors import CartoloopError, InputError
from cartoloop.evaluation.relations import evaluate_relations, read_relations
from cartoloop.evaluation.trajectories import read_tum
from cartoloop.evaluation.trajectory_error import evaluate_trajectory

RECORDINGS: Final = ("mit-killian", "intel", "fr079", "mit-csail", "aces")
"""Recordings that are changed."""

VERIFIED: Final = {
    "intel": "intel-exact.relations",
    "fr079": "fr079.relations",
    "mit-csail": "mit-csail.relations",
}
"""Recordings with relations that people verified; the others get those of their unchanged map."""

CLOSED_M = 0.05
"""Error below which loops are closed, where the relations are those of the recording's map [m]; in
a building that is scaled, as much larger."""

MOST_TIMES_UNCHANGED = 1.5
"""Error of a changed recording over that of the unchanged one, at most, where people verified."""

WORLDS, HANDICAPPED = "worlds", "handicapped maps"
SPARSE, SCANNERS = "sparse recordings", "two scanners"
PARTS: Final = (*RECORDINGS, WORLDS, HANDICAPPED, SPARSE, SCANNERS)

SPARSE_RECORDINGS: Final = ("belgioioso", "acapulco", "edmonton", "fhw")
STAMP_TOLERANCE_S = 1e-4
"""Scans with a stamp this near that of a relation are its scan [s]: no change alters stamps, and
where every second scan is left out, the nearest one may be another, a few ms later."""

COPIES: Final = Change("5 mm of noise", noise(0.005), seeds=3)
"""Two copies of a sparse recording with such noise should give the same map: how far their poses
are apart is its error. One map alone may be right by chance."""

SPARSE_BAR_M = 0.20
"""Largest root mean square error of belgioioso against the poses of GMapping [m]."""

BAGS: Final = ("guardian_3", "guardian_controller_2")
BOTH = "both"
TOPICS: Final = {"front": ("/scan",), "rear": ("/hokuyo_back_scan",), BOTH: ()}
"""Scanners of the bags, by the name of the case; both are judged by each alone."""

CALIBRATION_BARS: Final = {"scale": 0.02, "yaw": 1.0}
"""How far the odometry's scale and yaw [deg] found with both scanners may be from those found with
either."""


@dataclass(frozen=True)
class RobustnessOptions:
    """What to run.

    Attributes
    ----------
    data : folder of the recordings.
    out : folder of the record; runs and failed maps go into its folder ``robustness``.
    parts : some of :data:`PARTS`.
    changes, worlds : by name; all if empty.
    seeds : largest number of seeds of a world or a change; 0: as many as the tables say.
    first_seed : of the worlds, and of random changes.
    again : whether runs of this commit are made again.
    relations : folder with NAME.relations of recordings, in the place of their own map's.
    keep : whether logs and maps are kept of runs that are right, too.
    """

    data: Path
    out: Path
    parts: Sequence[str] = PARTS
    changes: Sequence[str] = ()
    worlds: Sequence[str] = ()
    seeds: int = 0
    first_seed: int = 0
    again: bool = False
    relations: Path | None = None
    keep: bool = False

    @property
    def folder(self) -> Path:
        """Where the runs are."""
        return self.out / "robustness"

    def count(self, wanted: int) -> int:
        """Return how many seeds of `wanted` are tried."""
        return min(wanted, self.seeds) if self.seeds else wanted


class Runner:
    """Makes the runs that are not there yet.

    Parameters
    ----------
    options : what to run.
    store : of the runs.
    commit : of the sources.
    progress : called with a line on each run.
    """

    def __init__(
        self,
        options: RobustnessOptions,
        store: RunStore,
        commit: str,
        progress: Callable[[str], None],
    ) -> None:
        self._options, self._store, self._commit = options, store, commit
        self._progress = progress
        self._is_warm = False

    def run(self) -> Iterator[Run]:
        """Yield the runs of all parts as they are made."""
        for part in self._options.parts:
            if part in (WORLDS, HANDICAPPED):
                table = simulated_worlds() if part == WORLDS else handicapped_worlds()
                yield from self._worlds(part, table)
            elif part == SPARSE:
                for name in SPARSE_RECORDINGS:
                    yield self._sparse(name)
                    for seed in range(self._options.count(COPIES.seeds)):
                        yield self._copies(name, seed)
            elif part == SCANNERS:
                for name in BAGS:
                    alone: list[Run] = []
                    for case in TOPICS:
                        alone.append(self._bag(name, case, alone))
                        yield alone[-1]
            else:
                yield from self._recording(part)

    def _recording(self, name: str) -> Iterator[Run]:
        """Yield the runs of the changes of a recording, that of the unchanged one first."""
        wanted = self._options.changes or tuple(CHANGES)
        is_missing = name not in VERIFIED and not self._relations_of(name).exists()
        again = True if is_missing else None
        first = self._changed(name, CHANGES[UNCHANGED], 0, None, again)
        yield first
        for change_name in wanted:
            change = CHANGES[change_name]
            if change_name != UNCHANGED:
                first_seed = self._options.first_seed if change.seeds > 1 else 0
                for seed in range(self._options.count(change.seeds)):
                    try:
                        yield self._changed(name, change, first_seed + seed, first)
                    except NothingLeft as error:
                        self._progress(f"not applied: {error}")

    def _changed(
        self, name: str, change: Change, seed: int, unchanged: Run | None, again: bool | None = None
    ) -> Run:
        """Return the run of a changed recording; `unchanged` is that of the recording itself."""

        def make(log: Path, out: Path) -> Run:
            source = self._given(f"radish/{name}.clf.gz")
            changed_log(source, log, change, seed)
            options = [word for setting in change.settings for word in ("--set", setting)]
            mapped = self._mapped(log, out, options)
            relations = self._relations_of(name)
            if unchanged is None and relations.parent == self._options.folder:
                run_command("evaluate", "make-relations", out, "-o", relations)
            expected = changed_relations(
                read_relations(relations), change, read_carmen(source), seed
            )
            trajectory = mapped.trajectory
            check_relations_left(expected, trajectory.stamps, f"{name}, {change.name}")
            error = evaluate_relations(trajectory, expected, STAMP_TOLERANCE_S)
            figures = mapped.figures() | {
                "error": error.absolute_translational.mean,
                "largest": float(error.translations.max()),
            }
            if name not in VERIFIED:
                figures["bar"] = change.scale * CLOSED_M
            elif unchanged is not None and "error" in unchanged.figures:
                limit = change.scale * MOST_TIMES_UNCHANGED
                figures["bar"] = limit * unchanged.figures["error"]
            words = f"python -m bench.robustness.changes {source} {log} {change.name} {seed}"
            return _finished(mapped, figures, words)

        return self._made(Run(name, change.name, seed), ".clf", make, again)

    def _worlds(self, part: str, table: Mapping[str, SimulatedWorld]) -> Iterator[Run]:
        """Yield the runs of simulated worlds, the first seed of all first."""
        wanted = self._options.worlds
        worlds = [
            world for name, world in table.items() if not wanted or name.split(",")[0] in wanted
        ]
        for seed in range(max((self._options.count(each.seeds) for each in worlds), default=0)):
            for world in worlds:
                if seed < self._options.count(world.seeds):
                    yield self._world(part, world, self._options.first_seed + seed)

    def _world(self, part: str, world: SimulatedWorld, seed: int) -> Run:
        def make(log: Path, out: Path) -> Run:
            truth = log.with_suffix(".tum")
            words: list[str | Path] = ["simulate", *world.options, "--seed", str(seed)]
            words += ["-o", log, "--truth", truth]
            run_command(*words)
            options = [word for setting in world.settings for word in ("--set", setting)]
            mapped = self._mapped(log, out, options)
            figures = mapped.true_figures(truth)
            if math.isfinite(world.bar):
                figures["bar"] = world.bar
            return _finished(mapped, figures, f"cartoloop {' '.join(map(str, words))}")

        return self._made(Run(part, world.name, seed), world.suffix, make)

    def _sparse(self, name: str) -> Run:
        def make(_: Path, out: Path) -> Run:
            mapped = self._mapped(self._given(f"radish-sparse/{name}.clf.gz"), out)
            figures = mapped.figures()
            other = self._options.data / f"radish-sparse/{name}.gmapping.tum"
            if other.exists():
                error = evaluate_trajectory(mapped.trajectory, read_tum(other)).absolute
                rmse = float(np.sqrt(np.mean(error.translation**2)))
                largest = float(error.translation.max())
                figures |= {"error": rmse, "largest": largest, "bar": SPARSE_BAR_M}
            return _finished(mapped, figures)

        return self._made(Run(SPARSE, name, 0), ".log", make)

    def _copies(self, name: str, seed: int) -> Run:
        """Return the run of two copies of a recording; the second one's map is judged."""

        def make(log: Path, out: Path) -> Run:
            source = self._given(f"radish-sparse/{name}.clf.gz")
            changed_log(source, log, COPIES, 2 * seed)
            first = self._mapped(log, out).trajectory
            changed_log(source, log, COPIES, 2 * seed + 1)
            second = self._mapped(log, out)
            error = evaluate_trajectory(second.trajectory, first).absolute
            figures = second.figures() | {
                "error": float(np.sqrt(np.mean(error.translation**2))),
                "largest": float(error.translation.max()),
            }
            return _finished(second, figures)

        return self._made(Run(SPARSE, f"{name}, two noisy copies", seed), ".clf", make)

    def _bag(self, name: str, case: str, alone: Sequence[Run]) -> Run:
        def make(_: Path, out: Path) -> Run:
            options = [word for topic in TOPICS[case] for word in ("--scan-topic", topic)]
            mapped = self._mapped(self._given(f"bags/{name}.bag"), out, options)
            odometry = mapped.report.get("odometry") or {}
            figures = mapped.figures()
            for key, figure, factor in (
                ("translation_scale", "scale", 1.0),
                ("yaw_rad", "yaw", math.degrees(1.0)),
                ("time_offset_s", "offset", 1.0),
            ):
                if odometry.get(key) is not None:
                    figures[figure] = factor * float(odometry[key])
            if case == BOTH:
                figures |= _calibration(figures, alone)
            return _finished(mapped, figures)

        return self._made(Run(SCANNERS, f"{name}, {case}", 0), ".bag", make)

    def _made(
        self,
        run: Run,
        suffix: str,
        make: Callable[[Path, Path], Run],
        again: bool | None = None,
    ) -> Run:
        """Return a run that is there already, or make it; a failure is a run too."""
        known = self._store.find(*run.key)
        if known is not None and not (self._options.again if again is None else again):
            return known
        name = f"{run.case}-{run.seed}".replace(", ", "-")
        folder = self._options.folder / run.part.replace(" ", "-")
        folder.mkdir(parents=True, exist_ok=True)
        log, out = folder / f"{name}{suffix}", folder / name
        try:
            made = make(log, out)
            done = replace(run, commands=made.commands, figures=made.figures, verdict=made.verdict)
        except NothingLeft:
            raise
        except CartoloopError as error:
            done = replace(run, failure=str(error))
        done = replace(done, commit=self._commit)
        self._store.add(done)
        if done.is_right is not False and not self._options.keep:
            for path in (log, log.with_suffix(".tum")):
                path.unlink(missing_ok=True)
            shutil.rmtree(out, ignore_errors=True)
        self._progress(_line(done))
        return done

    def _mapped(self, log: Path, out: Path, options: Sequence[str] = ()) -> OneMap:
        """Map a recording; kernels are compiled before the first: that is no cost of it."""
        if not self._is_warm:
            self._is_warm = True
            self._progress("warming up: compiling kernels where they are not yet")
            run_command("demo", "-o", self._options.folder / "demo")
        return map_log(log, out, options)

    def _relations_of(self, name: str) -> Path:
        """Return where the relations of a recording are, or are to be written."""
        if self._options.relations is not None:
            given = self._options.relations / f"{name}.relations"
            if given.exists():
                return given
        if name in VERIFIED:
            return self._given(f"radish/{VERIFIED[name]}")
        return self._options.folder / f"{name}.{self._commit.split()[0]}.relations"

    def _given(self, name: str) -> Path:
        """Return a file of the data folder."""
        path = self._options.data / name
        if not path.exists():
            raise InputError(f"{name} is not in the data folder")
        return path


def _finished(mapped: OneMap, figures: dict[str, float], *before: str) -> Run:
    return Run("", "", 0, (*before, mapped.command), figures, mapped.verdict)


def _calibration(figures: Mapping[str, float], alone: Sequence[Run]) -> dict[str, float]:
    """Return how far the calibration is outside that of either scanner, as a share of the bar."""
    shares = []
    for name, bar in CALIBRATION_BARS.items():
        known = [one.figures[name] for one in alone if name in one.figures]
        if name not in figures or not known:
            return {}
        outside = max(min(known) - figures[name], figures[name] - max(known), 0.0)
        shares.append(outside / bar)
    return {"calibration": max(shares)}


def _line(run: Run) -> str:
    """Return a line on a run."""
    shown = [f"{run.part}: {run.case}, seed {run.seed}:"]
    if run.failure:
        return f"{shown[0]} FAILED: {run.failure}"
    for name, unit in (
        ("error", " m"),
        ("bar", " m"),
        ("cpu", " s"),
        ("scale", ""),
        ("yaw", " deg"),
    ):
        if name in run.figures:
            shown.append(f"{name} {run.figures[name]:.3f}{unit},")
    shown.append(f"verdict {run.verdict}")
    return " ".join(shown) + ("" if run.is_right is not False else ", WRONG")
