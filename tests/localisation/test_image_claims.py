# SPDX-License-Identifier: Apache-2.0
"""In an image, a place is claimed without rivals, and where more than straight walls agrees."""

from __future__ import annotations

import pytest

from cartoloop.localisation.claim_needs import APART_MARGIN
from cartoloop.localisation.fit import Fit
from cartoloop.localisation.image_claims import APART_PATH_M, is_apart
from tests.localisation.rooms import ROOM, known_map


def fit(agreement, distinctness, detail):
    return Fit(0.5, agreement, distinctness, 1000, detail)


@pytest.mark.parametrize(
    ("path", "score", "runner_up", "agreement", "distinctness", "detail"),
    [
        (0.9, 1.0, 0.7, 0.95, 0.7, 0.8),
        (1.1, 0.7, 0.3, 0.95, 0.7, 0.8),
        (1.1, 1.0, 0.9, 0.95, 0.7, 0.8),
        (1.1, 1.0, 0.7, 0.7, 0.7, 0.8),
        (1.1, 1.0, 0.7, 0.95, 0.5, 0.8),
        (1.1, 1.0, 0.7, 1.08, 0.7, 0.2),
    ],
)
def test_only_a_place_without_rivals_is_apart(
    path, score, runner_up, agreement, distinctness, detail
):
    image = known_map(ROOM)
    usual = image.usual
    found = fit(0.95 * usual.agreement, 0.7 * usual.distinctness, 0.8)
    poor = fit(agreement * usual.agreement, distinctness * usual.distinctness, detail)

    good = (1.1 * APART_PATH_M, usual.score, (0.99 - APART_MARGIN) * usual.score, found)
    assert is_apart(image, *good)
    limits = (path * APART_PATH_M, score * usual.score, runner_up * usual.score)
    assert not is_apart(image, *limits, poor)
    image.has_own_fits = True
    assert not is_apart(image, *good)


@pytest.mark.parametrize(
    ("detail", "margin", "is_claimed"),
    [(0.3, 0.25, False), (0.5, 0.25, True), (0.3, 0.31, True), (0.7, 0.21, False)],
)
def test_where_straight_walls_agree_more_must_be_apart(detail, margin, is_claimed):
    image = known_map(ROOM)
    usual = image.usual
    found = fit(0.84, usual.distinctness, detail)

    assert found.detailed_agreement == pytest.approx(detail / (detail + 0.16))
    runner_up = (1.0 - margin) * usual.score
    assert is_apart(image, 2.0 * APART_PATH_M, usual.score, runner_up, found) == is_claimed
