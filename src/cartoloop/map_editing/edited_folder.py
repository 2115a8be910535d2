# SPDX-License-Identifier: Apache-2.0
"""The folder of a map that is edited: all its files follow, and nobody else's change is lost."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

from cartoloop.errors import InputError, OutputError
from cartoloop.global_slam.graph_adjustment import AdjustmentRun
from cartoloop.journal.frames import FILE_NAME as JOURNAL
from cartoloop.map_data import MapData
from cartoloop.map_file.file_set import repair_file_set
from cartoloop.map_file.schema import FILE_NAME
from cartoloop.map_output.output_folder import map_state
from cartoloop.map_output.save import save
from cartoloop.report import AdjustmentSummary, Report
from cartoloop.runtime.stage_timer import StageSummary


@dataclass(slots=True)
class EditedFolder:
    """A folder with a map.

    Attributes
    ----------
    path : the folder.
    state : by which a change of the map file by another program is noticed.
    """

    path: Path
    state: tuple[int, int, int]

    @classmethod
    def of(cls, path: str | PathLike[str]) -> EditedFolder:
        """Return the folder of a map, given itself or the map file in it.

        Raises
        ------
        InputError
            It holds no map.
        """
        given = Path(path)
        folder = given.parent if given.name == FILE_NAME and not given.is_dir() else given
        repair_file_set(folder)
        if not (folder / FILE_NAME).is_file():
            if (folder / JOURNAL).is_file():
                raise InputError(
                    f"{folder}: mapping was interrupted; finish it with --resume, then edit it"
                )
            raise InputError(
                f"{folder}: has no {FILE_NAME}; give a folder that 'cartoloop map' wrote"
            )
        return cls(folder, map_state(folder))

    def write(self, edited: MapData) -> Report:
        """Replace all files of the map, and return the report as written.

        Raises
        ------
        OutputError
            Another program has changed the map since it was opened, or a file cannot be written.
        """
        self._require_unchanged()
        before = _report_before(self.path / "report.json")
        try:
            config = (self.path / "config.toml").read_text(encoding="utf-8")
        except (OSError, ValueError):
            config = None
        report = save(
            edited,
            self.path,
            complete_report=lambda report: self._completed(report, before),
            config_text=config,
        )
        self.state = map_state(self.path)
        return report

    def _completed(self, report: Report, before: dict[str, Any]) -> Report:
        # Now no other program can replace the files, but one may have done so since.
        self._require_unchanged()
        return _with_times(report, before)

    def _require_unchanged(self) -> None:
        if map_state(self.path) != self.state:
            raise OutputError(
                f"{self.path}: was changed by another program meanwhile; open it again to edit it"
            )


def _report_before(path: Path) -> dict[str, Any]:
    try:
        before = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return {}
    return before if isinstance(before, dict) else {}


def _with_times(report: Report, before: dict[str, Any]) -> Report:
    """Return a report with the times of the run that made the map, as far as they are known."""
    try:
        adjustment = dict(before["adjustment"])
        runs = tuple(AdjustmentRun(**run) for run in adjustment.pop("each"))
        timed = replace(
            report,
            wall_s=float(before["wall_s"]),
            cpu_s=float(before["cpu_s"]),
            peak_memory_mb=float(before["peak_memory_mb"]),
            real_time_factor=float(before["real_time_factor"]),
            adjustment=AdjustmentSummary(**adjustment, each=runs),
            stages={name: StageSummary(**stage) for name, stage in before["stages"].items()},
        )
        timed.to_json()
    except (KeyError, TypeError, ValueError, AttributeError):
        return report
    return timed
