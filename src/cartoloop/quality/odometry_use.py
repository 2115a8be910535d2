# SPDX-License-Identifier: Apache-2.0
"""What a map rests on besides its scans: where odometry was used, and how well it measures."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, TypeGuard

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray
from cartoloop.local_slam.turn_comparison import OPPOSITE_RATIO
from cartoloop.quality.places import extent

SCALE_ERROR, SCALE_OF_ROTATION = 0.002, 1.6
"""Expected error of a corridor's length, as a share of it: of good odometry, and more for each
radian of its typical error of a step, by which bad odometry is recognised."""

SCALE_LEFT = 0.6
"""Share of the displacement by wrong scales that is left where a place is visited again, later
with the right scale, and by scans that measure a little. On simulated corridors it was 0.2 to
0.8."""


def length_error(length: float, odometry: Mapping[str, Any]) -> float:
    """Return the standard deviation of a length that rests on the odometry alone [m].

    Where scans have measured some of its metres, it follows from their noise: that of the metres of
    this length, and that of the scale, which is the mean of the metres that were measured.

    Parameters
    ----------
    length : [m].
    odometry : its calibration, as in the report.
    """
    noise, num_metres = odometry.get("metre_noise_m"), odometry.get("measured_metres")
    if noise is not None and num_metres:
        return float(noise) * math.sqrt(length + length**2 / int(num_metres))
    # Nothing known of turns means that there were none.
    rotation_error = float(odometry.get("rotation_error_rad") or 0.0)
    return (SCALE_ERROR + SCALE_OF_ROTATION * rotation_error) * length


def scale_error(
    stamps: FloatArray, places: FloatArray, odometry: Mapping[str, Any], *, is_confirmed: bool
) -> float:
    """Return by how much the places of a path are displaced by the scales that were used [m].

    While the scale is learnt, distances that rest on the odometry are wrong by as much as it is
    off from what it turns out to be in the end. It counts between the two places that are displaced
    most against each other: errors of both signs may leave the length of the whole path right, and
    a path back with the same scale displaces nothing further.
    Where later visits confirm the path, :data:`SCALE_LEFT` of that is left in the finished map.

    Parameters
    ----------
    stamps : of the path's nodes, in order, shape (n,), as recorded [s].
    places : of the nodes, shape (n, 2) [m].
    odometry : its calibration, as in the report; what was mapped before it began does not count.
    is_confirmed : whether another visit confirms most of the path.
    """
    used, final = odometry.get("scales"), odometry.get("translation_scale")
    if not used or not final or len(stamps) < 2:
        return 0.0
    begins = np.array([float(one["begin"]) for one in used])
    scales = np.array([float(one["translation_scale"]) for one in used])
    rows = np.searchsorted(begins, stamps[:-1], side="right") - 1
    is_known = rows >= 0
    errors = scales[rows[is_known]] / float(final) - 1.0
    steps = np.diff(places, axis=0)[is_known] * errors[:, np.newaxis]
    displaced = np.vstack((np.zeros(2), np.cumsum(steps, axis=0)))
    return (SCALE_LEFT if is_confirmed else 1.0) * extent(displaced)


def has_odometry(odometry: Mapping[str, Any] | None) -> TypeGuard[Mapping[str, Any]]:
    """Return whether odometry was used."""
    return odometry is not None and odometry.get("translation_error_m") is not None


TURNS_AGAINST = "the odometry turns to the other side than the scans: the map may be a mirror image"
TURNS_ADVICE = (
    "give sensor.upside_down=true if the scanner is mounted upside down or sends its beams in the "
    "other order; otherwise correct the sign of the odometry's rotation"
)
"""What this means to the user, and what to try."""


def turns_against(odometry: Mapping[str, Any] | None) -> bool:
    """Return whether the odometry turns to the other side than the scans."""
    ratio = (odometry or {}).get("turn_ratio")
    return ratio is not None and float(ratio) < OPPOSITE_RATIO


NOTICED_AFTER_S = 5.0
"""A fault may have begun this long before it was noticed [s]: that odometry stands still is noticed
once the scans have moved a metre."""


def without_odometry(stamps: FloatArray, odometry: Mapping[str, Any] | None) -> BoolArray:
    """Return at which stamps no odometry was used, or wrongly, shape (n,).

    Parameters
    ----------
    stamps : float64, shape (n,), as recorded [s].
    odometry : its calibration, as in the report; None without odometry.
    """
    if not has_odometry(odometry):
        return np.ones(len(stamps), dtype=np.bool_)
    without = np.zeros(len(stamps), dtype=np.bool_)
    for fault in odometry.get("faults", ()):
        end = math.inf if fault["end"] is None else float(fault["end"])
        without |= (stamps >= float(fault["begin"]) - NOTICED_AFTER_S) & (stamps <= end)
    return without
