# SPDX-License-Identifier: Apache-2.0
"""The configuration in a file of an earlier or later version of the program."""

from __future__ import annotations

import json
from typing import Any

from pydantic import BaseModel

from cartoloop.config import Config


def config_of_json(saved: str) -> Config:
    """Return the configuration, with the present names of its keys.

    Parameters that only the program that wrote the file has are left out: they have no effect here.
    """
    content = json.loads(saved)
    sections = content if isinstance(content, dict) else {}
    search = sections.get("global_slam", {}).get("constraint_search", {})
    for old, new in _RENAMED.items():
        if old in search:
            search[new] = search.pop(old)
    return Config.model_validate(_known(content, Config))


def _known(content: Any, section: type[BaseModel]) -> Any:  # noqa: ANN401 - values of JSON
    """Return the content of a section without what it does not have."""
    if not isinstance(content, dict):
        return content
    known = {}
    for name, field in section.model_fields.items():
        if name in content:
            kind: Any = field.annotation
            is_section = isinstance(kind, type) and issubclass(kind, BaseModel)
            known[name] = _known(content[name], kind) if is_section else content[name]
    return known


_RENAMED = {
    "bound_length": "well_constrained_length",
    "every_nth_bound_node": "every_nth_well_constrained_node",
    "max_searches_of_bound_pair": "max_searches_of_well_constrained_pair",
}
"""Keys of ``global_slam.constraint_search``, before and now."""
