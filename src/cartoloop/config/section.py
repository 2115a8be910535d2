# SPDX-License-Identifier: Apache-2.0
"""A group of parameters, and what is said where one of them is wrong."""

from __future__ import annotations

from difflib import get_close_matches
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from cartoloop.errors import ConfigError


class Section(BaseModel):
    """A group of parameters: no unknown keys, no change after it is made."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, validate_default=True, allow_inf_nan=False
    )

    def __init__(self, /, *others: object, **values: Any) -> None:  # noqa: ANN401
        """Set the parameters that are given; the others have their defaults.

        Raises
        ------
        ConfigError
            A parameter is unknown, or its value impossible.
        """
        name = type(self).__name__
        if others:
            raise ConfigError(f"{name}: name each parameter, like {name}(sensor={{...}})")
        try:
            super().__init__(**values)
        except ValidationError as error:
            raise ConfigError(f"{name}: {_first_fault(error, type(self))}") from None

    # A section within another is checked as a part of it, not by itself, as with pydantic's own.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    def __setattr__(self, name: str, value: object) -> None:
        raise ConfigError(
            f"{type(self).__name__}.{name}: a configuration does not change once it is made; make "
            "another, by cartoloop.Config(...) or model_copy(update={...})"
        )


def _first_fault(error: ValidationError, section: type[BaseModel]) -> str:
    """Return the first fault of values for a section in one line."""
    fault = error.errors()[0]
    *sections, leaf = map(str, fault["loc"])
    for part in sections:
        field = section.model_fields.get(part)
        if field is None or not isinstance(field.annotation, type):
            break
        section = field.annotation
    key = ".".join((*sections, leaf))
    if fault["type"] == "extra_forbidden":
        nearest = get_close_matches(leaf, section.model_fields, n=1, cutoff=0.5)
        hint = f"did you mean {nearest[0]}?" if nearest else "'cartoloop config show' lists all"
        return f"unknown parameter {key}; {hint}"
    message = fault["msg"].removeprefix("Value error, ")
    return f"{key} is {' '.join(repr(fault['input']).split())[:40]}: {message}"
