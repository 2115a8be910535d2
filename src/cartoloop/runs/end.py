# SPDX-License-Identifier: Apache-2.0
"""The end of a run, of a recording or live: its report is completed, and its map saved."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from cartoloop.config_file import config_hash
from cartoloop.errors import OutputError
from cartoloop.map_file.file_set import remove_file_set
from cartoloop.map_output.output_folder import RunFolder, saved_map
from cartoloop.runtime.process_memory import release_unused_memory
from cartoloop.stop_request import StopRequest

if TYPE_CHECKING:
    from cartoloop.map_output.picture import Layer
    from cartoloop.report import Report
    from cartoloop.result import Result


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a run ended.

    Attributes
    ----------
    result : the map, or what was mapped until the end of an incomplete run.
    failure : the exception that ended the run early, or None.
    is_complete : whether the last pass was done: neither a failure nor a stop ended the run.
    """

    result: Result
    failure: Exception | None
    is_complete: bool


@dataclass(frozen=True, slots=True)
class Saved:
    """How a run ended, and where its map is.

    Attributes
    ----------
    outcome : how it ended.
    place : folder of its map; None if it was not saved.
    why : it is there and not in the folder asked for, as a clause; or "".
    """

    outcome: Outcome
    place: Path | None
    why: str

    @property
    def where(self) -> str:
        """The place as a phrase that begins with a blank, or ""."""
        return "" if self.place is None else f" in {self.place}{self.why}"


def save_outcome(
    outcome: Outcome,
    folder: RunFolder,
    layers: Collection[Layer],
    origins: Mapping[str, str],
    saving: Callable[[Path], None],
    start: float,
    stop: StopRequest,
) -> Saved:
    """Save the map of a run where it may be, with the final times in the report.

    Parameters
    ----------
    outcome : of the run.
    folder : of the run.
    layers : drawn over the picture of the map.
    origins : by key of the configuration, where its value comes from.
    saving : called with the folder before the map is saved in it.
    start : of the run, by `time.perf_counter` [s].
    stop : of the run.

    Raises
    ------
    OutputError
        It cannot be written: the disk is full, or the folder is gone. If possible, the map was
        saved in a temporary folder.
    """
    from cartoloop.map_output.save import save

    def save_in(place: Path) -> Report:
        saving(place)

        def complete(report: Report) -> Report:
            folder.check_base(place)
            return timed(report, start=start)

        return save(
            result, place, layers=layers, origins=origins, complete_report=complete, stop=stop
        )

    release_unused_memory()
    result = outcome.result
    if not len(result.stamps) and saved_map(folder.path) is not None:
        return Saved(outcome, None, "")  # nothing, where there is something
    try:
        place = folder.place(finished=result.report.finished)
        report = save_in(place)
    except OutputError as error:
        other = Path(tempfile.mkdtemp(prefix="cartoloop-"))
        try:
            save_in(other)
        except OutputError:
            remove_file_set(other)
            raise error from None
        raise OutputError(f"{error}; the map was saved in {other} instead") from error
    return Saved(replace(outcome, result=replace(result, report=report)), place, folder.why(place))


def completed(
    result: Result,
    name: str,
    also_skipped: Mapping[str, int],
    problems: Sequence[str] = (),
    *,
    fingerprint: str,
) -> Report:
    """Return the report of a result, completed by the reader's findings.

    Parameters
    ----------
    result : of the mapper.
    name : of the recording or the live source.
    also_skipped : number of lines or messages that the reader skipped, by reason.
    problems : of the recording, one line each.
    fingerprint : of the recording.
    """
    report = result.report
    skipped = dict(report.skipped)
    for reason, count in also_skipped.items():
        skipped[reason] = skipped.get(reason, 0) + count
    extra = dict(report.extra)
    from cartoloop.quality.odometry_warnings import odometry_warnings  # loads the kernels

    problems = [*problems, *odometry_warnings(extra.get("odometry"))]
    if problems:
        extra["problems"] = problems
    return replace(
        report,
        input=replace(report.input, name=name),
        skipped=skipped,
        config_hash=config_hash(result.config),
        fingerprint=fingerprint,
        extra=extra,
    )


def timed(report: Report, start: float) -> Report:
    """Return the report with the time and memory that the run took since `start` [s]."""
    from cartoloop.report import with_times  # loads the kernels

    return with_times(report, time.perf_counter() - start, time.process_time())
