# SPDX-License-Identifier: Apache-2.0
"""What the journal costs: processor time, bytes, and the same records in SQLite; loading a map."""

from __future__ import annotations

import os
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from bench.environment import environment
from bench.loading import loading_rows
from bench.museum_log import museum_or
from bench.record import Figure, Record, Row
from cartoloop.journal.frames import FILE_NAME as JOURNAL
from cartoloop.journal.frames import Record as JournalRecord
from cartoloop.journal.frames import frame_bytes, read_content, record_bytes
from cartoloop.map_file.file_set import FILES
from cartoloop.map_file.schema import FILE_NAME

WRITES_A_SECOND = 4
"""How often the journal is written; in SQLite, a transaction each time."""


def run(
    log: Path | None = None,
    pairs: int = 3,
    seed: int = 1,
    progress: Callable[[str], None] = print,
    saved_map: Path | None = None,
) -> Record:
    """Map a recording with and without a journal in turn, and load its map.

    Parameters
    ----------
    log : the recording; None: a simulated museum.
    pairs : number of runs of each kind.
    seed : of the museum.
    progress : receives a line now and then.
    saved_map : folder of a map that is only loaded, in place of all else.
    """
    if saved_map is not None:
        rows = loading_rows(saved_map.name, saved_map, pairs)
        return Record("journal", tuple(rows), environment())
    with tempfile.TemporaryDirectory(prefix="cartoloop-journal-") as name:
        folder = Path(name)
        log = museum_or(log, folder, seed, progress)
        out = folder / "out"
        _mapped(log, out, "kept")  # compiles
        journal, spans = folder / JOURNAL, []
        (out / JOURNAL).replace(journal)
        for number in range(pairs):
            spans.append((_mapped(log, out, "quiet"), _mapped(log, out, "without")))
            progress(f"{number + 1} of {pairs} pairs mapped")
        ratios = [1.0 + (with_s - without_s) / without_s for with_s, without_s in spans]
        sizes = {each: (out / each).stat().st_size for each in FILES}
        whole = journal.stat().st_size + sum(sizes.values())
        rows = [
            Row(
                {"recording": log.name, "what": "mapping"},
                {
                    "cpu with a journal": Figure.of_samples([a for a, _ in spans], "s", None),
                    "cpu without": Figure.of_samples([b for _, b in spans], "s", None),
                    "ratio": Figure.of_samples(ratios, ""),
                    "journal": Figure.exact(journal.stat().st_size / 1e6, "MB"),
                    "written per byte of map.cartoloop": Figure.exact(
                        (journal.stat().st_size + sizes[FILE_NAME]) / sizes[FILE_NAME]
                    ),
                    "written per byte of all files": Figure.exact(whole / sum(sizes.values())),
                },
            ),
            *_rows_of_formats(log.name, journal, folder, max(b for _, b in spans)),
            *loading_rows(log.name, out, pairs),
        ]
    return Record("journal", tuple(rows), environment())


def _mapped(log: Path, out: Path, journal: str) -> float:
    """Return the processor time of a run [s]."""
    before = os.times()
    subprocess.run(
        [sys.executable, "-m", "bench.resumed_child", str(log), str(out), "begin", journal],
        check=True,
        stdout=subprocess.DEVNULL,
    )
    after = os.times()
    used = after.children_user + after.children_system
    return used - before.children_user - before.children_system


def _rows_of_formats(name: str, journal: Path, folder: Path, duration_s: float) -> list[Row]:
    """Write the records of a journal again, as frames and into SQLite's write-ahead log."""
    records = read_content(journal).records
    size = max(len(records) // max(round(WRITES_A_SECOND * duration_s), 1), 1)
    groups = [records[first : first + size] for first in range(0, len(records), size)]
    rows = []
    for what, write in (("frames", _write_frames), ("SQLite, WAL", _write_sqlite)):
        path = folder / what.replace(", ", "-")
        written, start = _bytes_written(), time.process_time()
        write(path, groups)
        figures = {
            "cpu": Figure.exact(time.process_time() - start, "s"),
            "written": Figure.exact((_bytes_written() - written) / 1e6, "MB"),
        }
        rows.append(Row({"recording": name, "what": what}, figures))
    return rows


def _write_frames(path: Path, groups: Sequence[Sequence[JournalRecord]]) -> None:
    with path.open("wb", buffering=0) as file:
        for number, group in enumerate(groups):
            content = [record_bytes(kind, bytes(payload)) for kind, payload in group]
            file.write(frame_bytes(content))
            if number % WRITES_A_SECOND == 0:
                os.fsync(file.fileno())


def _write_sqlite(path: Path, groups: Sequence[Sequence[JournalRecord]]) -> None:
    database = sqlite3.connect(path, isolation_level=None)
    database.executescript("PRAGMA journal_mode = WAL; PRAGMA synchronous = NORMAL")
    database.execute(
        "CREATE TABLE records (record INTEGER PRIMARY KEY, kind INTEGER, payload BLOB)"
    )
    for group in groups:
        database.execute("BEGIN")
        database.executemany(
            "INSERT INTO records (kind, payload) VALUES (?, ?)",
            [(kind, bytes(payload)) for kind, payload in group],
        )
        database.execute("COMMIT")
    database.close()


def _bytes_written() -> int:
    """Return the bytes that this process has passed to the system."""
    lines = Path("/proc/self/io").read_text(encoding="ascii").splitlines()
    return int(dict(line.split(": ") for line in lines)["wchar"])
