# SPDX-License-Identifier: Apache-2.0
"""Configuration from TOML files and ``--set key=value``, and back to TOML.

A key is the path of a parameter, joined by dots: ``local_slam.submaps.resolution``. Parameters that
are not given keep their defaults, also within a section that is given in part.
"""

from __future__ import annotations

import ast
import hashlib
import inspect
import json
import math
import re
import tomllib
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from difflib import SequenceMatcher
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from cartoloop.config import Config
from cartoloop.errors import ConfigError
from cartoloop.input_file import read_text_input

_MAX_BYTES = 1 << 20
"""Of a file of parameters: all of them with their meanings take 30 kB [bytes]."""

MACHINE_PARAMETERS = frozenset({"global_slam.num_threads"})
"""Parameters of how the machine is used: the result does not depend on them."""


@dataclass(frozen=True)
class LoadedConfig:
    """A configuration, and the origins of its values.

    Attributes
    ----------
    config : the effective configuration.
    origins : for each key that does not have its default: ``file NAME`` or ``--set``.
    """

    config: Config
    origins: dict[str, str]


def load_config(path: Path | None = None, settings: Sequence[str] = ()) -> LoadedConfig:
    """Return the defaults, changed by a TOML file, changed by settings ``key=value``.

    Raises
    ------
    ConfigError
        The file cannot be read or is no TOML, a key is unknown (the nearest one is named), or a
        value is of the wrong type or out of range.
    """
    values = _flatten(Config().model_dump())
    origins: dict[str, str] = {}
    if path is not None:
        text = read_text_input(path, _MAX_BYTES, "TOML", ConfigError)
        for key, value in _parse_toml(text, path).items():
            if fault := _fault(key, value, values):
                raise ConfigError(f"{path}{_line_of(key, text)}: {fault}")
            values[key] = value
            origins[key] = f"file {path.name}"
    for setting in settings:
        key, equals, written = setting.partition("=")
        key = key.strip()
        if not equals:
            raise ConfigError(f"--set {setting}: expected key=value")
        value = _parse_value(written.strip())
        if fault := _fault(key, value, values):
            raise ConfigError(f"--set {setting}: {fault}")
        values[key] = value
        origins[key] = "--set"
    return LoadedConfig(_validate(values, origins), origins)


def config_toml(
    config: Config, origins: Mapping[str, str] | None = None, without: Set[str] = frozenset()
) -> str:
    """Return a configuration as TOML, each value with its meaning, unit and origin.

    Parameters
    ----------
    config : what to write.
    origins : by key, the origin of the value; without them values are marked as set or default.
    without : keys to leave out.
    """
    if origins is None:
        defaults = _flatten(Config().model_dump())
        values = _flatten(config.model_dump())
        origins = {key: "set" for key, value in values.items() if value != defaults[key]}
    lines = [f"# {_docstring(Config)}"]
    _write_section(config, "", origins, without, lines)
    return "\n".join(lines) + "\n"


def flat_keys(config: Config) -> list[str]:
    """Return the keys of all parameters, like ``local_slam.submaps.resolution``."""
    return list(_flatten(config.model_dump()))


def config_hash(config: Config) -> str:
    """Return 16 hex digits that differ where parameters differ that matter to the result."""
    values = {
        key: value
        for key, value in _flatten(config.model_dump()).items()
        if key not in MACHINE_PARAMETERS
    }
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:16]


def changed_keys(config: Config, other: Config) -> list[str]:
    """Return the keys of the parameters that differ and matter to the result."""
    values, others = _flatten(config.model_dump()), _flatten(other.model_dump())
    return [
        key
        for key, value in values.items()
        if value != others[key] and key not in MACHINE_PARAMETERS
    ]


def _flatten(tree: Mapping[str, object], prefix: str = "") -> dict[str, object]:
    flat: dict[str, object] = {}
    for key, value in tree.items():
        if isinstance(value, Mapping):
            flat |= _flatten(value, f"{prefix}{key}.")
        else:
            flat[prefix + key] = value
    return flat


def _parse_toml(text: str, path: Path) -> dict[str, object]:
    try:
        return _flatten(tomllib.loads(text))
    except ValueError as error:  # also of numbers with too many digits
        raise ConfigError(f"{path}: is not valid TOML: {error}") from error
    except RecursionError:
        raise ConfigError(f"{path}: is nested too deeply; no parameter is") from None


