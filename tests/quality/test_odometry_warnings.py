# SPDX-License-Identifier: Apache-2.0
"""Lines about odometry that was left out, or does not fit to what is declared."""

from __future__ import annotations

import math

import pytest

from cartoloop.quality.odometry_warnings import odometry_warnings

FAULT = {
    "begin": 12.3,
    "end": None,
    "kind": "stands still",
    "matched_m": 0.42,
    "odometry_m": 0.0,
    "matched_rad": 0.1,
    "odometry_rad": 0.0,
}
SETTLED = {
    "time_offset_s": 0.13,
    "rotation_scale": 1.1,
    "translation_scale": 1.02,
    "yaw_rad": 0.02,
    "rotation_error_rad": 0.01,
    "translation_error_m": 0.01,
    "metre_noise_m": 0.02,
    "measured_metres": 180,
    "jumps": 0,
    "readings": 2000,
    "turn_ratio": 0.93,
}


def test_sound_odometry_has_no_warnings():
    assert odometry_warnings(None) == []
    assert odometry_warnings({}) == []
    assert odometry_warnings(SETTLED) == []


def test_one_line_warns_of_odometry_that_was_left_out():
    assert odometry_warnings({"faults": [FAULT]}) == [
        "the odometry was left out from 12.3 s to the end: it stands still (0.00 m and 0.00 rad) "
        "where the scans move 0.42 m and 0.10 rad; check wheels and driver"
    ]
    [twice] = odometry_warnings({"faults": [FAULT | {"end": 20.0}, FAULT]})
    assert "left out 2 times, first from 12.3 s to 20.0 s: " in twice


def test_unsteady_odometry_is_not_said_to_differ():
    [line] = odometry_warnings({"faults": [FAULT | {"kind": "moves unsteadily"}]})

    assert line == (
        "the odometry was left out from 12.3 s to the end: it moves unsteadily, and predicts the "
        "scans worse than constant velocity does; check wheels and driver"
    )


@pytest.mark.parametrize(
    ("offset", "text"),
    [
        (-0.82, "it is 0.82 s older than the scan of the same stamp"),
        (0.4, "it is 0.40 s newer than the scan of the same stamp"),
        (0.13, "check wheels and driver"),
    ],
)
def test_a_long_delay_explains_what_was_left_out(offset, text):
    late = SETTLED | {"time_offset_s": offset}

    [line] = odometry_warnings(late | {"faults": [FAULT]})
    assert text in line
    assert odometry_warnings(late) == []


def test_a_delay_that_is_not_known_is_not_mentioned():
    late = SETTLED | {"time_offset_s": -0.82, "rotation_error_rad": None, "faults": [FAULT]}

    assert odometry_warnings(late)[0].endswith("check wheels and driver")


@pytest.mark.parametrize(
    ("degrees", "text"),
    [
        (19.0, "19 deg to the left of the x axis of its frame"),
        (-90.0, "90 deg to the right of the x axis of its frame"),
    ],
)
def test_a_wrong_yaw_is_named(degrees, text):
    [line] = odometry_warnings(SETTLED | {"yaw_rad": math.radians(degrees)})

    change = "smaller" if degrees > 0.0 else "larger"
    assert text in line
    assert f"it must be {math.radians(abs(degrees)):.2f} rad {change} (--laser-pose" in line


@pytest.mark.parametrize(
    "unsettled",
    [
        {"metre_noise_m": None},
        {"metre_noise_m": 1.0},
        {"measured_metres": 5},
        {"rotation_error_rad": None},
        {"turn_ratio": -1.0},
    ],
)
def test_a_yaw_that_is_not_settled_is_not_named(unsettled):
    assert odometry_warnings(SETTLED | {"yaw_rad": 0.3} | unsettled) == []


def test_a_wrong_yaw_may_be_why_it_was_left_out():
    fault, yaw = odometry_warnings(SETTLED | {"yaw_rad": 3.1, "faults": [FAULT]})

    assert fault.endswith("check the scanner's yaw, wheels and driver")
    assert "178 deg to the left" in yaw


@pytest.mark.parametrize(
    ("scales", "what"),
    [
        ({"translation_scale": 2.5}, "distances"),
        ({"translation_scale": 0.4}, "distances"),
        ({"rotation_scale": 2.5}, "turns"),
    ],
)
def test_a_scale_at_its_limit_shows_wrong_units(scales, what):
    fault, units = odometry_warnings(SETTLED | scales | {"yaw_rad": 0.3, "faults": [FAULT]})

    assert fault.endswith("check its units")
    assert units == (
        f"no factor from 0.4 to 2.5 makes the {what} of the odometry true; its units are probably "
        "wrong: metres and radians are expected"
    )


@pytest.mark.parametrize(
    ("jumps", "text"), [(1832, "is it in millimetres?"), (400, "check its units")]
)
def test_odometry_that_jumps_all_the_time_is_named(jumps, text):
    [line] = odometry_warnings(SETTLED | {"jumps": jumps, "readings": 1989})

    assert line == (
        f"the odometry was left out: {jumps} of its 1988 steps are longer than a robot moves, or "
        f"turn faster; {text}"
    )


def test_a_few_jumps_are_resets():
    assert odometry_warnings(SETTLED | {"jumps": 20}) == []
