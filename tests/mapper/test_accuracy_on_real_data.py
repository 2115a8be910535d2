# SPDX-License-Identifier: Apache-2.0
"""Accuracy on a real recording; skipped where it is absent."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

import cartoloop
from bench.sessions import mapped, sessions_of
from cartoloop.evaluation.relations import evaluate_relations, read_relations
from cartoloop.evaluation.trajectories import read_tum

pytestmark = [pytest.mark.slow, pytest.mark.data]

DATA = Path(os.environ.get("CARTOLOOP_DATA", Path(__file__).parents[2] / "../shared/data"))


def test_mit_csail_is_as_accurate_as_in_the_paper(tmp_path):
    log, relations = (DATA / f"radish/mit-csail.{end}" for end in ("clf.gz", "relations"))
    if not (log.exists() and relations.exists()):
        pytest.skip(f"{log} is absent: set CARTOLOOP_DATA to the folder of the recordings")

    mapper = cartoloop.Mapper()
    for event in cartoloop.read(log):
        mapper.add(event)
    result = mapper.finish()
    result.save(tmp_path)
    error = evaluate_relations(
        read_tum(tmp_path / "trajectory.tum"), read_relations(relations), tolerance=5e-3
    )

    assert error.num_relations == 1172
    assert error.num_missing == 0
    assert error.absolute_translational.mean <= 0.0319
    assert error.absolute_rotational_deg.mean <= 0.353
    assert result.report.constraints.precision >= 0.95


def test_short_sessions_that_overlap_in_part_are_joined():
    log = DATA / "radish/mit-csail.clf.gz"
    if not log.exists():
        pytest.skip(f"{log} is absent: set CARTOLOOP_DATA to the folder of the recordings")

    tenths = sessions_of(list(cartoloop.read(log)), 10)
    # A few scans of either fit in the other; the others are found from there.
    merged = cartoloop.merge([mapped(tenths[5]), mapped(tenths[6])])

    assert [session.part for session in merged.sessions] == [0, 0]
    (join,) = merged.report.extra["joins"]
    assert join["agreeing_scans"] >= 4
    assert join["contradicted_m"] == 0.0
