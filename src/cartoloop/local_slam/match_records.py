# SPDX-License-Identifier: Apache-2.0
"""What local SLAM computes for a scan, as records of a journal: matches and wall steps.

With each goes what the matcher or the comparison remembers after it, so that taking the record
leaves the same state as computing it.
"""

from __future__ import annotations

import struct
from typing import Any, NamedTuple

import numpy as np

from cartoloop.journal.outcomes import unfit
from cartoloop.scan_matching.least_squares import LeastSquaresMatch
from cartoloop.sensor.pose import Pose


class MatcherMemory(NamedTuple):
    """What a scan matcher remembers from scan to scan.

    Attributes
    ----------
    typical_residual : of a match.
    num_correlative : number of scans for which the correlative matcher ran.
    num_lost : number of scans that were searched in the wider window.
    lost_in_turn : number of latest scans by odometry that fitted nowhere as scans do.
    tf_found_predicted : to where the latest of these fits at another heading, in the local frame.
    """

    typical_residual: float
    num_correlative: int
    num_lost: int
    lost_in_turn: int
    tf_found_predicted: Pose | None


class WallMemory(NamedTuple):
    """What the comparison along walls remembers from scan to scan, besides the scan.

    Attributes
    ----------
    evidence : for another step, so far.
    side_x, side_y : velocity that was missed by the latest comparison [m/s].
    missed_x, missed_y : what the steps that it is for have missed so far [m].
    is_due : whether the next scan that is added takes the place of the last.
    moved_at : when the odometry last moved [s].
    """

    evidence: float
    side_x: float
    side_y: float
    missed_x: float
    missed_y: float
    is_due: bool
    moved_at: float


_MATCH = struct.Struct("<?3d9d2dId3I?3d")
_WALL = struct.Struct("<?3d5d?d")
_NOWHERE = (0.0, 0.0, 0.0)


def match_record(match: LeastSquaresMatch, memory: MatcherMemory, *, is_relocated: bool) -> bytes:
    """Return a match and the memory of the matcher after it as a payload."""
    information = match.information.ravel().tolist()
    *numbers, place = memory
    return _MATCH.pack(
        is_relocated,
        *match.tf_submap_scan,
        *information,
        match.residual,
        match.cost,
        match.iterations,
        *numbers,
        place is not None,
        *(_NOWHERE if place is None else place),
    )


def recorded_match(payload: memoryview) -> tuple[LeastSquaresMatch, MatcherMemory, bool]:
    """Return what :func:`match_record` was given.

    Raises
    ------
    InputError
        The payload has another length: another version has written it.
    """
    is_relocated, *values = _unpacked(_MATCH, payload)
    information = np.array(values[3:12]).reshape(3, 3)
    match = LeastSquaresMatch(Pose(*values[:3]), information, *values[12:15])
    residual, num_correlative, num_lost, lost_in_turn, has_place, *place = values[15:]
    memory = MatcherMemory(
        residual, num_correlative, num_lost, lost_in_turn, Pose(*place) if has_place else None
    )
    return match, memory, is_relocated


def wall_record(pose: Pose | None, memory: WallMemory) -> bytes:
    """Return a better pose, if there is one, and the memory after the comparison as a payload."""
    place = _NOWHERE if pose is None else pose
    return _WALL.pack(pose is not None, *place, *memory)


def recorded_wall_step(payload: memoryview) -> tuple[Pose | None, WallMemory]:
    """Return what :func:`wall_record` was given.

    Raises
    ------
    InputError
        The payload has another length: another version has written it.
    """
    is_better, x, y, theta, *memory = _unpacked(_WALL, payload)
    return Pose(x, y, theta) if is_better else None, WallMemory(*memory)


def _unpacked(layout: struct.Struct, payload: memoryview) -> tuple[Any, ...]:
    if len(payload) != layout.size:
        raise unfit("its scans were matched by another version")
    return layout.unpack(payload)
