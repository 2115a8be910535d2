# SPDX-License-Identifier: Apache-2.0
"""What the documents say of the code is so."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

from cartoloop.config import Config
from cartoloop.config_file import config_toml
from cartoloop.simulation import corridor, simulate
from tests.map_editing.edited_map import finished_map

ROOT = Path(__file__).parents[1]
DOCUMENTS = (
    "README.md",
    "ARCHITECTURE.md",
    "CONTRIBUTING.md",
    "docs/algorithm.md",
    "docs/readers.md",
    "docs/doctor.md",
    "docs/live.md",
    "docs/maps.md",
    "docs/editing.md",
    "docs/viewer.md",
    "docs/viewer-protocol.md",
    "bench/README.md",
)
PLACE = re.compile(r"`([\w/]+\.py)`(?::((?:,?\s+`\w+`)+))?")


def source(path):
    return next(p for p in (ROOT / "src/cartoloop" / path, ROOT / path) if p.exists())


@pytest.mark.parametrize("document", DOCUMENTS[1:4])
def test_files_and_names_in_documents_exist(document):
    places = PLACE.findall((ROOT / document).read_text())

    assert len(places) > 15
    for path, names in places:
        text = source(path).read_text()
        for name in re.findall(r"\w+", names):
            assert re.search(rf"^ *(def|class) {name}\b", text, re.MULTILINE), (path, name)


@pytest.mark.parametrize("document", DOCUMENTS)
def test_links_in_documents_lead_somewhere(document):
    path = ROOT / document
    links = re.findall(r"\]\(([^)#]+)\)", path.read_text())
    for link in links:
        if not link.startswith("http"):
            assert (path.parent / link).exists(), link


def test_parameters_in_documents_exist():
    def keys(tree):
        for key, value in tree.items():
            yield key
            if isinstance(value, dict):
                yield from keys(value)

    known = set(keys(Config().model_dump()))
    text = (ROOT / "docs/algorithm.md").read_text()
    named = set(re.findall(r"`([a-z]+_[a-z_]+)`", text)) - set(re.findall(r"def (\w+)", all_code()))

    assert named - known - {"found_precision", "loop_closure"} == set()
    assert tomllib.loads(config_toml(Config()))


def all_code():
    return "\n".join(path.read_text() for path in (ROOT / "src/cartoloop").rglob("*.py"))


def test_the_program_in_the_readme_runs(tmp_path, monkeypatch, capsys):
    program = re.search(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)[1]
    simulate(corridor(), seed=1, duration=10.0).write_carmen(tmp_path / "intel.clf.gz")
    monkeypatch.chdir(tmp_path)

    exec(program, {})

    assert "loops closed" in capsys.readouterr().out
    assert (tmp_path / "intel" / "map.png").exists()


def test_the_program_in_the_page_on_editing_runs(tmp_path, monkeypatch, capsys):
    page = (ROOT / "docs/editing.md").read_text()
    program = re.search(r"```python\n(.*?)```", page, re.DOTALL)[1]
    monkeypatch.chdir(tmp_path)
    finished_map().save("intel")

    exec(program, {})

    assert capsys.readouterr().out.splitlines()[-1].split()[0] in {"good", "doubtful", "wrong"}
