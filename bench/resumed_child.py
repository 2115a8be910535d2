# SPDX-License-Identifier: Apache-2.0
"""A run of the mapper in a process of its own that says how far it has come, to be killed.

Run: ``python -m bench.resumed_child LOG OUT (begin | resume) JOURNAL``. JOURNAL is ``counted``: a
line is printed when a scan was mapped; ``quiet``; ``kept``, also at the end; or ``without``.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

from cartoloop.mapper import Mapper
from cartoloop.runs import recording
from cartoloop.runs.journal import RunJournal
from cartoloop.runs.observer import RunObserver
from cartoloop.runs.recording import map_recording
from cartoloop.runs.resuming import resume_recording
from cartoloop.runtime.process_memory import relax_gc, set_malloc_thresholds
from cartoloop.sensor.events import SensorEvent


class _Counting(RunObserver):
    """Prints the number of mapped scans whenever it grows."""

    def __init__(self) -> None:
        self._num_scans = 0

    def after_event(self, mapper: Mapper, event: SensorEvent) -> None:
        """Print how many scans were mapped."""
        if mapper.num_scans != self._num_scans:
            self._num_scans = mapper.num_scans
            os.write(1, b"%d\n" % self._num_scans)


def main() -> None:
    """Map the recording in the arguments."""
    log, out, how, journal = sys.argv[1:]
    set_malloc_thresholds()
    relax_gc()
    observer = _Counting() if journal == "counted" else RunObserver()
    if journal == "without":
        recording._new_journal = lambda *_: None  # type: ignore[assignment]
    if journal == "kept":
        RunJournal.remove = RunJournal.close  # type: ignore[method-assign]
    if how == "resume":
        resume_recording(Path(log), out, observer=observer)
    else:
        map_recording(Path(log), out=out, observer=observer)


if __name__ == "__main__":
    main()
