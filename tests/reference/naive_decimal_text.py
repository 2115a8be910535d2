# SPDX-License-Identifier: Apache-2.0
"""Slow and obvious twin of `cartoloop.kernels.decimal_text`."""

from __future__ import annotations

import re

_WORD = re.compile(rb"[+-]?(\d+\.?\d*|\.\d+)")


def parse_decimals(text: bytes, count: int) -> list[float] | None:
    """Return the first `count` numbers of a text, None if a word is no plain number."""
    words = text.split()[:count]
    if len(words) < count:
        return None
    for word in words:
        if not _WORD.fullmatch(word) or len(re.findall(rb"\d", word)) > 15:
            return None
    return [float(word) for word in words]
