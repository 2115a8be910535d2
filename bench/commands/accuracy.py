# SPDX-License-Identifier: Apache-2.0
"""Benchmarks of finished maps: accuracy, robustness, verdict."""

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
    show_progress,
)


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
    before = earlier_record(against, "paper")
    options = experiments.PaperOptions(
        data=data_folder(data),
        out=out,
        repeats=repeat,
        experiments=names_of(only) or experiments.EXPERIMENTS,
        logs=names_of(logs),
    )
    record = experiments.run(options, show_progress)
    parts = sections(record, out / "paper")
    title = page_text()["paper"]["title"]
    write_file(out / "paper.md", to_markdown(title, parts))
    typer.echo(to_markdown(title, sections(record)))
    conclude(record, out, before, strict)


def bench_false_closures(
    out: OutOption = Path("bench-results"),
    seeds: Annotated[int, typer.Option(min=1, help="Graphs of each kind.")] = 10,
    against: AgainstOption = None,
    strict: StrictOption = False,
) -> None:
    """Adjust graphs in which up to half of the loop closures are false, with every loss."""
    from bench.adjustment import false_closures

    before = earlier_record(against, "false-closures")
    record = false_closures.run(seeds)
    conclude_with_table(record, out, before, strict)


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
    first_seed: Annotated[
        int, typer.Option(min=0, help="First seed of worlds and of random changes.")
    ] = 0,
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

    before = earlier_record(against, "robustness")
    options = parts.RobustnessOptions(
        data=data_folder(data),
        out=out,
        parts=benchmark.parts_named(names_of(only)),
        changes=names_of(changes),
        worlds=names_of(worlds),
        seeds=seeds,
        first_seed=first_seed,
        again=again,
        relations=relations,
        keep=keep,
    )
    record = benchmark.run(options, show_progress)
    conclude_with_table(record, out, before, strict)


def bench_verdict(
    out: OutOption = Path("bench-results"),
    maps: Annotated[int, typer.Option(min=1, help="Number of simulated maps, at least.")] = 300,
    first_seed: Annotated[int, typer.Option(min=0, help="First seed of the worlds.")] = 500,
    against: AgainstOption = None,
    strict: StrictOption = False,
) -> None:
    """Count how often maps with known truth are rightly called good, doubtful or wrong."""
    from bench.verdict import benchmark

    before = earlier_record(against, "verdict")
    record = benchmark.run(maps, show_progress, first_seed)
    conclude_with_table(record, out, before, strict)
