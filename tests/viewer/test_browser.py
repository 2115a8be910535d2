# SPDX-License-Identifier: Apache-2.0
"""The browser of the tests draws, with no graphics card and no screen."""

from __future__ import annotations

import shutil

import pytest

from bench.browser import BROWSERS, NoBrowserError, browser

PIXEL = """() => {
    const gl = document.createElement("canvas").getContext("webgl2");
    gl.clearColor(1.0, 0.5, 0.25, 1.0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    const pixel = new Uint8Array(4);
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    return Array.from(pixel);
}"""


def test_missing_browser_is_reported(monkeypatch):
    monkeypatch.setattr("shutil.which", lambda name: None)

    with pytest.raises(NoBrowserError, match="no Chromium is installed: apt install"), browser():
        pass


def test_program_that_is_no_browser_is_reported(monkeypatch):
    pytest.importorskip("playwright")
    false = shutil.which("false")
    monkeypatch.setattr("shutil.which", lambda name: false if name == BROWSERS[0] else None)

    with pytest.raises(NoBrowserError) as error, browser():
        pass
    assert f"{false} does not start" in str(error.value)
    assert "\n" not in str(error.value)


def test_it_draws_with_webgl2(chromium):  # last: from here on it runs
    page = chromium.new_page()
    assert page.evaluate(PIXEL) in ([255, 127, 64, 255], [255, 128, 64, 255])
    page.close()
