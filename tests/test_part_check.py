# SPDX-License-Identifier: Apache-2.0
"""Parts on which few scans agree are examined more strictly."""

from __future__ import annotations

import pytest

from cartoloop.global_slam.join_evidence import GeometryCheck
from cartoloop.map_output.part_walls import WallFault
from cartoloop.part_check import STRICT_WALLS_M, strict_fault, wall_fault


def checked(length=50.0, on_floor=0.0):
    return GeometryCheck(length, 0.0, 1000 - round(1000 * on_floor), round(1000 * on_floor), "")


def walls(*lengths):
    return [WallFault(1.0, 2.0, length, 5.0) for length in lengths]


def test_parts_that_agree_pass():
    assert strict_fault(checked(), []) == ""
    assert strict_fault(checked(), walls(0.4)) == ""


def test_pieces_of_walls_count_together():
    fault = strict_fault(checked(length=10.0), walls(0.4, 0.3))
    assert "walls of 0.7 m in 2 pieces" in fault


@pytest.mark.parametrize(("length", "passes"), [(60.0, False), (130.0, True)])
def test_long_overlaps_may_have_more_of_them(length, passes):
    pieces = walls(0.7, 0.5)
    assert sum(piece.length for piece in pieces) > STRICT_WALLS_M
    assert (strict_fault(checked(length), pieces) == "") is passes


def test_returns_on_floor_are_limited():
    assert strict_fault(checked(on_floor=0.01), []) == ""
    assert "5% of the returns" in strict_fault(checked(on_floor=0.05), [])


def test_more_returns_on_floor_pass_where_they_are_usual():
    assert strict_fault(checked(on_floor=0.05), [], 0.05) == ""
    assert "few scans agree" in strict_fault(checked(on_floor=0.05), [], 0.03)


def test_a_wall_that_closes_a_corridor_forbids_a_join():
    assert wall_fault(walls(0.9), 1.2) == ""
    assert "a wall of 1.5 m at x 1.0, y 2.0" in wall_fault(walls(1.5, 0.4), 1.2)


def test_furniture_that_was_moved_forbids_none():
    wardrobe = WallFault(3.0, 4.0, 1.8, 12.0, closes=False)

    assert wall_fault([wardrobe, *walls(0.9)], 1.2) == ""
    assert "a wall of 1.5 m" in wall_fault([wardrobe, *walls(1.5)], 1.2)
