# SPDX-License-Identifier: Apache-2.0
"""Offsets between the walls that different visits show, in rooms made by hand."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop.config import QualityConfig
from cartoloop.quality.pairs import path_lengths
from cartoloop.quality.walls import wall_offsets, wall_pieces
from cartoloop.sensor.pose import Pose, inverse, transform_points
from cartoloop.sensor.scan_points import ScanPoints

HALF = 4.1
CONFIG = QualityConfig()


def drive(rounds=3, shift=0.0, noise=0.0):
    """Return poses on a square in a square room, and scans; the last round is shifted by y."""
    rng = np.random.default_rng(5)
    along = np.linspace(-HALF, HALF, 200)
    walls = [(along, np.full(200, y)) for y in (-HALF, HALF)]
    walls += [(np.full(200, x), along) for x in (-HALF, HALF)]
    room = np.concatenate([np.column_stack(wall) for wall in walls])
    corners = np.array([(-2.0, -2.0), (2.0, -2.0), (2.0, 2.0), (-2.0, 2.0)])
    steps = np.linspace(0.0, 1.0, 10, endpoint=False)[:, np.newaxis]
    sides = [
        one + steps * (other - one)
        for one, other in zip(corners, np.roll(corners, -1, 0), strict=True)
    ]
    places = np.concatenate([np.concatenate(sides)] * rounds)
    poses = np.column_stack((places, np.linspace(0.0, 2.0 * np.pi * rounds, len(places))))
    scans = []
    for pose in poses:
        seen = room + rng.normal(0.0, noise, room.shape) if noise else room
        scans.append(transform_points(inverse(Pose(*pose)), seen))
    poses[-len(places) // rounds :, 1] += shift
    return poses, ScanPoints.of(scans)


def offsets(poses, scans):
    return wall_offsets(poses, scans, path_lengths(poses), CONFIG)


def test_visits_that_agree_show_walls_in_one_place():
    found = offsets(*drive(noise=0.01))

    assert len(found) > 50
    assert np.quantile(found, 0.9) < 0.01


@pytest.mark.parametrize("shift", [0.05, 0.1])
def test_a_visit_that_is_displaced_is_measured(shift):
    found = offsets(*drive(rounds=2, shift=shift, noise=0.01))

    across = found[found > 0.5 * shift]
    assert 0.3 < len(across) / len(found) < 0.7  # walls along y show nothing of it
    assert np.median(across) == pytest.approx(shift, abs=0.005)


def test_both_sides_of_a_thin_wall_are_two():
    wall = np.column_stack((np.linspace(-1.0, 1.0, 100), np.full(100, 0.06)))
    away = np.array([(30.0, 0.0, 0.0)] * 40)
    away[:, 1] = np.linspace(0.0, 40.0, 40)
    poses = np.concatenate(([(0.0, -2.0, 0.0)], away, [(0.0, 2.0, 0.0)]))
    near_side = wall - poses[0, :2]
    far_side = wall - (poses[-1, :2] - np.array((0.0, 0.12)))
    nothing = np.zeros((0, 2))
    scans = ScanPoints.of([near_side, *[nothing] * len(away), far_side])

    assert len(wall_pieces(poses, scans, path_lengths(poses), CONFIG).tile) > 4
    assert len(offsets(poses, scans)) == 0


def test_pieces_of_walls_face_the_scanner():
    poses, scans = drive(rounds=1)
    pieces = wall_pieces(poses, scans, path_lengths(poses), CONFIG)

    assert len(pieces.tile) > 20
    assert np.all(np.diff(pieces.tile) >= 0)
    np.testing.assert_allclose(np.linalg.norm(pieces.normal, axis=1), 1.0)
    assert np.all(np.einsum("ij,ij->i", pieces.normal, -pieces.middle) > 0.0)
    assert pieces.spread.max() < 1e-6


def test_a_map_without_returns_has_no_walls():
    nothing = ScanPoints.of([np.zeros((0, 2))] * 3)

    assert len(offsets(np.zeros((3, 3)), nothing)) == 0
