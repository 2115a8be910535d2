# SPDX-License-Identifier: Apache-2.0
"""Texts and names are plain technical English: see ``docs/glossary.md``, "Words not used"."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SEARCHED = ("src", "tests", "bench", "docs", "examples", "README.md", "ARCHITECTURE.md")
SUFFIXES = {".py", ".js", ".html", ".css", ".md", ".toml", ".sh", ".cpp", ".h"}
NOT_SEARCHED = {"docs/glossary.md", "docs/results.md", "tests/test_glossary.py"}
"""The glossary and this test name the words; the results are generated."""

NOT_USED = (
    "sought", "seek", "seeks", "told", "tell", "tells", "anew", "so many", "of which", "of whom",
    "whoever", "lest", "nought", "wherefore", "at the most", "need not", "ways", "tied", "ties",
    "pull", "pulls", "wane", "wanes",
)  # fmt: skip
MEANINGS_ALLOWED = ("way", "tie", "bound pair", "bound")
"""In the table for one of their meanings, which a search for the word does not see."""

WORD = re.compile(
    r"(?<![a-z])(" + "|".join(word.replace(" ", r"\s+") for word in NOT_USED) + r")(?![a-z])",
    re.IGNORECASE,
)
CAMEL = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")
MAX_NAME = 60


def files():
    for place in SEARCHED:
        path = ROOT / place
        for file in [path] if path.is_file() else sorted(path.rglob("*")):
            name = file.relative_to(ROOT).as_posix()
            if file.suffix in SUFFIXES and name not in NOT_SEARCHED:
                yield name, file.read_text(encoding="utf-8")


def test_words_not_used_do_not_occur():
    found = [
        f"{name}:{number}: {match[1]}"
        for name, text in files()
        for number, line in enumerate(text.splitlines(), 1)
        for match in WORD.finditer(CAMEL.sub("_", line))
    ]

    assert not found, f"{len(found)} words of the glossary's 'Words not used':\n" + "\n".join(found)


def test_words_are_those_of_the_glossary():
    table = (ROOT / "docs/glossary.md").read_text(encoding="utf-8").split("## Words not used")[1]
    cells = [line.split("|")[1] for line in table.splitlines() if line.startswith("| ")][1:]
    words = {word.strip() for cell in cells for word in re.sub(r"\(.*?\)", "", cell).split(",")}

    assert words == set(NOT_USED) | set(MEANINGS_ALLOWED)


@pytest.mark.parametrize("folder", ["tests", "bench/tests"])
def test_names_of_tests_are_short(folder):
    found = [
        f"{path.relative_to(ROOT)}: {name}"
        for path in sorted((ROOT / folder).rglob("test_*.py"))
        for name in re.findall(r"def (test_\w+)", path.read_text(encoding="utf-8"))
        if len(name) >= MAX_NAME
    ]

    assert not found, f"{len(found)} names of {MAX_NAME} characters or more:\n" + "\n".join(found)
