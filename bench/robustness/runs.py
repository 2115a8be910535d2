# SPDX-License-Identifier: Apache-2.0
"""The runs of the benchmark, kept one by one, so that it can be interrupted and resumed."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from cartoloop.errors import OutputError

NO_VERDICT = "-"
"""In the place of a verdict that the map does not give."""


@dataclass(frozen=True, slots=True)
class Run:
    """One map, and how good it is.

    Attributes
    ----------
    part, case, seed : which one.
    commands : how to make it again.
    figures : by name; `error` [m] against relations or truth, `bar` [m], `cpu` [s], `precision` of
        the found closures, `calibration` over its bar, as far as they are known.
    verdict : the map's own.
    failure : why there is no map; empty otherwise.
    commit : of the sources.
    """

    part: str
    case: str
    seed: int
    commands: Sequence[str] = ()
    figures: dict[str, float] = field(default_factory=dict)
    verdict: str = NO_VERDICT
    failure: str = ""
    commit: str = ""

    @property
    def key(self) -> tuple[str, str, int]:
        """Part, case and seed."""
        return self.part, self.case, self.seed

    @property
    def is_right(self) -> bool | None:
        """Whether error or calibration is within the bar; None where there is no bar."""
        if self.failure:
            return False
        if "calibration" in self.figures:
            return self.figures["calibration"] <= 1.0
        if "bar" not in self.figures or "error" not in self.figures:
            return None
        return self.figures["error"] <= self.figures["bar"]


class RunStore:
    """The runs of one commit, in a file of one JSON a line.

    Parameters
    ----------
    path : of the file.
    commit : of the sources; runs of others are not used, nor those of sources with changes.
    """

    def __init__(self, path: Path, commit: str) -> None:
        self._path, self._commit = path, commit
        self._runs: dict[tuple[str, str, int], Run] = {}
        if not path.exists() or commit.endswith("changes") or commit == "unknown":
            return
        for line in path.read_text(encoding="utf-8").splitlines():
            run = Run(**json.loads(line))
            if run.commit == commit:
                self._runs[run.key] = run

    def __iter__(self) -> Iterator[Run]:
        return iter(self._runs.values())

    def find(self, part: str, case: str, seed: int) -> Run | None:
        """Return a run that was made before."""
        return self._runs.get((part, case, seed))

    def add(self, run: Run) -> None:
        """Keep a run, in the file too.

        Raises
        ------
        OutputError
            The file cannot be written.
        """
        self._runs[run.key] = run
        try:
            with self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(run)) + "\n")
        except OSError as error:
            raise OutputError(f"{self._path}: cannot be written: {error.strerror}") from error
