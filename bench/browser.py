# SPDX-License-Identifier: Apache-2.0
"""A headless browser, for benchmarks and tests of the viewer's page."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import TYPE_CHECKING

from cartoloop.errors import CartoloopError

if TYPE_CHECKING:
    from playwright.sync_api import Browser

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
"""Names of programs that can be used."""

_START_TIMEOUT_MS = 60_000


class NoBrowserError(CartoloopError):
    """No browser can be used; the message says why."""


class PageFailed(CartoloopError):  # noqa: N818 - named for what happened
    """A page does not do what is expected."""


@contextmanager
def browser() -> Iterator[Browser]:
    """Yield a browser with software WebGL, so that pictures are the same on all machines.

    Raises
    ------
    NoBrowserError
        playwright or Chromium is not installed, or does not start.
    PageFailed
        A page failed to do something in time, or a command to it failed.
    """
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        raise NoBrowserError("no Chromium is installed: apt install chromium")
    if find_spec("playwright") is None:
        raise NoBrowserError("playwright is not installed: pip install 'cartoloop[dev]'")
    from playwright.sync_api import Error, sync_playwright

    arguments = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    arguments.append("--disable-gpu-rasterization")  # which would be by software too, and slower
    if hasattr(os, "geteuid") and os.geteuid() == 0:
        arguments.append("--no-sandbox")  # it does not start as root otherwise
    with sync_playwright() as playwright:
        try:
            started = playwright.chromium.launch(
                executable_path=program, args=arguments, timeout=_START_TIMEOUT_MS
            )
        except Error as error:
            raise NoBrowserError(
                f"{program} does not start: {error.message.splitlines()[0]}"
            ) from error
        try:
            yield started
        except Error as error:
            raise PageFailed(f"the page failed: {error.message.splitlines()[0]}") from error
        finally:
            started.close()
