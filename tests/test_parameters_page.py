# SPDX-License-Identifier: Apache-2.0
"""The page of parameters and constants is made of the sources as they are."""

from __future__ import annotations

import ast
import importlib.util
from pathlib import Path

import pytest

from cartoloop.config import Config
from cartoloop.config_file import config_toml
from cartoloop.pose_adjustment import Loss

SCRIPT = Path(__file__).parent.parent / "docs" / "make_parameters.py"


@pytest.fixture(scope="module")
def maker():
    spec = importlib.util.spec_from_file_location("make_parameters", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_page_of_parameters_is_up_to_date(maker):
    written = maker.PAGE.read_text(encoding="utf-8")
    assert written == maker.page(), "run: python docs/make_parameters.py"


def test_page_holds_every_parameter_with_its_default(maker):
    sections = maker.config_sections()
    found = {entry.name: entry.value for entry in maker.parameters(sections, "Config", "", {})}
    for key, value in found.items():
        at = Config()
        for name in key.split("."):
            at = getattr(at, name)
        text = value.strip("`")
        is_enum = text.startswith("Loss.")
        assert (Loss[text.removeprefix("Loss.")] if is_enum else ast.literal_eval(text)) == at
    assert len(found) == sum(
        " = " in line for line in config_toml(Config()).splitlines() if not line.startswith("[")
    )


def test_constants_come_with_value_unit_and_meaning(maker, tmp_path, monkeypatch):
    monkeypatch.setattr(maker, "PRODUCT", tmp_path)
    source = tmp_path / "some.py"
    source.write_text(
        'REACH = 2 * 5.0\n"""How far\nit reaches [m]."""\n\n_COUNT = 3  # of | them\n'
        'NAME = "text"\n'
        "lower = 1\nCOPY = REACH\n"
    )
    assert list(maker.constants(source)) == [
        ("some.py", "REACH", "`2 * 5.0`", "m", "How far it reaches [m]."),
        ("some.py", "_COUNT", "`3`", "", "of \\| them"),
    ]
