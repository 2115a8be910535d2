# SPDX-License-Identifier: Apache-2.0
"""Reports of text, tables and pictures, as Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from bench.record import markdown_table


@dataclass(frozen=True, slots=True)
class Table:
    """Heads of the columns, and lines of cells in Markdown."""

    heads: Sequence[str]
    lines: Sequence[Sequence[str]]


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture by its path from the document's folder, and what it shows."""

    path: str
    caption: str


@dataclass(frozen=True, slots=True)
class Section:
    """A part of a report.

    Attributes
    ----------
    title : its heading.
    parts : in order: paragraphs in Markdown, tables, pictures.
    level : depth of the heading, 2 for one below the title.
    """

    title: str
    parts: Sequence[str | Table | Picture] = field(default_factory=tuple)
    level: int = 2


def to_markdown(title: str, sections: Sequence[Section]) -> str:
    """Return the report as Markdown."""
    blocks = [f"# {title}"]
    for section in sections:
        blocks.append(f"{'#' * section.level} {section.title}")
        for part in section.parts:
            if isinstance(part, Table):
                blocks.append(markdown_table(part.heads, part.lines))
            elif isinstance(part, Picture):
                blocks.append(f"![{part.caption}]({part.path})\n\n*{part.caption}*")
            else:
                blocks.append(part)
    return "\n\n".join(blocks) + "\n"
