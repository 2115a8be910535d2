# SPDX-License-Identifier: Apache-2.0
"""The relations metric of table II."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path

import numpy as np
import pytest

from cartoloop.errors import InputError
from cartoloop.evaluation.relations import Relations, evaluate_relations, read_relations
from cartoloop.evaluation.trajectories import Trajectory

DATA = Path(os.environ.get("CARTOLOOP_DATA", Path(__file__).parents[2] / "../shared/data"))

# The robot goes 1 m along x, turns left on the spot, goes 2 m along y.
SQUARE = Trajectory(
    stamps=np.array([10.0, 11.0, 12.0]),
    poses=np.array([[0, 0, 0], [1, 0, math.pi / 2], [1, 2, math.pi / 2]]),
)


def relations_of(*rows):
    table = np.array(rows, dtype=float)
    return Relations(stamps=table[:, :2], poses=table[:, 2:])


def test_agrees_with_a_case_computed_by_hand():
    # 10 -> 11: estimated (1, 0, 90 deg). Expected (1.3, 0.4, 88 deg): 0.5 m and 2 deg off.
    # 11 -> 12: estimated (2, 0, 0), ahead being +y. Expected (2, -0.1, 4 deg): 0.1 m and 4 deg off.
    error = evaluate_relations(
        SQUARE,
        relations_of(
            (10, 11, 1.3, 0.4, math.radians(88)),
            (11, 12, 2.0, -0.1, math.radians(4)),
        ),
    )

    assert error.num_relations == 2
    assert error.num_missing == 0
    # mean (0.5 + 0.1) / 2; deviations +-0.2: sqrt(2 * 0.04 / 1)
    assert error.absolute_translational.mean == pytest.approx(0.3)
    assert error.absolute_translational.std == pytest.approx(math.sqrt(0.08))
    # 0.25 and 0.01: mean 0.13, deviations +-0.12
    assert error.squared_translational.mean == pytest.approx(0.13)
    assert error.squared_translational.std == pytest.approx(math.sqrt(2 * 0.12**2))
    # 2 and 4 deg
    assert error.absolute_rotational_deg.mean == pytest.approx(3.0)
    assert error.absolute_rotational_deg.std == pytest.approx(math.sqrt(2.0))
    # 4 and 16: mean 10, deviations +-6
    assert error.squared_rotational_deg2.mean == pytest.approx(10.0)
    assert error.squared_rotational_deg2.std == pytest.approx(math.sqrt(72.0))


def test_does_not_depend_on_where_the_map_lies():
    relations = relations_of((10, 12, 1.0, 2.0, 1.5), (12, 10, -2.0, 1.0, -1.5))
    moved = Trajectory(SQUARE.stamps, SQUARE.poses + np.array([100.0, -50.0, 0.0]))

    there, here = evaluate_relations(moved, relations), evaluate_relations(SQUARE, relations)

    assert there.absolute_translational.mean == pytest.approx(here.absolute_translational.mean)


def test_rotation_error_takes_the_short_way_round():
    error = evaluate_relations(SQUARE, relations_of((11, 12, 2, 0, math.radians(359))))

    assert error.absolute_rotational_deg.mean == pytest.approx(1.0)
    assert error.absolute_rotational_deg.std == 0.0


def test_relations_with_unknown_stamps_do_not_count():
    relations = relations_of((10, 11, 1, 0, 0), (10, 13, 0, 0, 0), (14, 13, 0, 0, 0))

    error = evaluate_relations(SQUARE, relations)

    assert error.num_relations == 1
    assert error.num_missing == 2
    assert error.missing_stamps == (13.0, 14.0)


def test_without_any_common_stamp_it_is_an_input_error():
    with pytest.raises(InputError, match="same recording"):
        evaluate_relations(SQUARE, relations_of((1, 2, 0, 0, 0)))


def test_converts_to_json_without_the_single_errors():
    error = evaluate_relations(SQUARE, relations_of((10, 11, 1, 0, 0)))

    found = json.loads(json.dumps(error.to_dict()))
    assert found["num_relations"] == 1
    assert list(found) == [
        "absolute_translational",
        "squared_translational",
        "absolute_rotational_deg",
        "squared_rotational_deg2",
        "num_relations",
        "num_missing",
        "missing_stamps",
        "absolute_translational_percentiles",
        "absolute_rotational_deg_percentiles",
    ]
    assert found["absolute_translational"] == {"mean": 0.0, "std": 0.0}
    assert list(found["absolute_rotational_deg_percentiles"]) == [
        "p50",
        "p75",
        "p90",
        "p95",
        "p99",
        "max",
    ]


def test_single_errors_are_those_of_counted_relations():
    error = evaluate_relations(
        SQUARE,
        relations_of(
            (10, 11, 1.3, 0.4, math.radians(88)),
            (10, 99, 0, 0, 0),
            (11, 12, 2.0, -0.1, math.radians(4)),
        ),
    )

    assert error.rows.tolist() == [0, 2]
    assert error.translations == pytest.approx([0.5, 0.1])
    assert error.rotations_deg == pytest.approx([2.0, 4.0])


def test_percentiles_are_by_translation_and_by_rotation():
    # off by 0, 1, ..., 100 cm and by 100, 99, ..., 0 mrad
    rows = [(10, 11, 1.0 + i / 100, 0.0, math.pi / 2 - (100 - i) / 1000) for i in range(101)]

    error = evaluate_relations(SQUARE, relations_of(*rows))

    assert error.absolute_translational_percentiles == pytest.approx(
        {"p50": 0.5, "p75": 0.75, "p90": 0.9, "p95": 0.95, "p99": 0.99, "max": 1.0}
    )
    assert error.absolute_rotational_deg_percentiles["p95"] == pytest.approx(math.degrees(0.095))


def test_reads_a_relations_file(tmp_path):
    path = tmp_path / "some.relations"
    path.write_text("# made by hand\n1.5 2.5 0.1 -0.2 0 0 0 0.3\n")

    relations = read_relations(path)

    assert relations.stamps.tolist() == [[1.5, 2.5]]
    assert relations.poses.tolist() == [[0.1, -0.2, 0.3]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 2 3 4\n", r":1: expected 8 numbers"),
        ("1 2 0 0 0 0 0 0\n1 2 0 0 0 0 0 yaw\n", r":2: expected 8 numbers"),
        ("", "is empty"),
    ],
)
def test_a_bad_relations_file_is_named_with_the_line(tmp_path, text, message):
    path = tmp_path / "bad.relations"
    path.write_text(text)

    with pytest.raises(InputError, match=r"bad\.relations" + f".*{message}"):
        read_relations(path)


def test_a_missing_relations_file_is_an_input_error(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        read_relations(tmp_path / "none.relations")


@pytest.mark.data
@pytest.mark.parametrize(("name", "count"), [("intel", 2984), ("mit-csail", 1172), ("fr079", 1685)])
def test_reads_the_published_files(name, count):
    path = DATA / "radish" / f"{name}.relations"
    if not path.exists():
        pytest.skip(f"{path} is absent: set CARTOLOOP_DATA to the folder of the recordings")

    assert len(read_relations(path).stamps) == count
