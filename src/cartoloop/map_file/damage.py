# SPDX-License-Identifier: Apache-2.0
"""Damaged content of a file, reported in one line."""

from __future__ import annotations

import sqlite3
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from cartoloop.errors import InputError

_FREE_CELLS, _CELLS_PER_BYTE = 2**24, 100  # of all submaps: a map is compressed to a twentieth


@contextmanager
def damage_reported(file: Path) -> Iterator[None]:
    """Turn the errors that damaged content leads to into one for the user.

    Raises
    ------
    InputError
        The content is damaged.
    """
    try:
        yield
    except (
        sqlite3.Error, zlib.error, struct.error, ValueError, TypeError, KeyError, IndexError,
        OverflowError, AttributeError, RecursionError,
    ) as error:  # fmt: skip
        what = " ".join(str(error).split())
        raise InputError(
            f"{file}: is damaged ({type(error).__name__}: {what}); map the recording again"
        ) from error


def require_cells_to_fit(num_cells: int, num_bytes: int) -> None:
    """Check that this number of cells of submaps can stand in a file of this size.

    Raises
    ------
    ValueError
        They cannot.
    """
    if num_cells > _FREE_CELLS + _CELLS_PER_BYTE * num_bytes:
        raise ValueError(f"{num_cells} cells cannot stand in {num_bytes} bytes")
