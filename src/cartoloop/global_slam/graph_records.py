# SPDX-License-Identifier: Apache-2.0
"""What global SLAM computes, as records of a journal: finished submaps, requests, closures."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import FloatArray, RowArray
from cartoloop.global_slam.closure_matches import Requests, SearchMatches
from cartoloop.global_slam.closure_search import SearchOutcome
from cartoloop.global_slam.hypotheses import Candidate
from cartoloop.journal.fields import FieldReader, pack_columns
from cartoloop.journal.frames import Kind
from cartoloop.journal.outcomes import RecordedOutcomes
from cartoloop.submaps.finished_grid import FinishedGrid

_SUBMAP = struct.Struct("<Id2I3d")
_COUNT = struct.Struct("<I")
_OUTCOME = struct.Struct("<Id?")
_WIDE = struct.Struct("<Id")

_ROW = ("<i4",), ((),)
REQUESTS = ("<i4", "<i4", "<i4", "<f8", "<f8", "<f8"), ((), (), (), (3,), (), ())
MATCHES = (
    ("<i4", "<f8", "<f8", "<f8", "<f8", "<f8", "<f8", "<f8"),
    ((), (3,), (3, 3), (), (), (), (), ()),
)
CANDIDATES = ("<i4", "<i4", "<i4", "<f8", "<f8", "<f8"), ((), (), (), (3,), (), ())
_POSES = ("<f8",), ((3,),)


SUBMAPS_OF_AN_ADJUSTMENT = 50
"""Poses of submaps that may be recorded for each adjustment: 1200 bytes, as nodes take 100 times as
much in between."""


class WideOutcome(NamedTuple):
    """What the search of composite scans in one submap came to.

    Attributes
    ----------
    rows : that were searched.
    min_score : the threshold.
    candidates : where it was reached.
    """

    rows: RowArray
    min_score: float
    candidates: list[Candidate]


def index_of_submap(payload: memoryview) -> int:
    """Return which submap a record of one is of.

    Raises
    ------
    struct.error
        The payload is too short.
    """
    index: int = _SUBMAP.unpack_from(payload)[0]
    return index


def cells_of_submap(payload: memoryview) -> int:
    """Return how many cells the submap of a record has.

    Raises
    ------
    struct.error
        The payload is too short.
    """
    _, _, num_rows, num_cols, *_ = _SUBMAP.unpack_from(payload)
    return int(num_rows) * int(num_cols)


def submap_record(index: int, grid: FinishedGrid, own_score: float) -> bytes:
    """Return a finished submap and the mean score of its own scans as a payload."""
    place = (grid.origin_x, grid.origin_y, grid.resolution)
    return _SUBMAP.pack(index, own_score, *grid.shape, *place) + grid.packed


def recorded_submap(payload: memoryview) -> tuple[FinishedGrid, float]:
    """Return the grid of a finished submap, and the mean score of its own scans.

    Raises
    ------
    struct.error, ValueError
        The payload is damaged, or the grid is larger than any submap.
    """
    _, own_score, num_rows, num_cols, *place = _SUBMAP.unpack_from(payload)
    packed = bytes(payload[_SUBMAP.size :])
    return FinishedGrid.of_packed(packed, (num_rows, num_cols), *place), own_score


def requests_record(requests: Requests, num_nodes: int) -> bytes:
    """Return requests that were made when the graph had `num_nodes` as a payload."""
    return _COUNT.pack(num_nodes) + pack_columns(requests, REQUESTS[0])


def recorded_requests(payload: memoryview) -> tuple[Requests, int]:
    """Return requests, and the number of nodes when they were made.

    Raises
    ------
    struct.error, ValueError
        The payload is damaged.
    """
    reader = FieldReader(payload)
    [num_nodes] = reader.numbers(_COUNT)
    return Requests(*reader.columns(*REQUESTS)), num_nodes


def rows_record(rows: RowArray) -> bytes:
    """Return rows of the record of closures as a payload."""
    return pack_columns((rows,), _ROW[0])


def recorded_rows(payload: memoryview) -> RowArray:
    """Return rows of the record of closures.

    Raises
    ------
    struct.error, ValueError
        The payload is damaged.
    """
    [rows] = FieldReader(payload).columns(*_ROW)
    return rows


def outcomes_record(places: Sequence[int], outcomes: Sequence[SearchOutcome]) -> bytes:
    """Return what searches came to as a payload.

    Parameters
    ----------
    places : of the searches among those that were running.
    outcomes : of each.
    """
    parts = []
    for place, outcome in zip(places, outcomes, strict=True):
        parts += [
            _OUTCOME.pack(place, outcome.min_score, outcome.is_empty),
            rows_record(outcome.searched),
            rows_record(outcome.not_searched),
            rows_record(outcome.ambiguous),
            matches_record(outcome.matches),
        ]
    return b"".join(parts)


def recorded_outcomes(payload: memoryview) -> tuple[list[int], list[SearchOutcome]]:
    """Return what :func:`outcomes_record` was given.

    Raises
    ------
    struct.error, ValueError
        The payload is damaged.
    """
    reader = FieldReader(payload)
    places, outcomes = [], []
    while not reader.is_at_end:
        place, min_score, is_empty = reader.numbers(_OUTCOME)
        searched, not_searched, ambiguous = (reader.columns(*_ROW)[0] for _ in range(3))
        matches = SearchMatches(*reader.columns(*MATCHES))
        places.append(place)
        outcomes.append(
            SearchOutcome(min_score, is_empty, searched, not_searched, ambiguous, matches)
        )
    return places, outcomes


def matches_record(matches: SearchMatches) -> bytes:
    """Return closures that were found as a payload."""
    return pack_columns(matches, MATCHES[0])


def recorded_matches(payload: memoryview) -> SearchMatches:
    """Return closures that were found.

    Raises
    ------
    struct.error, ValueError
        The payload is damaged.
    """
    return SearchMatches(*FieldReader(payload).columns(*MATCHES))


def wide_record(places: Sequence[int], outcomes: Sequence[WideOutcome]) -> bytes:
    """Return what searches of composite scans came to as a payload; see `outcomes_record`."""
    parts = []
    for place, outcome in zip(places, outcomes, strict=True):
        parts += [
            _WIDE.pack(place, outcome.min_score),
            rows_record(outcome.rows),
            pack_columns(candidate_columns(outcome.candidates), CANDIDATES[0]),
        ]
    return b"".join(parts)


def candidate_columns(candidates: Sequence[Candidate]) -> list[NDArray[Any]]:
    """Return candidates as columns of the types and shapes of `CANDIDATES`."""
    columns = [np.array(column) for column in zip(*candidates, strict=True)]
    return columns or [np.zeros((0, *shape)) for shape in CANDIDATES[1]]


def recorded_candidates(reader: FieldReader) -> list[Candidate]:
    """Return candidates whose columns follow."""
    row, scan, submap, pose, score, other = reader.columns(*CANDIDATES)
    numbers = (row.tolist(), scan.tolist(), submap.tolist(), pose, score.tolist())
    return [Candidate(*each) for each in zip(*numbers, other.tolist(), strict=True)]


def recorded_wide_outcomes(payload: memoryview) -> tuple[list[int], list[WideOutcome]]:
    """Return what :func:`wide_record` was given.

    Raises
    ------
    struct.error, ValueError
        The payload is damaged.
    """
    reader = FieldReader(payload)
    places, outcomes = [], []
    while not reader.is_at_end:
        place, min_score = reader.numbers(_WIDE)
        [rows] = reader.columns(*_ROW)
        places.append(place)
        outcomes.append(WideOutcome(rows, min_score, recorded_candidates(reader)))
    return places, outcomes


def poses_record(poses: FloatArray) -> bytes:
    """Return poses, shape (n, 3), as a payload."""
    return pack_columns((poses,), _POSES[0])


class PoseNotes:
    """Records the poses of the submaps after adjustments, so that a journal opens as a good map.

    A large graph is adjusted often and its poses are many: they are recorded only when as much has
    been added to the graph since the last time, so that the journal grows with the map.
    """

    def __init__(self, outcomes: RecordedOutcomes) -> None:
        self._recorded = outcomes
        self._num_skipped = 0

    def note(self, submap_poses: FloatArray) -> None:
        """Note the poses of all submaps after an adjustment, shape (n, 3)."""
        self._num_skipped += 1
        if self._num_skipped * SUBMAPS_OF_AN_ADJUSTMENT < len(submap_poses):
            return
        self._num_skipped = 0
        if self._recorded.replay(Kind.POSES) is None and self._recorded.is_recording:
            self._recorded.record(Kind.POSES, poses_record(submap_poses))


def recorded_poses(payload: memoryview) -> FloatArray:
    """Return poses, shape (n, 3).

    Raises
    ------
    struct.error, ValueError
        The payload is damaged.
    """
    [poses] = FieldReader(payload).columns(*_POSES)
    return poses
