# SPDX-License-Identifier: Apache-2.0
"""tinySLAM's ``.dat`` files: one line for each scan, recorded by a robot of Mines ParisTech.

::

    microseconds  status  left_ticks  right_ticks  20 more values  r1 .. r682

Ranges of a Hokuyo URG-04LX in millimetres; values below 20 are error codes. The robot's dimensions
are not in the file but in the program published with it (Steux, El Hamzaoui: tinySLAM, ICARCV
2010); the odometry computed with them agrees with the scans.
"""

from __future__ import annotations

import math

import numpy as np

from cartoloop.kernels.decimal_text import POWERS_OF_TEN, parse_decimals
from cartoloop.readers.line_format import Head, LineError, LineFormat, Parse, Reading
from cartoloop.sensor.events import ScanGeometry
from cartoloop.sensor.pose import Pose, compose

WHEEL_RADIUS_M = 0.077
"""Radius of the wheels [m]."""

HALF_AXLE_M = 0.165
"""Half the distance between the wheels [m]."""

TICKS_PER_TURN = 2000
"""Encoder ticks of one turn of a wheel."""

SCANNER_AHEAD_M = 0.145
"""Distance from the axle to the scanner [m]."""

_NUM_BEAMS = 682
_STEP_RAD = 2.0 * math.pi / 1024
_RANGE_MAX_M = 5.6
_NUM_HEAD = 24  # values before the ranges


def _recognise(head: Head) -> bool:
    lines = [line.split() for line in head if line.strip()]
    return bool(lines) and all(
        _NUM_HEAD + _NUM_BEAMS <= len(words) <= _NUM_HEAD + _NUM_BEAMS + 1
        and all(word.isdigit() for word in (words[0], *words[_NUM_HEAD:]))
        for number, words in enumerate(lines)
        # The last line may be cut off.
        if number == 0 or number < len(lines) - 1
    )


def _geometry(_: Head) -> ScanGeometry:
    return ScanGeometry(
        angle_min=-0.5 * (_NUM_BEAMS - 1) * _STEP_RAD,
        angle_increment=_STEP_RAD,
        num_beams=_NUM_BEAMS,
        range_min=0.02,
        range_max=_RANGE_MAX_M,
        tf_tracking_sensor=Pose(SCANNER_AHEAD_M, 0.0, 0.0),
        sensor="URG-04LX",
    )


def _parser(_: Head) -> Parse:
    pose = Pose(0.0, 0.0, 0.0)
    last: tuple[float, float] | None = None

    def parse(line: bytes) -> Reading | None:
        nonlocal pose, last
        if not line.strip():
            return None
        values = np.empty(_NUM_HEAD + _NUM_BEAMS)
        if parse_decimals(line, POWERS_OF_TEN, values) < 0:
            raise LineError(
                "line cut off or not a number",
                f"the line does not hold {_NUM_HEAD + _NUM_BEAMS} plain numbers",
            )
        left, right = float(values[2]), float(values[3])
        if last is not None:
            pose = compose(pose, wheel_motion(left - last[0], right - last[1]))
        last = left, right
        return Reading(1e-6 * float(values[0]), pose, 1e-3 * values[_NUM_HEAD:])

    return parse


def wheel_motion(left_ticks: float, right_ticks: float) -> Pose:
    """Return the motion, along an arc, of a robot whose wheels turned by these ticks."""
    per_tick = 2.0 * math.pi * WHEEL_RADIUS_M / TICKS_PER_TURN
    left, right = per_tick * left_ticks, per_tick * right_ticks
    distance, turn = 0.5 * (left + right), (right - left) / (2.0 * HALF_AXLE_M)
    return Pose(distance * math.cos(0.5 * turn), distance * math.sin(0.5 * turn), turn)


TINYSLAM = LineFormat("tinySLAM file", _recognise, _geometry, _parser)
