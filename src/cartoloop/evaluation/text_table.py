# SPDX-License-Identifier: Apache-2.0
"""Reading text files of numbers with one record a line."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.errors import InputError
from cartoloop.input_file import read_text_input

MAX_BYTES = 128 << 20
"""A million poses or relations [bytes]."""


def read_text_lines(path: str | PathLike[str], expected: str) -> list[str]:
    """Return the lines of a text file.

    Parameters
    ----------
    path : the file.
    expected : what should be in it, for the message.

    Raises
    ------
    InputError
        It cannot be read, is no text, or is longer than `MAX_BYTES`.
    """
    return read_text_input(path, MAX_BYTES, expected).splitlines()


def read_table(
    path: str | PathLike[str], layout: str, num_optional: int = 0
) -> tuple[FloatArray, tuple[str, ...]]:
    """Return the numbers in a text file, and where each row stands, ``file:line``.

    What follows a ``#`` is a comment; lines without numbers are passed over.

    Parameters
    ----------
    path : the file.
    layout : names of the columns, separated by blanks.
    num_optional : number of last columns that may be missing in a line, and are NaN there.

    Returns
    -------
    float64 (lines, columns), and the place of each line.

    Raises
    ------
    InputError
        The file cannot be read, holds no line, or a line is not one finite number a column.
    """
    expected = f"lines of '{layout}'"
    rows: list[list[float]] = []
    places: list[str] = []
    num_columns = len(layout.split())
    counts = range(num_columns - num_optional, num_columns + 1)
    for number, line in enumerate(read_text_lines(path, expected), start=1):
        content = line.partition("#")[0].strip()
        if content:
            places.append(f"{path}:{number}")
            numbers = _parse_numbers(content, places[-1], layout, counts)
            rows.append([*numbers, *[np.nan] * (num_columns - len(numbers))])
    if not rows:
        raise InputError(f"{path}: is empty; expected {expected}")
    return np.array(rows, dtype=np.float64), tuple(places)


def _parse_numbers(content: str, place: str, layout: str, counts: Sequence[int]) -> list[float]:
    try:
        numbers = [float(token) for token in content.split()]
    except ValueError:
        numbers = []
    if len(numbers) not in counts or not np.all(np.isfinite(numbers)):
        raise InputError(
            f"{place}: expected {' or '.join(map(str, counts))} numbers '{layout}', "
            f"found '{content[:60]}'"
        )
    return numbers
