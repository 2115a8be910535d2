# SPDX-License-Identifier: Apache-2.0
"""The table of sessions in a map database."""

from __future__ import annotations

import json
import math
import sqlite3
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

from cartoloop.arrays import FloatArray
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.map_file.schema import SESSIONS_VERSION
from cartoloop.plain_text import plain_values
from cartoloop.report import Report
from cartoloop.session import Session, whole_map

_MAX_SESSIONS = 100_000


def session_rows(sessions: Sequence[Session]) -> Iterator[tuple[Any, ...]]:
    """Yield the rows of the table."""
    for number, session in enumerate(sessions):
        yield (
            number,
            session.name,
            session.recording,
            session.fingerprint,
            session.first_scan,
            session.first_node,
            session.first_submap,
            session.part,
            None if math.isnan(session.stamp) else session.stamp,
            json.dumps(session.calibration, allow_nan=False, sort_keys=True),
        )


def sessions_of(
    database: sqlite3.Connection, report: Report, stamps: FloatArray, graph: PoseGraph
) -> tuple[Session, ...]:
    """Return the sessions of a map, given what else it holds; those of older files are one.

    Raises
    ------
    ValueError
        The table is damaged.
    """
    if database.execute("PRAGMA user_version").fetchone()[0] < SESSIONS_VERSION:
        return whole_map(report.input.name, report.fingerprint, stamps)
    rows = database.execute(
        "SELECT session, name, recording, fingerprint, first_scan, first_node, first_submap, part, "
        "stamp, calibration FROM sessions ORDER BY 1 LIMIT ?",
        (_MAX_SESSIONS,),
    ).fetchall()
    sessions = tuple(_session(row[1:]) for row in rows)
    if [row[0] for row in rows] != list(range(len(rows))) or not rows:
        raise ValueError("rows of sessions are missing")
    _check([session.first_scan for session in sessions], len(stamps))
    _check([session.first_node for session in sessions], graph.num_nodes)
    _check([session.first_submap for session in sessions], graph.num_submaps)
    return sessions


def _session(row: tuple[Any, ...]) -> Session:
    name, recording, fingerprint, *numbers, stamp, calibration = row
    first_scan, first_node, first_submap, part = numbers
    if not all(isinstance(number, int) and 0 <= number < 2**31 for number in numbers):
        raise ValueError("a session begins nowhere, or is of no part")
    if not all(isinstance(text, str) for text in (name, recording, fingerprint)):
        raise ValueError("the name of a session is no text")
    learnt = plain_values(json.loads(calibration))
    if not isinstance(learnt, dict):
        raise ValueError("the calibration of a session is no table")
    if stamp is not None and not math.isfinite(stamp):
        raise ValueError("the stamp of a session is not finite")
    return Session(
        name,
        recording,
        fingerprint,
        first_scan=first_scan,
        first_node=first_node,
        first_submap=first_submap,
        part=part,
        stamp=math.nan if stamp is None else float(stamp),
        calibration=learnt,
    )


def _check(firsts: Sequence[int], count: int) -> None:
    is_ordered = all(one <= other for one, other in pairwise(firsts))
    if firsts[0] != 0 or not is_ordered or firsts[-1] > count:
        raise ValueError("the sessions do not follow each other")
