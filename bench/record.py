# SPDX-License-Identifier: Apache-2.0
"""The result of a benchmark: rows of figures with spread, as JSON and as a Markdown table."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from cartoloop.errors import InputError

Better = Literal["less", "more"] | None
Case = dict[str, str | int | float]

UNKNOWN_NOISE = 0.25
"""Share of its value by which a figure that was measured once must change to count."""

FORMAT = 1
"""Version of the JSON; a reader refuses others."""


@dataclass(frozen=True, slots=True)
class Figure:
    """One measured number.

    Attributes
    ----------
    value : the median of the repeats.
    unit : as printed in the head of its column; empty for counts and ratios.
    low, high : the 10 % and 90 % quantiles of the repeats; None where it was measured once and
        another run would give another value.
    repeats : number of measurements.
    better : which direction is better, None where neither is.
    noise_low, noise_high : band of the value's own noise where `low` and `high` are the spread over
        different inputs; otherwise None.
    """

    value: float
    unit: str = ""
    low: float | None = None
    high: float | None = None
    repeats: int = 1
    better: Better = "less"
    noise_low: float | None = None
    noise_high: float | None = None

    @classmethod
    def of_samples(cls, samples: Sequence[float], unit: str, better: Better = "less") -> Figure:
        """Return the median of repeated measurements, with their spread."""
        low, value, high = np.quantile(np.asarray(samples, dtype=np.float64), (0.1, 0.5, 0.9))
        if len(samples) == 1:
            return cls(float(value), unit, better=better)
        return cls(float(value), unit, float(low), float(high), len(samples), better)

    @classmethod
    def of_inputs(
        cls, samples: Sequence[Sequence[float]], unit: str, better: Better = "less"
    ) -> Figure:
        """Return the median over different inputs, with the spread over them.

        Parameters
        ----------
        samples : repeats of each input, the same number for all; with one repeat the noise is
            unknown and :data:`UNKNOWN_NOISE` is assumed.
        unit, better : as of the figure.
        """
        values = np.asarray(samples, dtype=np.float64)
        low, value, high = np.quantile(np.median(values, axis=1), (0.1, 0.5, 0.9))
        noise_low, noise_high = (
            np.quantile(np.median(values, axis=0), (0.1, 0.9))
            if values.shape[1] > 1
            else value * np.array((1.0 - UNKNOWN_NOISE / 2, 1.0 + UNKNOWN_NOISE / 2))
        )
        return cls(
            float(value), unit, float(low), float(high), values.size, better,
            float(min(noise_low, value)), float(max(noise_high, value)),
        )  # fmt: skip

    @classmethod
    def exact_of_inputs(
        cls, values: Sequence[float], unit: str = "", better: Better = "less"
    ) -> Figure:
        """Return the median of counts over different inputs, which are the same in any repeat."""
        low, value, high = map(float, np.quantile(values, (0.1, 0.5, 0.9)))
        return cls(value, unit, low, high, len(values), better, value, value)

    @classmethod
    def exact(cls, value: float, unit: str = "", better: Better = "less") -> Figure:
        """Return a number that is the same in any repeat, to the last bit: errors and counts."""
        return cls(float(value), unit, float(value), float(value), better=better)

    def text(self) -> str:
        """Return the number as a table shows it: the median, and half of the spread."""
        shown = format_number(self.value)
        if self.low is None or self.high is None or self.low == self.high:
            return shown
        return f"{shown} ± {format_number((self.high - self.low) / 2, digits=2)}"


_MEASURED_AT = "measured at"
"""What the note of a row that was measured at another commit begins with."""


@dataclass(frozen=True, slots=True)
class Row:
    """The figures of one case.

    Attributes
    ----------
    case : what was measured; no two rows of a benchmark have the same.
    figures : the numbers by name.
    notes : remarks for the reader: missing data, a program that is not installed.
    """

    case: Case
    figures: dict[str, Figure] = field(default_factory=dict)
    notes: str = ""

    def measured_at(self, commit: str) -> Row:
        """Return the row with the commit in its notes, unless they name an earlier one."""
        if _MEASURED_AT in self.notes:
            return self
        note = f"{_MEASURED_AT} {commit}"
        return replace(self, notes=f"{self.notes}; {note}" if self.notes else note)


@dataclass(frozen=True, slots=True)
class Record:
    """All rows of a benchmark, and the environment of the measurement.

    Attributes
    ----------
    benchmark : its name.
    rows : in the order of the table.
    environment : machine, versions, date and commit, by name.
    """

    benchmark: str
    rows: tuple[Row, ...]
    environment: dict[str, str] = field(default_factory=dict)

    @property
    def is_complete(self) -> bool:
        """Whether every row has a figure, so that nothing was missing."""
        return all(row.figures for row in self.rows)

    def with_rows_of(self, before: Record) -> Record:
        """Return this record with the rows of an earlier one whose cases it does not have.

        Rows of another commit say so in their notes. Rows of one value of the first case, such as a
        part of the benchmark, stand together.
        """
        cases = [row.case for row in self.rows]
        commit = before.environment.get("commit", "unknown")
        kept = [row for row in before.rows if row.case not in cases]
        if commit != self.environment.get("commit"):
            kept = [row.measured_at(commit) for row in kept]
        rows = [*kept, *self.rows]
        firsts = list(dict.fromkeys(next(iter(row.case.values()), "") for row in rows))
        rows.sort(key=lambda row: firsts.index(next(iter(row.case.values()), "")))
        return replace(self, rows=tuple(rows))

    def to_json(self) -> str:
        """Return the record as text that :meth:`from_json` reads."""
        return json.dumps({"format": FORMAT, **asdict(self)}, indent=1, allow_nan=False) + "\n"

    @classmethod
    def from_json(cls, text: str, where: str = "record") -> Record:
        """Return the record in the text of a JSON file.

        Parameters
        ----------
        text : what :meth:`to_json` returned.
        where : name of the file, for the message.

        Raises
        ------
        InputError
            The text is not a record, or one of another version.
        """
        try:
            found: dict[str, Any] = json.loads(text)
            if found["format"] != FORMAT:
                raise InputError(
                    f"{where}: is a record of format {found['format']}, this program reads "
                    f"{FORMAT}; run the benchmark again"
                )
            rows = tuple(
                Row(
                    row["case"],
                    {name: Figure(**figure) for name, figure in row["figures"].items()},
                    row["notes"],
                )
                for row in found["rows"]
            )
            return cls(found["benchmark"], rows, found["environment"])
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise InputError(
                f"{where}: is not a record of a benchmark ({error}); give a file that "
                "'python -m bench' wrote"
            ) from error

    def to_table(self) -> str:
        """Return the rows as a Markdown table: cases, then figures, then notes where there are."""
        cases = list(dict.fromkeys(name for row in self.rows for name in row.case))
        units = {name: figure.unit for row in self.rows for name, figure in row.figures.items()}
        heads = [f"{name} [{unit}]" if unit else name for name, unit in units.items()]
        lines = [
            [
                *(str(row.case.get(name, "")) for name in cases),
                *(row.figures[name].text() if name in row.figures else "" for name in units),
                row.notes,
            ]
            for row in self.rows
        ]
        heads = [*cases, *heads, "notes"]
        if not any(row.notes for row in self.rows):
            heads, lines = heads[:-1], [line[:-1] for line in lines]
        return markdown_table(heads, lines)


def read_record(path: Path) -> Record:
    """Return the record in a JSON file.

    Raises
    ------
    InputError
        It cannot be read, or is not a record.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not a text file; give a JSON of 'python -m bench'") from error
    return Record.from_json(text, str(path))


def markdown_table(heads: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table, its columns padded so that it can be read as plain text too."""
    cells = [[cell.replace("|", "\\|") for cell in line] for line in (heads, *lines)]
    widths = [max(3, *(len(line[column]) for line in cells)) for column in range(len(heads))]
    rule = ["-" * width for width in widths]
    return "\n".join(
        "| "
        + " | ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True))
        + " |"
        for line in (cells[0], rule, *cells[1:])
    )


def format_number(value: float, digits: int = 3) -> str:
    """Return a number with `digits` significant digits, thousands grouped."""
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g}"
    if value == round(value) and abs(value) < 1e15:
        return f"{round(value):,}"
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    return f"{value:,.{decimals}f}"
