# SPDX-License-Identifier: Apache-2.0
"""The section on what bounds the speed, from records made by hand."""

from __future__ import annotations

from bench.document import Table
from bench.record import Figure, Record, Row
from bench.speed_bounds import speed_bounds


def row(case, **figures):
    named = {name.replace("_", " "): Figure.exact(value) for name, value in figures.items()}
    return Row(case, named)


def tables(**rows):
    section = speed_bounds({name: Record(name, tuple(each), {}) for name, each in rows.items()})
    assert section is not None
    return [part.lines for part in section.parts if isinstance(part, Table)]


def test_search_is_shown_per_node_and_point():
    case = {"source": "intel", "pairs": "miss"}
    rows = [
        row({"part": "points", "points": 100, **case}, search=0.5, nodes=20_000.0),
        row({"part": "threshold", **case}, search=0.7, nodes=9_000.0),
    ]
    assert tables(matching=rows) == [[["Intel", "miss", "100", "0.500", "20,000", "25", "4"]]]


def test_adjustment_is_shown_per_constraint_ours_first():
    case = {"graph": "museum", "edges": 1_000}
    rows = [
        row({**case, "solver": "g2o"}, time=2.0, iterations=3.0),
        row({**case, "solver": "cartoloop"}, time=0.2, iterations=1.0),
        Row({**case, "solver": "Ceres"}, {}, "not installed"),
        row({**case, "graph": "csail", "solver": "cartoloop"}, time=9.0, iterations=1.0),
    ]
    [lines] = tables(adjustment=rows)
    assert [(line[0], line[-1]) for line in lines] == [("cartoloop", "100"), ("g2o", "")]


def test_mapping_thread_excludes_other_threads():
    rows = [
        row({"experiment": "performance", "log": "aces"}, wall_clock=8.0, CPU=10.0),
        row({"experiment": "stages", "log": "aces", "stage": "match"}, total=3.0),
        row({"experiment": "stages", "log": "aces", "stage": "insert"}, total=2.0),
        *(
            row({"experiment": "stages", "log": "aces", "stage": stage}, total=7.0)
            for stage in ("search", "wait for searches", "match again")
        ),
    ]
    assert tables(paper=rows) == [[["ACES", "10", "8", "0.800", "5", "3"]]]


def test_without_records_there_is_no_section():
    assert speed_bounds({}) is None
    assert speed_bounds({"matching": Record("matching", (), {})}) is None
