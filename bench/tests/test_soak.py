# SPDX-License-Identifier: Apache-2.0
"""A robot's day with faults: every scan is mapped or counted."""

from __future__ import annotations

import pytest

from bench.soak import SOURCES, soak

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("kind", SOURCES)
def test_every_scan_of_a_bad_day_is_mapped_or_counted(kind, tmp_path):
    result = soak(kind, hours=0.1, num_faults=40, out=tmp_path)
    assert sum(result.faults.values()) in (39, 40)
    assert len(result.faults) == 6
    assert result.sent > 1700
    assert result.unaccounted == 0, result.table()
    assert (tmp_path / "map.cartoloop").exists()
