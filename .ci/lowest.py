# SPDX-License-Identifier: Apache-2.0
"""Print the lowest versions that ``pyproject.toml`` admits for this version of Python.

``pip install $(python .ci/lowest.py)`` installs them; with names of extras, theirs too.
"""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path

from pip._vendor.packaging.requirements import Requirement
from pip._vendor.packaging.version import Version


def main() -> None:
    """Print one ``name==version`` a line."""
    project = tomllib.loads(Path("pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    lines = [*project["dependencies"], *(line for name in sys.argv[1:] for line in extras[name])]
    lowest: dict[str, Version] = {}
    for line in lines:
        requirement = Requirement(line)
        if requirement.marker is not None and not requirement.marker.evaluate():
            continue
        bounds = [Version(s.version) for s in requirement.specifier if s.operator == ">="]
        lowest[requirement.name] = max([*bounds, lowest.get(requirement.name, Version("0"))])
    print(*(f"{name}=={version}" for name, version in lowest.items()), sep="\n")  # noqa: T201


if __name__ == "__main__":
    main()
