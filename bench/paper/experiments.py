# SPDX-License-Identifier: Apache-2.0
"""The experiments of the paper (section VI) on real and on simulated recordings.

Recordings are mapped by the command line, each run in a process of its own. Its output is evaluated
afterwards, so the mapper has no access to the truth.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from bench.command_runs import run_command
from bench.environment import environment
from bench.paper import figures, pictures
from bench.paper.mapped_log import MappedLog, map_log
from bench.paper.published import published
from bench.record import Case, Record, Row
from cartoloop.errors import CartoloopError, ConfigError, InputError
from cartoloop.evaluation.plot_style import require_matplotlib

SIMULATED: Final = {
    "museum": "section VI-A: a museum of 22,000 m², walked through, no odometry",
    "flat": "section VI-B: a flat and a cheap scanner of 6 m range, no odometry",
    "office": "an office floor, a robot with odometry",
}
"""The simulated recordings."""

VARIANTS: Final = (
    ("mit-csail", "local_slam.use_odometry=false"),
    ("fr079", "local_slam.use_odometry=false"),
    ("intel", "local_slam.use_odometry=false"),
    ("fr079", "sensor.laser_pose=[-0.02,0,0]"),
)
"""Recordings with one parameter that is not the default, to show its effect."""

EXPERIMENTS: Final = ("radish", *SIMULATED, "variants")
"""The experiments to choose from; `radish` are the recordings of tables II to V."""


@dataclass(frozen=True, slots=True)
class PaperOptions:
    """What to run.

    Attributes
    ----------
    data : folder with the recordings in ``radish``.
    out : folder of the report; results and pictures go into its folder ``paper``.
    repeats : number of runs of each recording, for the spread of the times.
    experiments : some of :data:`EXPERIMENTS`.
    logs : recordings of tables II to V; all if empty.
    """

    data: Path
    out: Path
    repeats: int = 3
    experiments: Sequence[str] = EXPERIMENTS
    logs: Sequence[str] = ()


def run(options: PaperOptions, progress: Callable[[str], None]) -> Record:
    """Run the experiments and return their figures; `progress` is called with a line on each step.

    A recording that is missing, or that cannot be mapped, has a row with the reason.

    Raises
    ------
    ConfigError
        An experiment or recording is unknown.
    OutputError
        Matplotlib, for the report, is not installed.
    """
    logs = list(options.logs or published()["logs"])
    for given, known in ((options.experiments, EXPERIMENTS), (logs, published()["logs"])):
        if unknown := [name for name in given if name not in known]:
            raise ConfigError(f"no experiment '{unknown[0]}'; choose from {', '.join(known)}")
    require_matplotlib()
    run = _PaperRun(options, progress)
    progress("warming up: compiling kernels where they are not yet")
    run_command("demo", "-o", run.folder / "demo")
    rows: list[Row] = []
    if "radish" in options.experiments:
        for name in logs:
            case: Case = {"experiment": "performance", "log": name}
            rows += _guarded(case, partial(run.radish, name), progress)
    for name in SIMULATED:
        if name in options.experiments:
            case = {"experiment": "performance", "log": name}
            rows += _guarded(case, partial(run.simulated, name), progress)
    if "variants" in options.experiments:
        for name, setting in VARIANTS:
            if name in logs:
                case = {"experiment": "variants", "log": name, "setting": setting}
                rows += _guarded(case, partial(run.variant, name, setting), progress)
    return Record("paper", tuple(rows), environment())


def _guarded(
    case: Case, experiment: Callable[[], list[Row]], progress: Callable[[str], None]
) -> list[Row]:
    """Return the rows of an experiment, or one with the reason why there are none."""
    try:
        return experiment()
    except CartoloopError as error:
        progress(f"no figures of {case['log']}: {error}")
        return [figures.failed_row(case, str(error))]


class _PaperRun:
    """The experiments with their folder; each method returns the rows of one recording."""

    def __init__(self, options: PaperOptions, progress: Callable[[str], None]) -> None:
        self.folder = options.out / "paper"
        self.folder.mkdir(parents=True, exist_ok=True)
        self._data = options.data / "radish"
        self._repeats = options.repeats
        self._progress = progress

    def radish(self, name: str) -> list[Row]:
        """Tables II to V for a real recording."""
        mapped = map_log(
            [self._given(f"{name}.clf.gz")], self.folder / name, self._repeats, self._progress
        )
        rows = _map_rows(name, mapped)
        try:
            relations = self._given(f"{name}.relations")
        except InputError as error:
            case: Case = {"experiment": "relations", "log": name}
            return [*rows, figures.failed_row(case, str(error))]
        found, after, before = figures.relations_rows(name, mapped.folder, relations)
        pictures.draw_relations_errors(mapped.folder, after, before)
        return [*rows, *found]

    def simulated(self, name: str) -> list[Row]:
        """Tables and errors against the truth for a recording that is simulated first."""
        out = self.folder / name
        log, truth, lines = (
            self.folder / f"{name}.{suffix}" for suffix in ("log", "truth.tum", "lines")
        )
        has_lines = name == "flat"
        self._progress(f"simulating the {name}")
        options: list[str | Path] = ["--lines", lines] if has_lines else []
        simulation = run_command("simulate", name, "-o", log, "--truth", truth, *options)
        mapped = map_log([log], out, self._repeats, self._progress)
        rows = [
            *_map_rows(name, mapped),
            *figures.adjustment_run_rows(name, mapped),
            figures.simulation_row(name, simulation),
        ]
        row, after, before = figures.trajectory_row(name, out, truth)
        pictures.draw_true_errors(out, after, before)
        self._progress(f"evaluating the closures of the {name}")
        rows += [row, figures.true_closures_row(name, out, truth, log)]
        if has_lines:
            found, measured = figures.lines_rows(name, out, lines)
            pictures.draw_measured_lines(out, measured)
            rows += found
        log.unlink()
        return rows

    def variant(self, name: str, setting: str) -> list[Row]:
        """The error of a real recording with a parameter that is not the default."""
        log, relations = self._given(f"{name}.clf.gz"), self._given(f"{name}.relations")
        parameter = setting.partition("=")[0].rpartition(".")[2]
        out = self.folder / f"{name}-{parameter}"
        map_log([log], out, 1, self._progress, [setting])
        case: Case = {"experiment": "variants", "log": name, "setting": setting}
        return [figures.variant_row(case, out, relations)]

    def _given(self, name: str) -> Path:
        """Return a file of the data folder."""
        if not (self._data / name).exists():
            raise InputError(f"radish/{name} is not in the data folder")
        return self._data / name


def _map_rows(name: str, mapped: MappedLog) -> list[Row]:
    """Return the rows of every map, and draw its pictures."""
    pictures.draw_map_pictures(mapped.folder)
    return [
        figures.performance_row(name, mapped),
        figures.closures_row(name, mapped),
        figures.adjustment_row(name, mapped),
        *figures.stages_rows(name, mapped),
    ]
