# SPDX-License-Identifier: Apache-2.0
"""What a map rests on besides its scans: where odometry was used, and how well it measures."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, TypeGuard

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray
from cartoloop.local_slam.turn_comparison import OPPOSITE_RATIO

SCALE_ERROR, SCALE_OF_ROTATION = 0.002, 1.6
"""Expected error of a corridor's length, as a share of it: of good odometry, and more for each
radian of its typical error of a step, by which bad odometry is recognised."""


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


SLIP_M, SLIP_SHARE, SLIP_RAD = 0.1, 0.25, 0.1
"""Wheels slip if the odometry moves by so much more or less than the scans [m], and by this share
of the distance that these show, and turns as they do [rad]."""


def num_slips(odometry: Mapping[str, Any] | None) -> int:
    """Return how often wheels were seen to slip along the path, and to hold the floor again.

    They may slip elsewhere, too. Between bare walls the scans do not show it: matches follow the
    odometry there.
    """
    return sum(map(_is_slip, (odometry or {}).get("faults", ())))


def _is_slip(fault: Mapping[str, Any]) -> bool:
    if fault["end"] is None:
        return False
    matched, turned = float(fault["matched_m"]), float(fault["matched_rad"])
    missed = abs(float(fault["odometry_m"]) - matched)
    return (
        missed > max(SLIP_M, SLIP_SHARE * matched)
        and abs(float(fault["odometry_rad"]) - turned) < SLIP_RAD
    )


def untrusted_odometry(stamps: FloatArray, odometry: Mapping[str, Any] | None) -> BoolArray:
    """Return at which stamps no odometry measures lengths: it was not used, or slips.

    Parameters
    ----------
    stamps : float64, shape (n,), as recorded [s].
    odometry : its calibration, as in the report; None without odometry.
    """
    if num_slips(odometry):
        return np.ones(len(stamps), dtype=np.bool_)
    return without_odometry(stamps, odometry)
