# SPDX-License-Identifier: Apache-2.0
"""Simulated odometry that stands still, jumps, repeats itself, slips, is late or no number."""

import math

import numpy as np
import pytest

from cartoloop.errors import ConfigError
from cartoloop.sensor.pose import relative_all
from cartoloop.simulation import (
    LIDARS,
    PERFECT_ODOMETRY,
    Difficulties,
    OdometryFault,
    make_world,
    simulate,
)
from cartoloop.simulation.odometry_faults import (
    JUMP_LENGTHS,
    NUM_JUMPS,
    NUM_SLIPS,
    REPEATS,
    SLIP_LENGTH,
    VEER_RATES,
    fault_of,
)

RING = make_world("ring")
LIDAR = LIDARS["sick-180"]


def recorded(*faults, delay=0.0, seed=3):
    hard = Difficulties(odometry_faults=faults, odometry_delay=delay)
    return simulate(RING, LIDAR, seed=seed, duration=100.0, difficulties=hard)


SOUND = recorded().odometry_poses
STEPS = relative_all(SOUND[:-1], SOUND[1:])


def steps_of(recording):
    poses = recording.odometry_poses
    return relative_all(poses[:-1], poses[1:])


def changed_rows(recording):
    return np.flatnonzero(np.abs(steps_of(recording) - STEPS).max(axis=1) > 1e-9)


def test_frozen_odometry_never_moves():
    assert np.ptp(recorded(OdometryFault.FROZEN).odometry_poses, axis=0).tolist() == [0, 0, 0]


def test_odometry_frozen_later_is_sound_until_half_way():
    poses = recorded(OdometryFault.FROZEN_LATER).odometry_poses
    half = len(poses) // 2
    assert np.array_equal(poses[: half + 1], SOUND[: half + 1])
    assert np.ptp(poses[half:], axis=0).tolist() == [0, 0, 0]


def test_jumps_are_single_steps_of_metres():
    recording = recorded(OdometryFault.JUMP)
    rows = changed_rows(recording)
    assert len(rows) == NUM_JUMPS
    lengths = np.hypot(*(steps_of(recording) - STEPS)[rows, :2].T)
    assert (lengths >= JUMP_LENGTHS[0]).all()
    assert (lengths <= JUMP_LENGTHS[1]).all()


def test_repeated_readings_come_in_runs():
    poses = recorded(OdometryFault.REPEAT).odometry_poses
    moving = np.abs(STEPS).max(axis=1) > 1e-9
    repeated = moving & (np.abs(np.diff(poses, axis=0)).max(axis=1) == 0.0)
    assert repeated.mean() == pytest.approx(0.2, abs=0.12)
    rows = np.flatnonzero(repeated)
    assert len(rows) >= REPEATS - 1
    same = (poses == SOUND).all(axis=1)
    assert same[0]
    assert same[-1]


def test_readings_that_are_no_numbers_are_in_the_middle():
    poses = recorded(OdometryFault.NAN).odometry_poses
    missing = np.isnan(poses).all(axis=1)
    assert missing.mean() == pytest.approx(0.5, abs=0.01)
    assert np.array_equal(poses[~missing], SOUND[~missing])
    assert not missing[0]
    assert not missing[-1]


def test_slip_changes_the_steps_of_some_metres():
    recording = recorded(OdometryFault.SLIP)
    rows = changed_rows(recording)
    path = np.hypot(*np.diff(recording.true_poses[:, :2], axis=0).T)[rows].sum()
    assert path <= NUM_SLIPS * (SLIP_LENGTH + 0.3)
    assert path > SLIP_LENGTH - 0.3
    lengths = np.hypot(*steps_of(recording)[rows, :2].T)
    factors = lengths / np.hypot(*STEPS[rows, :2].T)
    assert ((factors < 0.5 + 1e-6) | (factors > 1.5 - 1e-6)).all()
    assert factors.max() < 2.5 + 1e-6


def test_veer_turns_the_same_on_each_metre():
    """To first order in the length of a step."""
    extra = (steps_of(recorded(OdometryFault.VEER)) - STEPS)[:, 2]
    driven = np.abs(STEPS[:, 0]) > 0.02
    rates = extra[driven] / STEPS[driven, 0]
    assert np.ptp(rates) < 1e-9
    assert VEER_RATES[0] <= abs(rates[0]) <= VEER_RATES[1]


def test_veer_of_a_synchro_drive_is_a_sine_of_the_heading():
    recording = recorded(OdometryFault.SYNCHRO)
    driven = np.abs(STEPS[:, 0]) > 0.02
    rates = (steps_of(recording) - STEPS)[driven, 2] / STEPS[driven, 0]
    middle = (recording.odometry_poses[:-1, 2] + 0.5 * STEPS[:, 2])[driven]
    sines = np.column_stack((np.cos(middle), np.sin(middle)))
    factors = np.linalg.lstsq(sines, rates, rcond=None)[0]
    assert sines @ factors == pytest.approx(rates, abs=1e-9)
    assert VEER_RATES[0] <= np.hypot(*factors) <= VEER_RATES[1]


@pytest.mark.parametrize("fault", list(OdometryFault))
def test_faults_follow_from_the_seed_and_leave_the_scans_alone(fault):
    one, same = recorded(fault), recorded(fault)
    assert np.array_equal(one.odometry_poses, same.odometry_poses, equal_nan=True)
    assert np.array_equal(one.stamps, recorded().stamps)
    assert next(one.range_blocks())[1].tobytes() == next(recorded().range_blocks())[1].tobytes()


def test_late_odometry_is_that_of_an_earlier_time():
    sound, late = (
        simulate(RING, LIDAR, PERFECT_ODOMETRY, duration=50.0, difficulties=hard).odometry_poses
        for hard in (Difficulties(), Difficulties(odometry_delay=0.4))
    )
    assert late[2:] == pytest.approx(sound[:-2], abs=1e-9)


def test_a_log_holds_readings_that_are_no_numbers(tmp_path):
    recorded(OdometryFault.NAN).write_log(tmp_path / "a.log")
    lines = (tmp_path / "a.log").read_text().splitlines()
    assert sum("nan nan nan" in line for line in lines) == pytest.approx(250, abs=2)


def test_an_unknown_fault_is_refused_with_the_nearest_name():
    assert fault_of("slip") is OdometryFault.SLIP
    with pytest.raises(ConfigError, match=r"'slipp'.*nearest: slip"):
        fault_of("slipp")


def test_several_faults_come_together():
    poses = recorded(OdometryFault.SLIP, OdometryFault.FROZEN_LATER).odometry_poses
    assert len(poses) == len(SOUND)
    assert math.isfinite(poses.sum())
    assert np.ptp(poses[len(poses) // 2 :], axis=0).tolist() == [0, 0, 0]
