# SPDX-License-Identifier: Apache-2.0
"""Callbacks of a run, by which its progress is shown."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cartoloop.mapper import Mapper
    from cartoloop.result import Result
    from cartoloop.sensor.events import SensorEvent


class RunObserver:
    """Callbacks of a run, all in the mapping thread; this one ignores them all."""

    def started(self, num_scans: int) -> None:
        """The recording was opened and has `num_scans` scans."""

    def resumed(self, num_scans: int) -> None:
        """The first `num_scans` scans were mapped before: their matches are known."""

    def already_finished(self, folder: Path) -> None:
        """There is nothing to resume: `folder` holds the finished map."""

    def already_added(self, name: str) -> None:
        """The recording is in the map that it is added to: its scans will be in it twice."""

    def journal_failed(self, problem: str) -> None:
        """The journal cannot be written, in one line; mapping goes on. May be of any thread."""

    def before_event(self, mapper: Mapper, event: SensorEvent) -> None:
        """`event` is added next."""

    def after_event(self, mapper: Mapper, event: SensorEvent) -> None:
        """`event` was added."""

    def finishing(self, mapper: Mapper, stage: str | None) -> None:
        """The last pass begins (`stage` None), or the stage of it that is named."""

    def mapped(self, result: Result, failure: Exception | None) -> None:
        """The map is complete, or as it was when `failure` ended the run; it is saved next."""

    def saving(self, folder: Path) -> None:
        """The map is saved in `folder` next: the one asked for, or one inside."""

    def saved(self, result: Result, failure: Exception | None) -> None:
        """The map was saved, and the report has its final times."""
