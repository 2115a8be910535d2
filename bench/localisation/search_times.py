# SPDX-License-Identifier: Apache-2.0
"""How long one scan is searched for in a whole map, from nowhere."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from bench.localisation import measures
from bench.localisation.drives import Drive, mapped, simulated_drive
from bench.localisation.world_rows import Progress
from bench.record import Figure, Row
from cartoloop.config import Config
from cartoloop.first_pass import calibrate
from cartoloop.localisation.known_map import known_map_of
from cartoloop.mapper import Mapper
from cartoloop.readers import open_log
from cartoloop.sensor.events import LaserScan
from cartoloop.stop_request import StopRequest

RECORDINGS = ("intel", "mit-killian")
"""Recordings that are mapped as a whole; their own scans are searched in that."""

WORLD = "museum"
"""A simulated world; the scans are of another drive."""


def time_rows(data: Path, scans: int, progress: Progress) -> Iterator[Row]:
    """Return the time of an answer to one scan, with the map loaded.

    Parameters
    ----------
    data : folder of the recordings; those that are absent are left out.
    scans : of each.
    """
    for name in RECORDINGS:
        path = data / "radish" / f"{name}.clf.gz"
        if path.exists():
            progress(f"{name}: mapping it as a whole")
            yield _row(_whole(path), scans, "of the map itself")
    progress(f"{WORLD}: mapping it, and driving again")
    yield _row(simulated_drive(WORLD, 0), scans, "of another drive")


def _whole(path: Path) -> Drive:
    """Return a recording in the map that it makes."""
    log = open_log(path)
    events = list(log)
    calibration = calibrate(log, Config(), StopRequest())
    result = mapped(events, Mapper(Config(), calibration=calibration))
    stamps = set(result.stamps)
    kept = [e for e in events if not isinstance(e, LaserScan) or e.stamp in stamps]
    return Drive(path.name.split(".")[0], result, kept, result.trajectory)


def _row(drive: Drive, scans: int, which: str) -> Row:
    known = known_map_of(drive.result)
    found = measures.single_scans(known, drive, scans)
    claimed, right = np.array(found.claimed), np.array(found.right)
    times = 1e3 * np.array(found.times)
    processor = [1e3 * time for time in found.processor]
    return Row(
        {"what": "time of one scan from nowhere", "drive": drive.name, "scans": which},
        {
            "searched": Figure.exact(len(times), better=None),
            "cells": Figure.exact(known.grid.size, better=None),
            "claimed": Figure.exact(100.0 * float(claimed.mean()), "%", "more"),
            "wrong, of all": Figure.exact(100.0 * float((claimed & ~right).mean()), "%"),
            "time": Figure.of_samples(times.tolist(), "ms"),
            "longest": Figure(float(times.max()), "ms"),
            "processor time": Figure.of_samples(processor, "ms"),
        },
    )
