# SPDX-License-Identifier: Apache-2.0
"""The figures that changed since an earlier run of a benchmark by more than the noise."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from bench.record import UNKNOWN_NOISE, Figure, Record, Row, markdown_table


@dataclass(frozen=True, slots=True)
class Change:
    """A figure that changed.

    Attributes
    ----------
    case, figure : which.
    before, after : the figure in the earlier and in the new record.
    is_worse : whether it got worse, better otherwise.
    """

    case: str
    figure: str
    before: Figure
    after: Figure
    is_worse: bool

    @property
    def ratio(self) -> float:
        """The new value divided by the earlier one."""
        return self.after.value / self.before.value if self.before.value else float("inf")


def compare(now: Record, before: Record) -> list[Change]:
    """Return the figures that got better or worse by more than the noise, worse ones first.

    The noise of a figure is the band between the 10 % and 90 % quantiles of its repeats: bands that
    overlap are no change. A figure measured once counts if it changed by a quarter. Where
    the repeats have different inputs, the noise of the median over the inputs counts instead.
    """
    earlier = {_key(row): row for row in before.rows}
    changes: list[Change] = []
    for row in now.rows:
        old = earlier.get(_key(row))
        for name, figure in row.figures.items():
            if old is not None and name in old.figures and figure.better is not None:
                changes += _change(_key(row), name, old.figures[name], figure)
    return sorted(changes, key=lambda change: not change.is_worse)


def gone(now: Record, before: Record) -> list[str]:
    """Return the cases that had figures before and have none now."""
    present = {_key(row) for row in now.rows if row.figures}
    return [_key(row) for row in before.rows if row.figures and _key(row) not in present]


def changes_table(changes: Iterable[Change]) -> str:
    """Return the changes as a Markdown table."""
    return markdown_table(
        ("", "case", "figure", "before", "now", "ratio"),
        [
            (
                "WORSE" if change.is_worse else "better",
                change.case,
                f"{change.figure} [{change.after.unit}]" if change.after.unit else change.figure,
                change.before.text(),
                change.after.text(),
                f"{change.ratio:.2f}",
            )
            for change in changes
        ],
    )


def _key(row: Row) -> str:
    return ", ".join(f"{name} {value}" for name, value in row.case.items())


def _change(case: str, name: str, before: Figure, after: Figure) -> list[Change]:
    """Return the change if there is one."""
    before_low, before_high = _band(before)
    after_low, after_high = _band(after)
    if after_low > before_high:
        return [Change(case, name, before, after, is_worse=after.better == "less")]
    if after_high < before_low:
        return [Change(case, name, before, after, is_worse=after.better == "more")]
    return []


def _band(figure: Figure) -> tuple[float, float]:
    if figure.noise_low is not None and figure.noise_high is not None:
        return figure.noise_low, figure.noise_high
    if figure.low is None or figure.high is None:
        half = abs(figure.value) * UNKNOWN_NOISE / 2
        return figure.value - half, figure.value + half
    return figure.low, figure.high
