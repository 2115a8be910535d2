# SPDX-License-Identifier: Apache-2.0
"""The page in a browser whose WebGL is computed by the processor: how soon, and how smoothly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench.view.clients import Seen

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

SIZE = {"width": 1280, "height": 800}

PAN_S = 4.0
"""How long the map is dragged about [s]."""

_TIMEOUT_MS = 60_000

# Counts bytes until COMPLETE (12), and loop closures (kind 1) in CONSTRAINTS (7), by the time when
# a frame was drawn after they came.
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
        const kinds = new Uint8Array(buffer, at + 24 + 28 * count, count);
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
    """What a page in a browser took to show a finished map.

    Attributes
    ----------
    picture_s : from the connection to the first full picture [s].
    sharp_s : from the connection until all that is in sight is drawn of single cells [s].
    opening_s : from opening the page to that [s].
    sent_mb : what it was sent until it had all [MB].
    frames_per_s : while the map was dragged about.
    frames_within_ms : so long took 99% of these frames at the most [ms].
    """

    picture_s: float
    sharp_s: float
    opening_s: float
    sent_mb: float
    frames_per_s: float
    frames_within_ms: float


def open_page(browser: Browser, url: str) -> Page:
    """Return the page at a URL, in a window of its own, with what listens to its messages."""
    page = browser.new_page(viewport=SIZE, bypass_csp=True)  # type: ignore[arg-type]
    page.set_default_timeout(_TIMEOUT_MS)
    page.add_init_script(_LISTEN)
    page.goto(url)
    return page


def show_map(browser: Browser, url: str) -> PageRun:
    """Return how a page shows the finished map at a URL."""
    page = open_page(browser, url)
    for name in ("cartoloop:complete", "cartoloop:first-picture"):
        page.wait_for_function(_MARK, arg=name)
    joined, picture = (
        float(page.evaluate(_TIME, name))
        for name in ("cartoloop:joined", "cartoloop:first-picture")
    )
    num_bytes = int(page.evaluate("cartoloopHeard.bytes"))
    page.wait_for_function("cartoloop.state().settled")  # what is drawn at leisure is drawn
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
    """Drag the map about; return the times between frames [ms]."""
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
    """Return when how many loop closures were on the page."""
    return [(int(number), float(at)) for number, at in page.evaluate("cartoloopHeard.closures")]
