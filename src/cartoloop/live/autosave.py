# SPDX-License-Identifier: Apache-2.0
"""The map on disk while it grows, so that a killed process loses little."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from threading import Thread
from time import monotonic

from cartoloop.errors import OutputError
from cartoloop.live.notices import Notices
from cartoloop.map_output.growing_map import save_growing_map
from cartoloop.map_output.output_folder import RunFolder
from cartoloop.mapper import Mapper
from cartoloop.report import Report
from cartoloop.result import Result

MIN_PERIOD_S = 1.0
"""Period at which a small map is saved [s]."""

MAX_SHARE = 0.015
"""A large map is saved less often: saving takes at most this share of the time."""


class Autosave:
    """Writes ``map.cartoloop`` periodically, in a background thread.

    Parameters
    ----------
    mapper : the mapper of the map.
    folder : of the run.
    notices : receives a line if saving fails.
    min_period : between two saves [s].

    Attributes
    ----------
    period : from the last save to the next [s].
    num_saves : number of saves.
    place : where it was saved last, or None.
    """

    def __init__(
        self,
        mapper: Mapper,
        folder: RunFolder,
        notices: Notices,
        min_period: float = MIN_PERIOD_S,
    ) -> None:
        self._mapper = mapper
        self._folder = folder
        self.place: Path | None = None
        self._notices = notices
        self._min_period = min_period
        self.period = min_period
        self.num_saves = 0
        self._saved_scans = 0
        self._next = monotonic() + min_period
        self._is_busy = False
        self._thread: Thread | None = None

    def after_scan(self) -> None:
        """Save if a save is due; returns at once."""
        if self._is_busy or monotonic() < self._next:
            return
        if self._mapper.num_scans != self._saved_scans and self._mapper.num_nodes:
            self._is_busy = True
            self._saved_scans = self._mapper.num_scans
            self._mapper.call_with_result(self._save_elsewhere)

    def close(self) -> None:
        """Wait until the last save is done; only after the mapper was closed."""
        if self._thread is not None:
            self._thread.join()

    def _save_elsewhere(self, result: Result) -> None:
        """Save a result in a thread, so that the graph's thread continues."""
        self._thread = Thread(target=self._save, args=(result,), name="autosave", daemon=True)
        self._thread.start()

    def _save(self, result: Result) -> None:
        start = monotonic()
        try:
            place = self.place or self._folder.place(finished=False)
            save_growing_map(replace(result, report=self._named(result.report)), place)
            self.place = place
            self.num_saves += 1
        except OutputError as error:
            self._notices.note("the map is not saved", f"{error}; it is tried again")
        took = monotonic() - start
        self.period = max(self._min_period, took / MAX_SHARE)
        self._next = monotonic() + self.period
        self._is_busy = False

    def _named(self, report: Report) -> Report:
        summary = replace(report.input, name=self._folder.name)
        return replace(report, input=summary, fingerprint=self._folder.fingerprint)
