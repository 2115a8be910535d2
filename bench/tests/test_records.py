# SPDX-License-Identifier: Apache-2.0
import pytest

from bench.comparison import changes_table, compare, gone
from bench.measuring import alternate
from bench.record import Figure, Record, Row, format_number
from cartoloop.errors import InputError


def record(**figures: Figure) -> Record:
    return Record("some", (Row({"size": 3}, figures),), {"python": "3"})


def test_figure_of_samples_is_the_median_with_the_quantiles() -> None:
    figure = Figure.of_samples([float(sample) for sample in range(11)], "ms")
    assert (figure.value, figure.low, figure.high, figure.repeats) == (5.0, 1.0, 9.0, 11)


def test_single_sample_has_no_spread() -> None:
    assert Figure.of_samples([2.0], "s") == Figure(2.0, "s")


def test_record_survives_json() -> None:
    rows = (
        Row({"log": "a", "points": 180}, {"time": Figure.of_samples([1.0, 2.0], "ms")}),
        Row({"log": "b", "points": 180}, notes="no data"),
    )
    before = Record("paper", rows, {"commit": "abc"})
    assert Record.from_json(before.to_json()) == before
    assert not before.is_complete


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"format": 1}', '{"format": 1, "rows": 3}'])
def test_other_text_is_refused_with_the_name_of_the_file(text: str) -> None:
    with pytest.raises(InputError, match=r"old\.json: is not a record"):
        Record.from_json(text, "old.json")


def test_record_of_another_format_is_refused() -> None:
    text = record(time=Figure(1.0)).to_json().replace('"format": 1', '"format": 99')
    with pytest.raises(InputError, match="format 99"):
        Record.from_json(text)


def test_table_has_a_column_for_each_case_and_figure() -> None:
    rows = (
        Row({"log": "a"}, {"time": Figure(1.234, "ms", 1.0, 1.5, 5), "nodes": Figure.exact(12)}),
        Row({"log": "b|c"}, notes="missing"),
    )
    table = Record("some", rows).to_table().splitlines()
    assert [cell.strip() for cell in table[0].split("|")[1:-1]] == [
        "log", "time [ms]", "nodes", "notes",
    ]  # fmt: skip
    assert "1.23 ± 0.25" in table[2]
    assert "b\\|c" in table[3]
    assert len({len(line) for line in table}) == 1


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0"), (12.0, "12"), (11456.0, "11,456"), (0.03194, "0.0319"), (1234.5, "1,234")],
)
def test_numbers_keep_three_digits(value: float, text: str) -> None:
    assert format_number(value) == text


def test_change_within_the_noise_is_none() -> None:
    before = record(time=Figure(10.0, "ms", 9.0, 12.0, 9))
    assert compare(record(time=Figure(11.5, "ms", 11.0, 13.0, 9)), before) == []


def test_slower_than_noise_is_worse_faster_is_better() -> None:
    before = record(time=Figure(10.0, "ms", 9.0, 12.0, 9))
    (slower,) = compare(record(time=Figure(14.0, "ms", 13.0, 15.0, 9)), before)
    (faster,) = compare(record(time=Figure(5.0, "ms", 4.0, 6.0, 9)), before)
    assert slower.is_worse
    assert not faster.is_worse
    assert "WORSE" in changes_table([slower])


def test_less_is_worse_where_more_is_better() -> None:
    before = record(precision=Figure.exact(0.9, better="more"))
    (change,) = compare(record(precision=Figure.exact(0.8, better="more")), before)
    assert change.is_worse


def test_any_change_of_an_exact_figure_counts() -> None:
    (change,) = compare(
        record(error=Figure.exact(0.0291, "m")), record(error=Figure.exact(0.029, "m"))
    )
    assert change.is_worse


def test_figure_measured_once_counts_from_a_quarter_on() -> None:
    before = record(time=Figure(10.0, "s"))
    assert compare(record(time=Figure(11.0, "s")), before) == []
    assert len(compare(record(time=Figure(14.0, "s")), before)) == 1


def test_figures_without_a_better_direction_are_not_judged() -> None:
    before = record(nodes=Figure.exact(10, better=None))
    assert compare(record(nodes=Figure.exact(20, better=None)), before) == []


def test_case_that_lost_its_figures_is_reported() -> None:
    assert gone(Record("some", (Row({"size": 3}, notes="no data"),)), record(time=Figure(1.0))) == [
        "size 3"
    ]


def test_programs_are_timed_in_turn_after_one_untimed_call() -> None:
    calls: list[str] = []
    samples = alternate(
        {"a": lambda: calls.append("a"), "b": lambda: calls.append("b")},
        repeats=3,
        min_sample_s=0.0,
    )
    assert {name: len(times) for name, times in samples.items()} == {"a": 3, "b": 3}
    assert "".join(calls) == "aabb" + "ab" * 3
    assert all(time > 0.0 for times in samples.values() for time in times)


def test_spread_over_inputs_is_not_taken_for_noise() -> None:
    inputs = [[1.0, 1.1, 0.9], [10.0, 10.5, 9.5], [100.0, 101.0, 99.0]]
    before = record(time=Figure.of_inputs(inputs, "ms"))
    assert (before.rows[0].figures["time"].value, before.rows[0].figures["time"].high) == (10, 82)
    slower = [[1.3 * sample for sample in samples] for samples in inputs]
    (change,) = compare(record(time=Figure.of_inputs(slower, "ms")), before)
    assert change.is_worse
    again = [[1.02 * sample for sample in samples] for samples in inputs]
    assert compare(record(time=Figure.of_inputs(again, "ms")), before) == []


def test_counts_over_inputs_are_exact() -> None:
    before = record(nodes=Figure.exact_of_inputs([10, 200, 3000]))
    assert compare(before, before) == []
    assert len(compare(record(nodes=Figure.exact_of_inputs([10, 201, 3000])), before)) == 1


def test_input_timed_once_counts_from_a_quarter_on() -> None:
    before = record(time=Figure.of_inputs([[1.0], [10.0], [90.0]], "s"))
    assert compare(record(time=Figure.of_inputs([[1.0], [11.0], [90.0]], "s")), before) == []
    assert len(compare(record(time=Figure.of_inputs([[1.0], [14.0], [90.0]], "s")), before)) == 1


def test_rows_that_were_not_measured_again_are_kept() -> None:
    def part(name: str, value: float, commit: str) -> Record:
        row = Row({"what": name, "drive": "a"}, {"time": Figure(value)})
        return Record("some", (row,), {"commit": commit})

    both = part("far", 2.0, "one").with_rows_of(part("near", 1.0, "one"))
    again = part("far", 3.0, "two").with_rows_of(both)

    assert [(row.case["what"], row.notes) for row in both.rows] == [("near", ""), ("far", "")]
    assert [row.figures["time"].value for row in again.rows] == [1.0, 3.0]
    assert [row.notes for row in again.rows] == ["measured at one", ""]
    assert again.environment == {"commit": "two"}


def test_a_row_keeps_its_note_beside_that_on_its_commit() -> None:
    missing = Record("some", (Row({"what": "a"}, {}, "nothing there"),), {"commit": "one"})
    second = Record("some", (), {"commit": "two"}).with_rows_of(missing)
    third = Record("some", (), {"commit": "three"}).with_rows_of(second)

    assert [row.notes for row in third.rows] == ["nothing there; measured at one"]
