# SPDX-License-Identifier: Apache-2.0
"""What callers of the Python interface give: converted where that is clear, or refused."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from pathlib import Path
from types import UnionType

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.errors import UsageError

_MAX_SHOWN = 40
"""Characters of a value that are shown."""

_FLOAT64 = np.dtype(np.float64)


def shown(value: object) -> str:
    """Return a value as one short line."""
    if isinstance(value, np.ndarray):
        return f"an array of shape {value.shape} and type {value.dtype}"
    text = " ".join(repr(value).split())
    short = text if len(text) <= _MAX_SHOWN else f"{text[:_MAX_SHOWN]}..."
    return f"{short} ({type(value).__name__})"


def as_number(value: object, what: str) -> float:
    """Return a number as a float; it may be NaN or infinite.

    Raises
    ------
    UsageError
        It is none.
    """
    if type(value) is float:
        return value
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    if isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool):
        try:
            return float(value)
        except OverflowError:
            pass
    raise UsageError(f"{what} is {shown(value)}: give a number")


def as_numbers(value: object, what: str, count: int) -> tuple[float, ...]:
    """Return `count` numbers of a tuple, a list or an array.

    Raises
    ------
    UsageError
        They are others.
    """
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if not isinstance(value, tuple | list) or len(value) != count:
        raise UsageError(f"{what} is {shown(value)}: give {count} numbers")
    return tuple(as_number(number, what) for number in value)


def as_pose(value: object, what: str) -> tuple[float, float, float]:
    """Return x, y and theta of a pose in a map [m, m, rad].

    Raises
    ------
    UsageError
        They are no finite numbers.
    """
    x, y, theta = as_numbers(value, what, 3)
    if not all(map(math.isfinite, (x, y, theta))):
        raise UsageError(f"{what} is {shown(value)}: give finite numbers")
    return x, y, theta


def as_array(value: object, what: str) -> FloatArray:
    """Return numbers of any shape, but not a single one, as float64.

    Raises
    ------
    UsageError
        They are no numbers.
    """
    if type(value) is np.ndarray and value.dtype == _FLOAT64:
        return value
    try:
        if value is None or isinstance(value, str | bytes | Mapping):
            raise ValueError
        array = np.asarray(value, dtype=np.float64)
    except (ValueError, TypeError):
        array = np.zeros(())
    if array.ndim == 0:
        raise UsageError(f"{what} is {shown(value)}: give an array of numbers")
    return array


def as_path(value: object, what: str) -> Path:
    """Return a path.

    Raises
    ------
    UsageError
        It is none.
    """
    if isinstance(value, str | os.PathLike):
        path = os.fspath(value)
        if isinstance(path, str):
            return Path(path)
    raise UsageError(f"{what} is {shown(value)}: give a path")


def require_type(value: object, kind: type | UnionType, what: str, give: str) -> None:
    """Refuse a value of another type.

    Parameters
    ----------
    value, kind : what must be of what type.
    what, give : its name, and what to give instead.

    Raises
    ------
    UsageError
        It is not of that type.
    """
    if not isinstance(value, kind):
        raise UsageError(f"{what} is {shown(value)}: give {give}")