def _line_of(key: str, text: str) -> str:
    """Return ``:line`` of the first line that seems to give a key; parsers do not report it."""
    leaf = re.escape(key.rpartition(".")[2])
    for number, line in enumerate(text.splitlines(), start=1):
        if re.match(rf"[\w\s.\"'{{]*\b{leaf}\b[\"']?\s*=", line):
            return f":{number}"
    return ""


def _parse_value(written: str) -> object:
    """Return a value as TOML reads it; other text is a string, and ``none`` is None."""
    if written.lower() == "none":
        return None
    try:
        parsed = tomllib.loads(f"value = {written}")
    except (ValueError, RecursionError):
        return written
    return parsed["value"] if len(parsed) == 1 else written


_MIN_LIKENESS = 1.5
"""Of a key that is proposed instead of an unknown one, of at most 3: misspelt keys reach 2."""


def _fault(key: str, value: object, known: Mapping[str, object]) -> str:
    """Return why there is no such parameter, or no parameter can have such a value; else ""."""
    if key not in known:
        if any(other.startswith(f"{key}.") for other in known):
            return f"'{key}' is a section; set one of the keys in it"
        nearest = _nearest(key, known)
        hint = (
            "'cartoloop config show' lists all" if nearest is None else f"did you mean '{nearest}'?"
        )
        return f"unknown key '{key}'; {hint}"
    if isinstance(value, float) and not math.isfinite(value):
        return f"{key} must be a finite number"
    return ""


def _nearest(key: str, known: Mapping[str, object]) -> str | None:
    """Return the known key that is most alike: the parent, or by the whole and its last part.

    None if no key is alike.
    """
    if (parent := key.rpartition(".")[0]) in known:
        return parent

    def likeness(other: str) -> float:
        leaf, other_leaf = key.rpartition(".")[2], other.rpartition(".")[2]
        return (
            SequenceMatcher(None, key.lower(), other).ratio()
            + 2.0 * SequenceMatcher(None, leaf.lower(), other_leaf).ratio()
        )

    best = max(known, key=likeness)
    return best if likeness(best) >= _MIN_LIKENESS else None


def _validate(values: Mapping[str, object], origins: Mapping[str, str]) -> Config:
    tree: dict[str, Any] = {}
    for key, value in values.items():
        *sections, leaf = key.split(".")
        branch = tree
        for section in sections:
            branch = branch.setdefault(section, {})
        branch[leaf] = value
    try:
        return Config.model_validate(tree)
    except ValidationError as error:
        fault = error.errors()[0]
        key = ".".join(str(part) for part in fault["loc"])
        origin = f" ({origins[key]})" if key in origins else ""
        message = fault["msg"].removeprefix("Input should be ").removeprefix("Value error, ")
        raise ConfigError(
            f"{key} = {fault['input']!r}{origin}: must be {message}: {_meaning(key)}"
            if fault["msg"].startswith("Input should be ")
            else f"{key}{origin}: {message}"
        ) from error


def _meaning(key: str) -> str:
    """Return what a parameter means, with its unit."""
    section: type[BaseModel] = Config
    *sections, leaf = key.split(".")
    for name in sections:
        annotation = section.model_fields[name].annotation
        assert isinstance(annotation, type)
        section = annotation
    return section.model_fields[leaf].description or leaf


def _write_section(
    section: BaseModel,
    prefix: str,
    origins: Mapping[str, str],
    without: Set[str],
    lines: list[str],
) -> None:
    subsections: list[tuple[str, BaseModel]] = []
    for name, field in type(section).model_fields.items():
        value, key = getattr(section, name), prefix + name
        if isinstance(value, BaseModel):
            subsections.append((key, value))
        elif key not in without:
            # TOML has no null value
            given = f"# {name} = none" if value is None else f"{name} = {_toml_value(value)}"
            lines.append(f"{given:<40}  # {field.description} ({origins.get(key, 'default')})")
    for key, subsection in subsections:
        lines += ["", f"[{key}]  # {_docstring(type(subsection)).splitlines()[0]}"]
        _write_section(subsection, f"{key}.", origins, without, lines)


def _docstring(section: type[BaseModel]) -> str:
    """Return what a section means, also where Python was started without docstrings (-OO)."""
    if section.__doc__:
        return section.__doc__
    for node in ast.parse(inspect.getsource(section)).body:
        if isinstance(node, ast.ClassDef) and (text := ast.get_docstring(node, clean=False)):
            return text
    return section.__name__


def _toml_value(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, tuple):
        return f"[{', '.join(map(_toml_value, value))}]"
    return repr(value)
