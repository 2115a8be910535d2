# SPDX-License-Identifier: Apache-2.0
from bench.document import Picture, Section, Table, to_markdown

SECTIONS = (
    Section(
        "Table I",
        (
            "All *values* in `m`, see [there](a.md) & **here**.",
            Table(["tape", "map"], [["4.09", "<4.08>"]]),
            Picture("maps/a.png", "the flat"),
        ),
    ),
    Section("More", level=3),
)


def test_markdown_has_headings_tables_and_pictures() -> None:
    text = to_markdown("Results", SECTIONS)
    assert text.startswith("# Results\n\n## Table I\n\nAll *values*")
    assert "| 4.09 | <4.08> |" in text
    assert "![the flat](maps/a.png)" in text
    assert text.endswith("### More\n")
