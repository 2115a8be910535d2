# SPDX-License-Identifier: Apache-2.0
"""Kernels do without functions whose implementation takes half a second to load."""

from __future__ import annotations

import re
from pathlib import Path

import cartoloop

SLOW_TO_LOAD = re.compile(
    r"^[^#\n]*(\bnp\.(searchsorted|mean|median|sum|prod|cumsum|diff|interp|any|all|argmin|argmax)\("
    r"|\.(mean|sum|prod|cumsum|any|all|min|max|argmin|argmax)\()",
    re.MULTILINE,
)
"""Numba has them in numba.np.arraymath, which imports scipy.linalg."""


def test_no_kernel_needs_the_linear_algebra_of_scipy():
    folder = Path(cartoloop.__file__).parent / "kernels"
    found = {
        str(source.relative_to(folder)): match.group(1)
        for source in folder.rglob("*.py")
        if (match := SLOW_TO_LOAD.search(source.read_text(encoding="utf-8")))
    }
    assert found == {}
