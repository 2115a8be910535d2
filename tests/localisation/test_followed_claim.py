# SPDX-License-Identifier: Apache-2.0
"""What is expected of the scans that follow a claim."""

from __future__ import annotations

import math

from cartoloop.config import LocalSlamConfig
from cartoloop.localisation.decision import Claim
from cartoloop.localisation.following import Following
from tests.localisation.rooms import ROOM, START, known_map


def test_a_low_agreement_at_a_claim_is_expected_later():
    known = known_map(ROOM)
    config = LocalSlamConfig()
    doubts = [
        Following(known, config, Claim(START, agreement), is_given=False).doubt
        for agreement in (math.nan, 0.7, 0.95)
    ]

    for doubt in doubts:
        for _ in range(10):
            doubt.add(0.7 / known.usual.agreement, 0.5, 0.5)

    assert [doubt.is_lost for doubt in doubts] == [True, False, True]
