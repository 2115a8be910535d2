# SPDX-License-Identifier: Apache-2.0
"""A report as sections of text, tables and pictures, as Markdown and as HTML."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape

from bench.record import markdown_table

STYLE = """
:root { color-scheme: light dark; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 72rem; margin: 2rem auto; padding: 0 1rem; }
table { border-collapse: collapse; margin: 1rem 0; font-variant-numeric: tabular-nums; }
.wide { overflow-x: auto; }
th, td { padding: .25rem .75rem; border-bottom: 1px solid #8884; text-align: left; }
th { border-bottom: 2px solid #888; vertical-align: bottom; }
figure { margin: 1rem 0; }
img { max-width: 100%; background: white; }
figcaption, .foot { color: #777; }
"""


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
    parts : in order: paragraphs in Markdown (emphasis, code and links only), tables, pictures.
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


def to_html(title: str, sections: Sequence[Section]) -> str:
    """Return the report as one HTML page; pictures are links to their files."""
    body = [f"<h1>{escape(title)}</h1>"]
    for section in sections:
        body.append(f"<h{section.level}>{_inline(section.title)}</h{section.level}>")
        body += [_html_part(part) for part in section.parts]
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width">\n'
        f"<title>{escape(title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
        + "\n".join(body)
        + "\n</body>\n</html>\n"
    )


def _html_part(part: str | Table | Picture) -> str:
    if isinstance(part, Table):
        rows = "\n".join(_html_row("td", line) for line in part.lines)
        return (
            f'<div class="wide"><table>\n<thead>{_html_row("th", part.heads)}</thead>\n'
            f"<tbody>\n{rows}\n</tbody></table></div>"
        )
    if isinstance(part, Picture):
        caption = _inline(part.caption)
        return (
            f'<figure><img src="{escape(part.path)}" alt="{caption}" loading="lazy">'
            f"<figcaption>{caption}</figcaption></figure>"
        )
    return f"<p>{_inline(part)}</p>"


def _html_row(tag: str, cells: Sequence[str]) -> str:
    return "<tr>" + "".join(f"<{tag}>{_inline(cell)}</{tag}>" for cell in cells) + "</tr>"


def _inline(text: str) -> str:
    """Return the HTML of a line of Markdown: code, strong, emphasis, links."""
    html = escape(text, quote=False)
    html = re.sub(r"`([^`]+)`", r"<code>\1</code>", html)
    html = re.sub(r"\*\*([^*]+)\*\*", r"<strong>\1</strong>", html)
    html = re.sub(r"\*([^*]+)\*", r"<em>\1</em>", html)
    return re.sub(r"\[([^\]]+)\]\(([^)]+)\)", r'<a href="\2">\1</a>', html)
