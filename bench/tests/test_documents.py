# SPDX-License-Identifier: Apache-2.0
from bench.document import Picture, Section, Table, to_html, to_markdown

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


def test_html_is_escaped_and_marked_up() -> None:
    page = to_html("Results & more", SECTIONS)
    assert "<title>Results &amp; more</title>" in page
    assert "<em>values</em> in <code>m</code>" in page
    assert '<a href="a.md">there</a> &amp; <strong>here</strong>' in page
    assert "<td>&lt;4.08&gt;</td>" in page
    assert '<img src="maps/a.png" alt="the flat"' in page
    assert "<h3>More</h3>" in page
