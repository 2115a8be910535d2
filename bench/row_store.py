# SPDX-License-Identifier: Apache-2.0
"""The rows of a long benchmark, kept one by one, so that it can be measured in pieces."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from bench.record import Case, Figure, Row
from cartoloop.errors import InputError, OutputError


class RowStore:
    """Rows and the commits they were measured at, in a file of one JSON a line.

    Parameters
    ----------
    path : of the file; it may be missing.
    commit : of the sources now.

    Raises
    ------
    InputError
        The file is not one of rows.
    """

    def __init__(self, path: Path, commit: str) -> None:
        self._path, self._commit = path, commit
        self._rows: dict[str, tuple[str, Row]] = {}
        if not path.exists():
            return
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
            try:
                self._keep(*_read(json.loads(line)))
            except (ValueError, KeyError, TypeError, AttributeError) as error:
                raise InputError(
                    f"{path}, line {number}: is not a row of a benchmark ({error})"
                ) from error

    def __iter__(self) -> Iterator[Row]:
        """Yield the newest row of each case; the notes of those of other commits say so."""
        for commit, row in self._rows.values():
            if commit == self._commit:
                yield row
            else:
                yield replace(row, notes="; ".join(filter(None, (row.notes, f"at {commit}"))))

    def has(self, case: Case) -> bool:
        """Return whether a case was measured with the sources as they are."""
        found = self._rows.get(_key(case))
        is_certain = self._commit != "unknown" and not self._commit.endswith("changes")
        return found is not None and is_certain and found[0] == self._commit

    def add(self, row: Row) -> None:
        """Keep a row in the place of an earlier one of its case, in the file too.

        Raises
        ------
        OutputError
            The file cannot be written.
        """
        self._keep(self._commit, row)
        try:
            with self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps({"commit": self._commit, **asdict(row)}) + "\n")
        except OSError as error:
            raise OutputError(f"{self._path}: cannot be written: {error.strerror}") from error

    def _keep(self, commit: str, row: Row) -> None:
        self._rows[_key(row.case)] = commit, row


def _read(found: dict[str, Any]) -> tuple[str, Row]:
    figures = {name: Figure(**figure) for name, figure in found["figures"].items()}
    return str(found["commit"]), Row(dict(found["case"]), figures, str(found["notes"]))


def _key(case: Case) -> str:
    return json.dumps(case, sort_keys=True)
