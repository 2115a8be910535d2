# SPDX-License-Identifier: Apache-2.0
"""Relations of changed recordings of the benchmark ``robustness``."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bench.robustness.carmen_text import CarmenText
from bench.robustness.changes import CHANGES, NothingLeft, changed_relations, check_relations_left
from cartoloop.evaluation.relations import Relations


def test_relations_after_the_end_of_a_map_are_reported():
    relations = Relations(np.array(((1.0, 2.0), (8.0, 9.0))), np.zeros((2, 3)))
    check_relations_left(relations, np.array((0.0, 2.0)), "aces, end600")
    with pytest.raises(NothingLeft, match="aces, end600: no verified relation"):
        check_relations_left(relations, np.array((0.0, 1.5)), "aces, end600")


def scans_of(num_beams, times=(0.0,)):
    """A log of scans with a number of beams."""
    return CarmenText(
        [],
        np.zeros((len(times), 3)),
        [np.ones(num_beams) for _ in times],
        [[str(time), "host", str(time)] for time in times],
    )


def test_relations_of_a_log_played_backwards_have_its_stamps():
    relations = Relations(np.array([(1.0, 5.0)]), np.array([(1.0, 2.0, 0.3)]))
    played = changed_relations(relations, CHANGES["backwards"], scans_of(180, (0.5, 1.0, 5.0)))
    assert played.stamps == pytest.approx(np.array([(4.5, 0.5)]))
    assert np.array_equal(played.poses, relations.poses)


def test_relations_of_a_mirrored_scanner_are_mirrored():
    poses = np.array([(1.0, 0.5, 0.2), (0.0, -2.0, -3.0)])
    relations = Relations(np.array([(1.0, 2.0), (3.0, 4.0)]), poses)
    symmetric = changed_relations(relations, CHANGES["mirror"], scans_of(361)).poses
    assert symmetric == pytest.approx(poses * (1.0, -1.0, -1.0))
    aside = math.radians(1.0)
    mirrored = poses * (1.0, -1.0, -1.0)
    cos, sin = math.cos(aside), math.sin(aside)
    turned = changed_relations(relations, CHANGES["mirror"], scans_of(180)).poses
    assert turned[:, 2] == pytest.approx(mirrored[:, 2])
    assert turned[:, :2] == pytest.approx(mirrored[:, :2] @ np.array([(cos, -sin), (sin, cos)]))


def test_lengths_of_relations_follow_longer_ranges():
    relations = Relations(np.array([(1.0, 2.0)]), np.array([(1.0, 2.0, 0.3)]))
    longer = changed_relations(relations, CHANGES["range101"], scans_of(180))
    assert longer.poses == pytest.approx(np.array([(1.01, 2.02, 0.3)]))
