# SPDX-License-Identifier: Apache-2.0
"""In CI the examples that Hypothesis tries are always the same, as in the product's tests."""

from __future__ import annotations

import os

from hypothesis import settings

settings.register_profile("ci", derandomize=True)
if os.environ.get("CI"):
    settings.load_profile("ci")
