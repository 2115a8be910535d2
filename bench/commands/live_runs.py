# SPDX-License-Identifier: Apache-2.0
"""Benchmarks of live runs and of what users send: view, fuzzed input, hours of faults."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bench.commands.shared import (
    AgainstOption,
    DataOption,
    OutOption,
    RepeatOption,
    StrictOption,
    conclude,
    conclude_with_table,
    data_folder,
    earlier_record,
    names_of,
    print_table,
    show_progress,
)


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
        numbers = [float(pace) for pace in names_of(paces)]
    except ValueError:
        raise typer.BadParameter("give numbers such as 1,4", param_hint="--paces") from None
    if not numbers or min(numbers) <= 0.0:
        raise typer.BadParameter("give numbers above 0", param_hint="--paces")
    before = earlier_record(against, "live")
    record = live.run(numbers, seconds, log=log, progress=show_progress, repeats=repeat)
    conclude_with_table(record, out, before, strict)


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

    before = earlier_record(against, "viewer")
    options = benchmark.ViewOptions(log, scans, pace, watched_scans, repeat)
    record = benchmark.run(options, show_progress)
    print_table(record)
    missed = benchmark.misses(record)
    for line in missed:
        typer.echo(f"missed         {line}")
    conclude(record, out, before, strict)
    if strict and missed:
        raise typer.Exit(1)


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

    before, folder, failed = earlier_record(against, "fuzz"), data_folder(data), out / "fuzz"
    options = FuzzOptions(
        seed=seed,
        first=first,
        count=inputs,
        num_processes=processes,
        out=failed,
        data=folder if folder.is_dir() else None,
        only=only,
    )
    results = run_all(options, show_progress)
    typer.echo(results.table())
    conclude(results.record(), out, before, strict)
    if results.failures or results.total < inputs:
        typer.echo(f"inputs that failed are in {failed}")
        raise typer.Exit(1)


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

    before = earlier_record(against, "soak")
    results = {}
    for kind in names_of(sources):
        folder = out / "soak" / kind
        results[kind] = soak(kind, hours, faults, folder, seed, drives_again=drives_again)
        typer.echo(f"source         {kind}\n{results[kind].table()}\n")
    record = record_of(results, hours, drives_again=drives_again)
    conclude(record, out, before, strict)
    if any(result.unaccounted for result in results.values()):
        raise typer.Exit(1)
