# SPDX-License-Identifier: Apache-2.0
"""Text that is shown: names of topics, frames, sensors and files are whatever their author chose.

A terminal obeys control characters, and a line break forges a line of the program.
"""

from __future__ import annotations

from typing import Any

# Control characters, marks that reverse the direction of the text, and other line breaks.
_CONTROLS = (*range(0x20), *range(0x7F, 0xA0), 0x200E, 0x200F, *range(0x2028, 0x202F),
             *range(0x2066, 0x206A))  # fmt: skip
_VISIBLE = {code: f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" for code in _CONTROLS} | {
    ord("\n"): "\\n",
    ord("\r"): "\\r",
    ord("\t"): "\\t",
}
_IN_LINES = {code: text for code, text in _VISIBLE.items() if chr(code) not in "\n\t"}


def one_line(text: str) -> str:
    """Return a text with every control character and line break made visible."""
    return text if text.isprintable() and text.isascii() else text.translate(_VISIBLE)


def plain_lines(text: str) -> str:
    """Return lines of text with every other control character made visible."""
    return text.translate(_IN_LINES)


def plain_values(content: Any) -> Any:  # noqa: ANN401 - values of JSON
    """Return values of JSON with all texts in one line each."""
    if isinstance(content, str):
        return one_line(content)
    if isinstance(content, list):
        return [plain_values(value) for value in content]
    if isinstance(content, dict):
        return {one_line(key): plain_values(value) for key, value in content.items()}
    return content
