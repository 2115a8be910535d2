# SPDX-License-Identifier: Apache-2.0
"""``python -m bench``: the command line of the benchmarks."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from bench.record import Record

app = typer.Typer(
    help="Measure accuracy and speed.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

DataOption = Annotated[
    Path | None,
    typer.Option("--data", metavar="DIR", help="Folder with the recordings; else $CARTOLOOP_DATA."),
]
OutOption = Annotated[
    Path, typer.Option("-o", "--out", metavar="DIR", help="Folder for figures and reports.")
]
RepeatOption = Annotated[
    int, typer.Option("--repeat", min=1, help="Number of repeats of each measurement.")
]
AgainstOption = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="An earlier JSON to compare with."),
]
StrictOption = Annotated[
    bool, typer.Option("--strict", help="Fail where data is missing or a figure got worse.")
]


@app.command("paper")
def bench_paper(
    data: DataOption = None,
    out: OutOption = Path("bench-results"),
    repeat: RepeatOption = 3,
    only: Annotated[
        str, typer.Option(help="Experiments: radish, museum, flat, office, variants.")
    ] = "",
    logs: Annotated[
        str, typer.Option("--logs", help="Recordings of tables II to V, such as intel,fr079.")
    ] = "",
    against: AgainstOption = None,
    strict: StrictOption = False,
) -> None:
    """Run the experiments of the paper: its tables, our figures, maps and histograms."""
    from bench.document import to_markdown
    from bench.page_text import page_text
    from bench.paper import experiments
    from bench.paper.report import sections
    from cartoloop.map_output.output_folder import prepare_folder
    from cartoloop.map_output.save import write_file

    prepare_folder(out)
    before = _earlier(against, "paper")
    options = experiments.PaperOptions(
        data=_data_folder(data),
        out=out,
        repeats=repeat,
        experiments=_names(only) or experiments.EXPERIMENTS,
        logs=_names(logs),
    )
    record = experiments.run(options, lambda line: typer.echo(line, err=True))
    parts = sections(record, out / "paper")
    title = page_text()["paper"]["title"]
    write_file(out / "paper.md", to_markdown(title, parts))
    typer.echo(to_markdown(title, sections(record)))
    _conclude(record, out, before, strict)


@app.command("kernels")
def bench_kernels(
    out: OutOption = Path("bench-results"),
    repeat: RepeatOption = 20,
    only: Annotated[str, typer.Option(help="Names of kernels, such as insert,match.")] = "",
    against: AgainstOption = None,
    strict: StrictOption = False,
) -> None:
    """Time each compiled kernel against the size of its problem."""
    from bench import kernels

    before = _earlier(against, "kernels")
    record = kernels.run(repeat, _names(only))
    _print_table(record)
    _conclude(record, out, before, strict)


@app.command("matching")
def bench_matching(
    data: DataOption = None,
    out: OutOption = Path("bench-results"),
    repeat: RepeatOption = 5,
    against: AgainstOption = None,
    strict: StrictOption = False,
) -> None:
    """Time branch and bound against exhaustive search and against looser bounds."""
    from bench.matching import benchmark

    before = _earlier(against, "matching")
    record = benchmark.run(repeat, _data_folder(data))
    _print_table(record)
    _conclude(record, out, before, strict)


@app.command("adjustment")
def bench_adjustment(
    data: DataOption = None,
    out: OutOption = Path("bench-results"),
    repeat: RepeatOption = 7,
    largest: Annotated[int, typer.Option(min=1000, help="Nodes of the largest graph.")] = 100_000,
    against: AgainstOption = None,
    strict: StrictOption = False,
) -> None:
    """Time the pose adjustment against GTSAM, Ceres and g2o on the same graphs."""
    from bench.adjustment import benchmark

    before = _earlier(against, "adjustment")
    record = benchmark.run(repeat, _data_folder(data), largest)
    _print_table(record)
    _conclude(record, out, before, strict)


@app.command("false-closures")
def bench_false_closures(
    out: OutOption = Path("bench-results"),
    seeds: Annotated[int, typer.Option(min=1, help="Graphs of each kind.")] = 10,
    against: AgainstOption = None,
    strict: StrictOption = False,
) -> None:
    """Adjust graphs in which up to half of the loop closures are false, with every loss."""
    from bench.adjustment import false_closures

    before = _earlier(against, "false-closures")
    record = false_closures.run(seeds)
    _print_table(record)
    _conclude(record, out, before, strict)


@app.command("scaling")
def bench_scaling(
    out: OutOption = Path("bench-results"),
    times: Annotated[int, typer.Option(min=1, help="Length of the run, in museums.")] = 10,
    again: Annotated[
        bool, typer.Option("--again", help="Walk through one museum again and again.")
    ] = False,
    repeat: RepeatOption = 1,
    against: AgainstOption = None,
    strict: StrictOption = False,
) -> None:
    """Measure time per node and memory as a run grows to many times the museum."""
    from bench import scaling

    before = _earlier(against, scaling.name_of(again))
    record = scaling.run(
        times, again=again, repeats=repeat, progress=lambda line: typer.echo(line, err=True)
    )
    _print_table(record)
    _conclude(record, out, before, strict)


@app.command("lifelong")
def bench_lifelong(
    out: OutOption = Path("bench-results"),
    drives: Annotated[int, typer.Option(min=2, help="Drives through the building.")] = 20,
    seed: Annotated[int, typer.Option(min=0, help="Of the building and all noise.")] = 0,
    keep_all: Annotated[
        bool, typer.Option("--keep-all", help="Without --lifelong, to compare.")
    ] = False,
    keep: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Recordings and maps stay there, and are not made again."),
    ] = None,
    against: AgainstOption = None,
    strict: StrictOption = False,
) -> None:
    """Drive through one building again and again, with furniture moved: how the map grows."""
    from bench import lifelong

    before = _earlier(against, "lifelong")
    options = lifelong.LifelongOptions(drives, seed, not keep_all, keep)
    record = lifelong.run(options, lambda line: typer.echo(line, err=True))
    _print_table(record)
    _conclude(record, out, before, strict)


@app.command("live")
def bench_live(
    log: Annotated[
        Path | None, typer.Argument(metavar="LOG", help="A recording instead of the museum.")
    ] = None,
    out: OutOption = Path("bench-results"),
    paces: Annotated[str, typer.Option(help="Multiples of real time, in turn.")] = "1,4",
    seconds: Annotated[float, typer.Option(min=1.0, help="Duration of each [s].")] = 60.0,
    repeat: RepeatOption = 1,
    against: AgainstOption = None,
    strict: StrictOption = False,
) -> None:
    """Measure the latency of each pose when scans arrive as from a robot."""
    from bench import live

    try:
        numbers = [float(pace) for pace in _names(paces)]
    except ValueError:
        raise typer.BadParameter("give numbers such as 1,4", param_hint="--paces") from None
    if not numbers or min(numbers) <= 0.0:
        raise typer.BadParameter("give numbers above 0", param_hint="--paces")
    before = _earlier(against, "live")
    record = live.run(
        numbers, seconds, log=log, progress=lambda line: typer.echo(line, err=True), repeats=repeat
    )
    _print_table(record)
    _conclude(record, out, before, strict)


@app.command("viewer")
def bench_viewer(
    log: Annotated[
        Path | None, typer.Argument(metavar="LOG", help="A recording instead of the museum.")
    ] = None,
    out: OutOption = Path("bench-results"),
    scans: Annotated[
        int, typer.Option(min=0, help="Number of scans to map; 0: the whole recording.")
    ] = 0,
    watched_scans: Annotated[
        int, typer.Option(min=1, help="Number of scans during which loop closures are watched for.")
    ] = 5000,
    pace: Annotated[
        float, typer.Option(min=0.1, max=1000.0, help="Multiple of real time of these scans.")
    ] = 8.0,
    repeat: RepeatOption = 3,
    against: AgainstOption = None,
    strict: StrictOption = False,
) -> None:
    """Measure the cost of the live view, its latency and its frame rate.

    With --strict it also fails where a figure misses its target.
    """
    from bench.view import benchmark

    before = _earlier(against, "viewer")
    options = benchmark.ViewOptions(log, scans, pace, watched_scans, repeat)
    record = benchmark.run(options, lambda line: typer.echo(line, err=True))
    _print_table(record)
    missed = benchmark.misses(record)
    for line in missed:
        typer.echo(f"missed         {line}")
    _conclude(record, out, before, strict)
    if strict and missed:
        raise typer.Exit(1)


@app.command("robustness")
def bench_robustness(
    data: DataOption = None,
    out: OutOption = Path("bench-results"),
    only: Annotated[
        str,
        typer.Option(
            help="Parts by words of their names, such as killian,worlds: recordings, worlds, "
            "'sparse recordings', 'two scanners'."
        ),
    ] = "",
    changes: Annotated[
        str, typer.Option(help="Changes of recordings, such as drop50,mirror.")
    ] = "",
    worlds: Annotated[str, typer.Option(help="Simulated worlds, such as hall,wings.")] = "",
    seeds: Annotated[
        int, typer.Option(min=0, help="Largest number of seeds; 0: as many as the tables say.")
    ] = 0,
    first_seed: Annotated[int, typer.Option(min=0, help="First seed of the worlds.")] = 0,
    again: Annotated[
        bool, typer.Option("--again", help="Make runs again that this commit has made.")
    ] = False,
    relations: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Folder with NAME.relations of recordings, instead of those of their own maps.",
        ),
    ] = None,
    keep: Annotated[
        bool, typer.Option("--keep", help="Keep logs and maps of right runs, too.")
    ] = False,
    against: AgainstOption = None,
    strict: StrictOption = False,
) -> None:
    """Map changed recordings and difficult worlds: which maps are right, and which say so.

    It goes on where it was interrupted: runs that this commit has made are not made again.
    """
    from bench.robustness import benchmark, parts

    before = _earlier(against, "robustness")
    options = parts.RobustnessOptions(
        data=_data_folder(data),
        out=out,
        parts=benchmark.parts_named(_names(only)),
        changes=_names(changes),
        worlds=_names(worlds),
        seeds=seeds,
        first_seed=first_seed,
        again=again,
        relations=relations,
        keep=keep,
    )
    record = benchmark.run(options, lambda line: typer.echo(line, err=True))
    _print_table(record)
    _conclude(record, out, before, strict)


@app.command("verdict")
def bench_verdict(
    out: OutOption = Path("bench-results"),
    maps: Annotated[int, typer.Option(min=1, help="Number of simulated maps, at least.")] = 300,
    first_seed: Annotated[int, typer.Option(min=0, help="First seed of the worlds.")] = 500,
    against: AgainstOption = None,
    strict: StrictOption = False,
) -> None:
    """Count how often maps with known truth are rightly called good, doubtful or wrong."""
    from bench.verdict import benchmark

    before = _earlier(against, "verdict")
    record = benchmark.run(maps, lambda line: typer.echo(line, err=True), first_seed)
    _print_table(record)
    _conclude(record, out, before, strict)


@app.command("localisation")
def bench_localisation(
    data: DataOption = None,
    out: OutOption = Path("bench-results"),
    scans: Annotated[int, typer.Option(min=2, help="Single scans of each recording.")] = 300,
    drives: Annotated[int, typer.Option(min=1, help="Drives of each recording and world.")] = 40,
    seeds: Annotated[int, typer.Option(min=0, help="Simulated worlds.")] = 5,
    first_seed: Annotated[int, typer.Option(min=0, help="First seed of 'strangers'.")] = 0,
    hours: Annotated[float, typer.Option(min=0.0, help="Of one drive again and again.")] = 10.0,
    only: Annotated[
        list[str] | None,
        typer.Option(
            "--only",
            help="Recording, or 'worlds', 'strangers', 'changes', 'alike', 'times' or 'long';"
            " may be repeated.",
        ),
    ] = None,
    add: Annotated[
        bool, typer.Option("--add", help="Keep the rows of the record that are not measured now.")
    ] = False,
    against: AgainstOption = None,
    strict: StrictOption = False,
) -> None:
    """Localise in maps that other scans made: time, success, errors, and a particle filter."""
    from bench.localisation import benchmark
    from bench.record import read_record

    before = _earlier(against, "localisation")
    path = out / "localisation.json"
    kept = read_record(path) if add and path.exists() else None
    parts = tuple(only or (*benchmark.RECORDINGS, *benchmark.PARTS))
    options = benchmark.Options(scans, drives, seeds, hours, parts, first_seed)
    record = benchmark.run(_data_folder(data), options, lambda line: typer.echo(line, err=True))
    record = record if kept is None else record.with_rows_of(kept)
    _print_table(record)
    _conclude(record, out, before, strict)


@app.command("kills")
def bench_kills(
    out: OutOption = Path("bench-results"),
    kills: Annotated[int, typer.Option(min=1, help="Number of runs that are killed.")] = 200,
    saving: Annotated[int, typer.Option(min=0, help="Number of these while saving.")] = 60,
    seed: Annotated[int, typer.Option(min=0, help="Seed of moments and signals.")] = 0,
    against: AgainstOption = None,
    strict: StrictOption = False,
) -> None:
    """Kill runs at random moments, and count those that leave a map that is not whole.

    With --strict it also fails if there is one.
    """
    from bench import kills as benchmark

    before = _earlier(against, "kills")
    record = benchmark.run(kills, saving, seed, lambda line: typer.echo(line, err=True))
    _print_table(record)
    _conclude(record, out, before, strict)
    if strict and any(row.figures["faults"].value for row in record.rows):
        raise typer.Exit(1)


@app.command("resume")
def bench_resume(
    data: DataOption = None,
    out: OutOption = Path("bench-results"),
    runs: Annotated[int, typer.Option(min=1, help="Number of runs that are killed.")] = 200,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the moments.")] = 0,
    quick: Annotated[bool, typer.Option("--quick", help="Runs of a short drive alone.")] = False,
    against: AgainstOption = None,
    strict: StrictOption = False,
) -> None:
    """Kill runs at random moments, open what is left, resume them, and compare the bytes.

    With --strict it also fails if a file does not open, or if a resumed run ends in other bytes.
    """
    from bench import resume as benchmark

    before = _earlier(against, "resume")
    folder = None if quick else _data_folder(data)
    record = benchmark.run(
        runs,
        seed=seed,
        data=folder,
        is_quick=quick,
        progress=lambda line: typer.echo(line, err=True),
    )
    _print_table(record)
    _conclude(record, out, before, strict)
    if strict and any(row.figures["faults"].value for row in record.rows):
        raise typer.Exit(1)


@app.command("journal")
def bench_journal(
    log: Annotated[
        Path | None, typer.Option("--log", help="A recording instead of the museum.")
    ] = None,
    out: OutOption = Path("bench-results"),
    pairs: Annotated[int, typer.Option(min=1, help="Runs with and without a journal.")] = 3,
    saved_map: Annotated[
        Path | None, typer.Option("--map", help="Only load this map, and show it.")
    ] = None,
    against: AgainstOption = None,
    strict: StrictOption = False,
) -> None:
    """Measure what the journal of a run costs, and how long its map takes to load."""
    from bench import journal_cost

    before = _earlier(against, "journal")
    record = journal_cost.run(
        log, pairs, progress=lambda line: typer.echo(line, err=True), saved_map=saved_map
    )
    _print_table(record)
    _conclude(record, out, before, strict)


@app.command("page")
def bench_page(
    records: Annotated[
        Path, typer.Argument(metavar="DIR", help="Folder that the benchmarks wrote into.")
    ] = Path("bench-results"),
    out: Annotated[
        Path, typer.Option("-o", "--out", metavar="FILE", help="The page, in Markdown.")
    ] = Path("docs/results.md"),
) -> None:
    """Write one page of all figures, with pictures of the maps."""
    from bench.results_page import write_results_page

    write_results_page(records, out)
    typer.echo(f"{out}")


@app.command("fuzz")
def bench_fuzz(
    inputs: Annotated[int, typer.Option(min=1, help="Number of inputs.")] = 20_000,
    seed: Annotated[int, typer.Option(help="Of the changes: the same seed, the same inputs.")] = 0,
    first: Annotated[int, typer.Option(min=0, help="Number of the first input.")] = 0,
    processes: Annotated[int, typer.Option(min=1, help="Processes at a time.")] = 2,
    only: Annotated[str, typer.Option(help="The one kind of input, such as 'map rows'.")] = "",
    data: DataOption = None,
    out: OutOption = Path("bench-results"),
    against: AgainstOption = None,
    strict: StrictOption = False,
) -> None:
    """Change inputs of all kinds; each must be used, or refused with a stated error, in 10 s."""
    from bench.fuzz.run import FuzzOptions, run_all

    before, folder, failed = _earlier(against, "fuzz"), _data_folder(data), out / "fuzz"
    options = FuzzOptions(
        seed=seed,
        first=first,
        count=inputs,
        num_processes=processes,
        out=failed,
        data=folder if folder.is_dir() else None,
        only=only,
    )
    results = run_all(options, lambda line: typer.echo(line, err=True))
    typer.echo(results.table())
    _conclude(results.record(), out, before, strict)
    if results.failures or results.total < inputs:
        typer.echo(f"inputs that failed are in {failed}")
        raise typer.Exit(1)


@app.command("soak")
def bench_soak(
    hours: Annotated[float, typer.Option(min=0.01, help="Length of the robot's day [h].")] = 8.0,
    faults: Annotated[int, typer.Option(min=0, help="Number of faults.")] = 500,
    sources: Annotated[str, typer.Option(help="Sources: tcp, ws, dds.")] = "tcp,ws",
    seed: Annotated[int, typer.Option(help="Of the faults.")] = 0,
    drives_again: Annotated[
        bool,
        typer.Option(
            "--drives-again/--drives-once",
            help="Drive each half hour, or once and stand then: the map does not grow.",
        ),
    ] = True,
    out: OutOption = Path("bench-results"),
    against: AgainstOption = None,
    strict: StrictOption = False,
) -> None:
    """Map a robot for hours, in compressed time, while connections, clocks and disk fail."""
    from bench.soak.run import record_of, soak

    before = _earlier(against, "soak")
    results = {}
    for kind in _names(sources):
        folder = out / "soak" / kind
        results[kind] = soak(kind, hours, faults, folder, seed, drives_again=drives_again)
        typer.echo(f"source         {kind}\n{results[kind].table()}\n")
    record = record_of(results, hours, drives_again=drives_again)
    _conclude(record, out, before, strict)
    if any(result.unaccounted for result in results.values()):
        raise typer.Exit(1)


@app.command("sessions")
def bench_sessions(
    data: DataOption = None,
    out: OutOption = Path("bench-results"),
    only: Annotated[
        str, typer.Option(help="Recordings: intel, mit-killian, mit-csail, fr079, aces, museum.")
    ] = "",
    cuts: Annotated[
        str, typer.Option(help="Into how many sessions, such as 2,5,10; none if empty.")
    ] = "2,5,10",
    strangers: Annotated[
        bool, typer.Option(help="Merge recordings of different places too.")
    ] = True,
    seeds: Annotated[int, typer.Option(min=0, help="Buildings with two wings alike.")] = 100,
    first_seed: Annotated[int, typer.Option(min=0, help="First seed of these.")] = 0,
    relations: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Folder with NAME.relations of recordings without verified ones.",
        ),
    ] = None,
    again: Annotated[
        bool, typer.Option("--again", help="Measure again what this commit has measured.")
    ] = False,
    against: AgainstOption = None,
    strict: StrictOption = False,
) -> None:
    """Cut recordings into sessions, map each and merge them; merge what must stay apart."""
    from bench import sessions

    before = _earlier(against, "sessions")
    names = sessions.RECORDINGS if not only else () if only == "none" else _names(only)
    counts = [int(count) for count in _names(cuts)]
    wings = range(first_seed, first_seed + seeds)
    chosen = sessions.Chosen(_data_folder(data), names, counts, strangers, wings, again, relations)
    record = sessions.run(chosen, out, lambda line: typer.echo(line, err=True))
    _print_table(record)
    _conclude(record, out, before, strict)


def _data_folder(given: Path | None) -> Path:
    return given or Path(os.environ.get("CARTOLOOP_DATA", "../shared/data"))


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]


def _earlier(path: Path | None, benchmark: str) -> Record | None:
    """Return the record to compare with; read first, because the new one may replace it."""
    if path is None:
        return None
    from bench.record import read_record
    from cartoloop.errors import InputError

    found = read_record(path)
    if found.benchmark != benchmark:
        raise InputError(
            f"{path}: is a record of '{found.benchmark}', which '{benchmark}' cannot be compared "
            "with; give one of the same benchmark"
        )
    return found


def _print_table(record: Record) -> None:
    typer.echo(", ".join(f"{name} {value}" for name, value in record.environment.items()))
    typer.echo(f"\n{record.to_table()}\n")


def _conclude(record: Record, out: Path, before: Record | None, strict: bool) -> None:
    """Write the record, report what changed, and fail if `strict` is set and a figure got worse."""
    from bench.comparison import changes_table, compare, gone
    from cartoloop.map_output.output_folder import prepare_folder
    from cartoloop.map_output.save import write_file

    path = prepare_folder(out) / f"{record.benchmark}.json"
    write_file(path, record.to_json())
    typer.echo(f"figures        {path}")
    changes = [] if before is None else compare(record, before)
    lost = [] if before is None else gone(record, before)
    if before is not None:
        machines = [found.environment.get("processor", "unknown") for found in (before, record)]
        if machines[0] != machines[1]:
            typer.echo(f"measured on another machine: {machines[0]}, now {machines[1]}", err=True)
        typer.echo(f"\n{changes_table(changes)}" if changes else "nothing changed beyond the noise")
    for case in lost:
        typer.echo(f"no figures any more: {case}", err=True)
    is_worse = bool(lost) or any(change.is_worse for change in changes)
    if strict and (is_worse or not record.is_complete):
        raise typer.Exit(1)


def run(arguments: Sequence[str]) -> int:
    """Run a benchmark and return its exit status, as :func:`cartoloop.cli.main.run` does."""
    from cartoloop.cli import main

    return main.run(arguments, app)


if __name__ == "__main__":
    sys.exit(run(sys.argv[1:]))
