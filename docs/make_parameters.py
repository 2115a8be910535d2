# SPDX-License-Identifier: Apache-2.0
"""Writes docs/parameters.md from the sources: all parameters, and all named numeric constants.

    python docs/make_parameters.py

The sources are parsed, not imported. Parameters are read from `config/`, constants from the
assignments at the top of modules; the meaning of a constant is the docstring under it, or the
comment behind it.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
PRODUCT = ROOT / "src" / "cartoloop"
PAGE = ROOT / "docs" / "parameters.md"

_NUMBERS = (int, float)
_ARITHMETIC = (
    ast.Constant, ast.BinOp, ast.UnaryOp, ast.Tuple, ast.Name, ast.Attribute, ast.Call,
    ast.operator, ast.unaryop, ast.expr_context,
)  # fmt: skip
_FUNCTIONS = {"math.radians", "np.radians", "np.float32", "np.float64", "math.sqrt", "math.log"}


class Entry(NamedTuple):
    """A row of the page."""

    place: str
    name: str
    value: str
    unit: str
    meaning: str


def page() -> str:
    """Return the page as Markdown."""
    lines = [
        "# Parameters and constants",
        "",
        "Made by `python docs/make_parameters.py`; do not edit.",
        "",
        "## Parameters",
        "",
        "Given in a TOML file or by `--set key=value`; see `src/cartoloop/config/`.",
        "",
        "| key | default | unit | meaning |",
        "|---|---|---|---|",
    ]
    lines += [
        f"| `{entry.name}` | {entry.value} | {entry.unit} | {entry.meaning} |"
        for entry in parameters(config_sections(), "Config", "", {})
    ]
    lines += [
        "",
        "## Constants",
        "",
        "What does not change the result, is derived, or is fixed by a file format or the paper.",
        "Paths are below `src/cartoloop/`.",
        "",
        "| module | name | value | unit | meaning |",
        "|---|---|---|---|---|",
    ]
    for path in sorted(PRODUCT.rglob("*.py")):
        lines += [
            f"| `{entry.place}` | `{entry.name}` | {entry.value} | {entry.unit} | {entry.meaning} |"
            for entry in constants(path)
        ]
    return "\n".join(lines) + "\n"


def config_sections() -> dict[str, ast.ClassDef]:
    """Return the sections of the configuration by the names of their classes."""
    return {
        node.name: node
        for path in (PRODUCT / "config").glob("*.py")
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.ClassDef)
    }


def parameters(
    sections: Mapping[str, ast.ClassDef], name: str, prefix: str, given: Mapping[str, ast.expr]
) -> Iterator[Entry]:
    """Yield the parameters of a section and of those in it.

    Parameters
    ----------
    given : defaults that differ in this place from those of the section's class.
    """
    for node in sections[name].body:
        if not (isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)):
            continue
        key, value = prefix + node.target.id, node.value
        if not isinstance(value, ast.Call) or not isinstance(value.func, ast.Name):
            continue
        options = {keyword.arg or "": keyword.value for keyword in value.keywords}
        if value.func.id in sections:
            yield from parameters(sections, value.func.id, f"{key}.", options)
        elif value.func.id == "Field":
            default = given.get(node.target.id, value.args[0])
            meaning = str(ast.literal_eval(options["description"]))
            yield Entry("", key, _code(ast.unparse(default)), _unit(meaning), _cell(meaning))


def constants(path: Path) -> Iterator[Entry]:
    """Yield the named numeric constants of a module, in its order."""
    text = path.read_text(encoding="utf-8")
    lines = text.splitlines()
    body = ast.parse(text).body
    for number, node in enumerate(body):
        target = node.targets[0] if isinstance(node, ast.Assign) else None
        if isinstance(node, ast.AnnAssign):
            target = node.target
        if not isinstance(target, ast.Name | ast.Tuple) or not isinstance(
            node, ast.Assign | ast.AnnAssign
        ):
            continue
        name = ast.unparse(target).strip("()")
        if name != name.upper() or node.value is None or not _is_numeric(node.value):
            continue
        meaning = _docstring(body[number + 1 : number + 3]) or _comment(lines, node)
        yield Entry(
            path.relative_to(PRODUCT).as_posix(),
            name,
            _code(ast.unparse(node.value)),
            _unit(meaning),
            _cell(meaning),
        )


def _is_numeric(value: ast.expr) -> bool:
    """Return whether an expression is arithmetic of numbers, with at least one number in it."""
    has_number = False
    for node in ast.walk(value):
        if not isinstance(node, _ARITHMETIC):
            return False
        if isinstance(node, ast.Call) and ast.unparse(node.func) not in _FUNCTIONS:
            return False
        if isinstance(node, ast.Constant):
            if isinstance(node.value, bool) or not isinstance(node.value, _NUMBERS):
                return False
            has_number = True
    return has_number


def _docstring(following: list[ast.stmt]) -> str:
    """Return the docstring under a constant; constants one under the other may share it."""
    for node in following:
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            return str(node.value.value)
        if not isinstance(node, ast.Assign):
            return ""
    return ""


def _comment(lines: list[str], node: ast.stmt) -> str:
    """Return the comment behind a constant, or the lines of comment above it."""
    behind = lines[(node.end_lineno or node.lineno) - 1].partition("  # ")[2]
    if behind:
        return behind
    above: list[str] = []
    number = node.lineno - 2
    while number >= 0 and lines[number].startswith("# "):
        above.insert(0, lines[number][2:])
        number -= 1
    return " ".join(above)


def _unit(meaning: str) -> str:
    """Return the first unit in brackets, without them."""
    found = re.search(r"\[([^\]\d][^\]]*)\]", meaning)
    return _cell(found[1]) if found else ""


def _code(text: str) -> str:
    return f"`{_cell(text)}`"


def _cell(text: str) -> str:
    """Return a text in one line, safe in a table."""
    return " ".join(text.split()).replace("|", "\\|")


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
