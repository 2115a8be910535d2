# SPDX-License-Identifier: Apache-2.0
"""Benchmarks of parts: their time against the size of the problem and against others."""

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
    conclude_with_table,
    data_folder,
    earlier_record,
    names_of,
    show_progress,
)


def bench_kernels(
    out: OutOption = Path("bench-results"),
    repeat: RepeatOption = 20,
    only: Annotated[str, typer.Option(help="Names of kernels, such as insert,match.")] = "",
    against: AgainstOption = None,
    strict: StrictOption = False,
) -> None:
    """Time each compiled kernel against the size of its problem."""
    from bench import kernels

    before = earlier_record(against, "kernels")
    record = kernels.run(repeat, names_of(only))
    conclude_with_table(record, out, before, strict)


def bench_matching(
    data: DataOption = None,
    out: OutOption = Path("bench-results"),
    repeat: RepeatOption = 5,
    against: AgainstOption = None,
    strict: StrictOption = False,
) -> None:
    """Time branch and bound against exhaustive search and against looser bounds."""
    from bench.matching import benchmark

    before = earlier_record(against, "matching")
    record = benchmark.run(repeat, data_folder(data))
    conclude_with_table(record, out, before, strict)


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

    before = earlier_record(against, "adjustment")
    record = benchmark.run(repeat, data_folder(data), largest)
    conclude_with_table(record, out, before, strict)


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

    before = earlier_record(against, scaling.name_of(again))
    record = scaling.run(times, again=again, repeats=repeat, progress=show_progress)
    conclude_with_table(record, out, before, strict)
