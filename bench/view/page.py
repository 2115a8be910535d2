# SPDX-License-Identifier: Apache-2.0
"""The page in a browser with software WebGL: times until it shows the map, and its frame rate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench.view.clients import Seen

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

SIZE = {"width": 1280, "height": 800}

PAN_S = 4.0
"""Duration of panning [s]."""

_TIMEOUT_MS = 60_000

# Counts bytes until COMPLETE (12), and loop closures (kind 1) in CONSTRAINTS (7), with the time of
# the frame after they arrived.
_LISTEN = """(() => {
  const heard = window.cartoloopHeard = { bytes: 0, isComplete: false, closures: [] };
  let closures = 0;
  const take = (buffer) => {
    const view = new DataView(buffer);
    if (!heard.isComplete) heard.bytes += buffer.byteLength;
    for (let at = 0; at < buffer.byteLength;) {
      const length = view.getUint32(at, true);
      const type = view.getUint16(at + 4, true);
      if (type === 12) heard.isComplete = true;
      if (type === 7) {
        const [first, count] = [view.getUint32(at + 8, true), view.getUint32(at + 12, true)];
        const kinds = new Uint8Array(buffer, at + 24 + 20 * count, count);
        const added = kinds.filter((kind) => kind === 1).length;
        const number = closures = added + (first ? closures : 0);
        requestAnimationFrame(() => requestAnimationFrame(
          () => heard.closures.push([number, Date.now() / 1000])));
      }
      at += 8 + Math.ceil(length / 8) * 8;
    }
  };
  window.WebSocket = class extends WebSocket {
    constructor(...given) {
      super(...given);
      this.addEventListener("message", (event) => take(event.data));
    }
  };
})()"""

_FRAMES = """() => {
  const frames = window.cartoloopFrames = [];
  const note = (now) => { frames.push(now); requestAnimationFrame(note); };
  requestAnimationFrame(note);
}"""

_MARK = "name => performance.getEntriesByName(name).length > 0"
_TIME = "name => performance.getEntriesByName(name)[0].startTime / 1000"


@dataclass(frozen=True, slots=True)
class PageRun:
    """The cost of showing a finished map in a browser.

    Attributes
    ----------
    picture_s : from the connection to the first full picture [s].
    sharp_s : from the connection until all visible cells are drawn at full resolution [s].
    opening_s : from opening the page to that [s].
    sent_mb : sent until it was complete [MB].
    frames_per_s : while panning.
    frames_within_ms : 99 % quantile of the times of these frames [ms].
    """

    picture_s: float
    sharp_s: float
    opening_s: float
    sent_mb: float
    frames_per_s: float
    frames_within_ms: float


def open_page(browser: Browser, url: str) -> Page:
    """Return the page at a URL, in a window of its own, with a listener to its messages."""
    page = browser.new_page(viewport=SIZE, bypass_csp=True)  # type: ignore[arg-type]
    page.set_default_timeout(_TIMEOUT_MS)
    page.add_init_script(_LISTEN)
    page.goto(url)
    return page


def show_map(browser: Browser, url: str) -> PageRun:
    """Return the cost of showing the finished map at a URL."""
    page = open_page(browser, url)
    for name in ("cartoloop:complete", "cartoloop:first-picture"):
        page.wait_for_function(_MARK, arg=name)
    joined, picture = (
        float(page.evaluate(_TIME, name))
        for name in ("cartoloop:joined", "cartoloop:first-picture")
    )
    num_bytes = int(page.evaluate("cartoloopHeard.bytes"))
    page.wait_for_function("cartoloop.state().settled")  # background drawing is done
    sharp = float(page.evaluate("performance.now()")) / 1000.0
    intervals = _pan(page)
    page.close()
    return PageRun(
        picture - joined,
        sharp - joined,
        picture,
        num_bytes / 1e6,
        1000.0 / float(np.mean(intervals)),
        float(np.quantile(intervals, 0.99)),
    )


def _pan(page: Page) -> list[float]:
    """Pan the map; return the times between frames [ms]."""
    x, y = SIZE["width"] / 2, SIZE["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.evaluate(_FRAMES)
    start = float(page.evaluate("performance.now()"))
    step = 0
    while float(page.evaluate("performance.now()")) - start < 1000.0 * PAN_S:
        step += 1
        angle = 0.02 * step
        page.mouse.move(x + 300.0 * np.sin(angle), y + 200.0 * np.sin(1.3 * angle))
    page.mouse.up()
    frames = [float(frame) for frame in page.evaluate("cartoloopFrames")]
    return np.diff(frames).tolist()


def closures_seen(page: Page) -> list[Seen]:
    """Return the numbers of loop closures on the page with the times."""
    return [(int(number), float(at)) for number, at in page.evaluate("cartoloopHeard.closures")]
