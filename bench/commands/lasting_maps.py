# SPDX-License-Identifier: Apache-2.0
"""Benchmarks of maps that last: localisation in them, sessions, resumed and killed runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bench.commands.shared import (
    AgainstOption,
    DataOption,
    OutOption,
    StrictOption,
    conclude_with_table,
    data_folder,
    earlier_record,
    names_of,
    show_progress,
)


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

    before = earlier_record(against, "lifelong")
    options = lifelong.LifelongOptions(drives, seed, not keep_all, keep)
    record = lifelong.run(options, show_progress)
    conclude_with_table(record, out, before, strict)


def bench_localisation(
    data: DataOption = None,
    out: OutOption = Path("bench-results"),
    scans: Annotated[int, typer.Option(min=2, help="Single scans of each recording.")] = 300,
    drives: Annotated[int, typer.Option(min=1, help="Drives of each recording and world.")] = 40,
    seeds: Annotated[int, typer.Option(min=0, help="Simulated worlds.")] = 5,
    first_seed: Annotated[
        int, typer.Option(min=0, help="First seed of 'strangers' and 'alike'.")
    ] = 0,
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

    before = earlier_record(against, "localisation")
    path = out / "localisation.json"
    kept = read_record(path) if add and path.exists() else None
    parts = tuple(only or (*benchmark.RECORDINGS, *benchmark.PARTS))
    options = benchmark.Options(scans, drives, seeds, hours, parts, first_seed)
    record = benchmark.run(data_folder(data), options, show_progress)
    record = record if kept is None else record.with_rows_of(kept)
    conclude_with_table(record, out, before, strict)


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

    before = earlier_record(against, "kills")
    record = benchmark.run(kills, saving, seed, show_progress)
    conclude_with_table(record, out, before, strict)
    if strict and any(row.figures["faults"].value for row in record.rows):
        raise typer.Exit(1)


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

    before = earlier_record(against, "resume")
    folder = None if quick else data_folder(data)
    record = benchmark.run(
        runs,
        seed=seed,
        data=folder,
        is_quick=quick,
        progress=show_progress,
    )
    conclude_with_table(record, out, before, strict)
    if strict and any(row.figures["faults"].value for row in record.rows):
        raise typer.Exit(1)


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

    before = earlier_record(against, "journal")
    record = journal_cost.run(log, pairs, progress=show_progress, saved_map=saved_map)
    conclude_with_table(record, out, before, strict)


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
    seeds: Annotated[
        int, typer.Option(min=0, help="Buildings with two wings alike, and rings.")
    ] = 100,
    first_seed: Annotated[int, typer.Option(min=0, help="First seed of these.")] = 0,
    relations: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Folder with NAME.relations of recordings without verified ones.",
        ),
    ] = None,
    later: Annotated[
        int,
        typer.Option(min=0, help="Map recordings uncut, begun so often a hundredth later, too."),
    ] = 0,
    again: Annotated[
        bool, typer.Option("--again", help="Measure again what this commit has measured.")
    ] = False,
    against: AgainstOption = None,
    strict: StrictOption = False,
) -> None:
    """Cut recordings into sessions, map each and merge them; merge what must stay apart."""
    from bench import sessions

    before = earlier_record(against, "sessions")
    names = sessions.RECORDINGS if not only else () if only == "none" else names_of(only)
    counts = [int(count) for count in names_of(cuts)]
    wings = range(first_seed, first_seed + seeds)
    chosen = sessions.Chosen(
        data_folder(data), names, counts, strangers, wings, again, relations, later
    )
    record = sessions.run(chosen, out, show_progress)
    conclude_with_table(record, out, before, strict)
