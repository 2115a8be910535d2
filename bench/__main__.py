# SPDX-License-Identifier: Apache-2.0
"""``python -m bench``: the command line of the benchmarks."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated

import typer

from bench.commands import accuracy, lasting_maps, live_runs, speed

app = typer.Typer(
    help="Measure accuracy and speed.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


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


_COMMANDS: dict[str, Callable[..., None]] = {
    "paper": accuracy.bench_paper,
    "kernels": speed.bench_kernels,
    "matching": speed.bench_matching,
    "adjustment": speed.bench_adjustment,
    "false-closures": accuracy.bench_false_closures,
    "scaling": speed.bench_scaling,
    "lifelong": lasting_maps.bench_lifelong,
    "live": live_runs.bench_live,
    "viewer": live_runs.bench_viewer,
    "robustness": accuracy.bench_robustness,
    "verdict": accuracy.bench_verdict,
    "localisation": lasting_maps.bench_localisation,
    "kills": lasting_maps.bench_kills,
    "resume": lasting_maps.bench_resume,
    "journal": lasting_maps.bench_journal,
    "page": bench_page,
    "fuzz": live_runs.bench_fuzz,
    "soak": live_runs.bench_soak,
    "sessions": lasting_maps.bench_sessions,
}

for _name, _command in _COMMANDS.items():
    app.command(_name)(_command)


def run(arguments: Sequence[str]) -> int:
    """Run a benchmark and return its exit status, as :func:`cartoloop.cli.main.run` does."""
    from cartoloop.cli import main

    return main.run(arguments, app)


if __name__ == "__main__":
    sys.exit(run(sys.argv[1:]))
