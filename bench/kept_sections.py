# SPDX-License-Identifier: Apache-2.0
"""Sections of an earlier results page that stay where their benchmark was not run again."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence

_HEADING = re.compile(r"^## (.+)$", re.MULTILINE)


def sections_of(page: str) -> dict[str, str]:
    """Return the sections of level 2 of a page in Markdown, with their headings, by title."""
    found = list(_HEADING.finditer(page))
    ends = [match.start() for match in found[1:]] + [len(page)]
    return {
        match[1]: page[match.start() : end].rstrip() + "\n"
        for match, end in zip(found, ends, strict=True)
    }


def with_kept_sections(
    page: str, earlier: str, titles: Mapping[str, str], measured: Collection[str], first: str
) -> str:
    """Return a page with those sections of an earlier one whose benchmark has no record now.

    Parameters
    ----------
    page, earlier : Markdown.
    titles : of the sections of benchmarks that have one section each, in the order of the page.
    measured : benchmarks that have a record.
    first : the benchmark of all other sections.
    """
    new, old = sections_of(page), sections_of(earlier)
    introduction = next(iter(new))
    if introduction in old:
        new[introduction] = _with_kept_lines(new[introduction], old.get(introduction, ""))
    kept = {title for name, title in titles.items() if name not in measured}
    if first not in measured:
        kept |= old.keys() - set(titles.values()) - {introduction}
    for title in old:
        if title in kept and title not in new:
            new = _inserted(new, title, old[title], list(old))
    return page[: page.index("## ")] + "\n".join(new.values())


def _with_kept_lines(introduction: str, earlier: str) -> str:
    """Return the introduction, its table of commands with those that were not run again."""
    lines = introduction.splitlines()
    commands = {_first_cell(line) for line in lines}
    kept = [line for line in earlier.splitlines() if _first_cell(line).startswith("`")]
    return "\n".join([*lines, *(line for line in kept if _first_cell(line) not in commands)]) + "\n"


def _first_cell(line: str) -> str:
    return line.split("|")[1].strip() if line.startswith("|") else ""


def _inserted(
    sections: dict[str, str], title: str, text: str, order: Sequence[str]
) -> dict[str, str]:
    """Return sections with one more, behind the last of those that it came after."""
    before = set(order[: order.index(title)])
    place = max((k + 1 for k, name in enumerate(sections) if name in before), default=0)
    items = list(sections.items())
    return dict([*items[:place], (title, text), *items[place:]])
