# SPDX-License-Identifier: Apache-2.0
"""What a results page keeps of benchmarks that were not run again."""

from bench.document import Section, Table, to_markdown
from bench.kept_sections import sections_of, with_kept_sections

TITLES = {"robustness": "Robustness", "kernels": "Kernels", "live": "Live"}


def page(*names, value="1", others=()):
    commands = [[f"`python -m bench {name}`", value, "here"] for name in names]
    table = Table(["command", "date", "where"], commands)
    sections = [Section("How to get these figures", ("All of them.", table))]
    sections += [Section(title, (value,)) for title in others]
    sections += [
        Section(title, (value, Table(["a"], [[value]])))
        for name, title in TITLES.items()
        if name in names
    ]
    return to_markdown("Results", sections)


def kept(new, old, measured):
    return with_kept_sections(new, old, TITLES, measured, first="paper")


def test_a_section_without_a_record_stays_in_its_place():
    old = page("robustness", "kernels", "live")
    text = kept(page("kernels", value="2"), old, {"kernels"})

    assert list(sections_of(text)) == list(sections_of(old))
    assert sections_of(text)["Live"] == sections_of(old)["Live"]
    assert "| 2" in sections_of(text)["Kernels"]


def test_its_command_stays_in_the_table():
    text = kept(page("kernels", value="2"), page("robustness", "kernels"), {"kernels"})
    table = sections_of(text)["How to get these figures"]

    assert table.count("`python -m bench robustness`") == 1
    assert table.count("`python -m bench kernels`") == 1
    assert "| `python -m bench kernels` | 2" in table


def test_sections_that_are_no_longer_made_are_gone():
    old = page("paper", "kernels", others=["Table II", "Missing"])
    text = kept(page("paper", value="2", others=["Table II"]), old, {"paper"})

    assert list(sections_of(text)) == ["How to get these figures", "Table II", "Kernels"]


def test_all_other_sections_belong_to_the_paper():
    old = page("paper", "kernels", others=["Table II", "Missing"])
    text = kept(page("kernels", value="2"), old, {"kernels"})

    assert list(sections_of(text)) == list(sections_of(old))


def test_a_page_of_all_records_is_unchanged():
    new = page("robustness", "kernels", "live", value="2")

    assert kept(new, page("robustness", "kernels", "live"), set(TITLES)) == new
