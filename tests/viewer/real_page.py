# SPDX-License-Identifier: Apache-2.0
"""The page in a real browser, as tests handle it: they wait for what it shows, never for a time."""

from __future__ import annotations

import io
import os
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np
from PIL import Image

from tests.limits import LIMIT_S

SIZE = (960, 640)
"""Of the window: pictures of larger ones take the renderer without a graphics card longer."""

SCREENSHOTS = "CARTOLOOP_SCREENSHOTS"
"""Environment variable: a folder in which pictures of the page are kept, for the documentation."""

TIMEOUT_MS = 1000.0 * LIMIT_S


class RealPage:
    """A page in a browser, and all that it complained of."""

    def __init__(self, page):
        self.page = page
        self.complaints = []
        page.set_default_timeout(TIMEOUT_MS)
        page.on("console", self._note)
        page.on("pageerror", lambda error: self.complaints.append(str(error)))

    def _note(self, message):
        # The browser itself reports a missing server as an error.
        if message.type in ("error", "warning") and "WebSocket connection to" not in message.text:
            self.complaints.append(message.text)

    @property
    def state(self):
        return self.page.evaluate("cartoloop.state()")

    def wait(self, condition, argument=None):
        """Wait until a condition in JavaScript on the page's state `s` (and `x`) holds."""
        self.page.wait_for_function(
            f"x => {{ const s = globalThis.cartoloop?.state(); return s && ({condition}); }}",
            arg=argument,
            polling=50,
        )
        return self.state

    def settle(self, condition="true", argument=None):
        """Wait until a condition holds and all that there is has been drawn."""
        return self.wait(f"s.settled && ({condition})", argument)

    def look(self, x, y, scale, rotation=0.0):
        """Look at a point of the map [m] at a scale in pixels a metre."""
        wanted = {"x": x, "y": y, "scale": scale, "rotation": rotation}
        self.page.evaluate("view => { cartoloop.view = view; }", wanted)
        self.settle()

    @property
    def view(self):
        return self.page.evaluate("cartoloop.view")

    def to_screen(self, x, y):
        return self.page.evaluate("at => cartoloop.toScreen(at)", [x, y])

    def layers(self, **wanted):
        """Show, or do not show, layers; all others as they are."""
        self.page.click("#layers-button")
        for name, is_on in wanted.items():
            self.page.set_checked(f"[data-layer={name}]", is_on)
        self.page.click("#layers-button")

    def pixels(self):
        """Return the map as it is on the screen, with nothing before it, uint8 (rows, cols, 3)."""
        self.settle()
        taken = self.page.screenshot(style="body > :not(#map) { visibility: hidden !important; }")
        with Image.open(io.BytesIO(taken)) as picture:
            return np.asarray(picture.convert("RGB"))

    def keep(self, name):
        """Keep a picture for the documentation, if it is wanted."""
        if folder := os.environ.get(SCREENSHOTS):
            Path(folder).mkdir(parents=True, exist_ok=True)
            self.page.screenshot(path=Path(folder) / f"{name}.png")


@contextmanager
def opened(chromium, url, size=SIZE, changes=None, **options):
    """Yield the page at a URL in a window of its own; in the end it must not have complained.

    `changes` are to its modules, by their paths: what stands there, and what shall instead.
    """
    options.setdefault("bypass_csp", True)  # to wait for a condition is to evaluate text
    context = chromium.new_context(
        viewport={"width": size[0], "height": size[1]}, color_scheme="light", **options
    )
    try:
        real = RealPage(context.new_page())
        for path, pairs in (changes or {}).items():
            real.page.route(f"**/{path}", partial(_change, pairs))
        real.page.goto(url)
        yield real
        assert real.complaints == []
    finally:
        context.close()


def _change(pairs, route):
    response = route.fetch()
    text = response.text()
    for old, new in pairs.items():
        assert old in text
        text = text.replace(old, new)
    route.fulfill(response=response, body=text)
