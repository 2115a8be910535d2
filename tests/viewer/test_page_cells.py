# SPDX-License-Identifier: Apache-2.0
"""The page's cells of submaps: what comes in which order, and what is held of them."""

from __future__ import annotations

import numpy as np

from tests.viewer.real_page import SIZE, opened

OVERTAKEN = """async () => {
  const { Submaps } = await import(new URL("gl/submaps.js", location.origin));
  const { Type } = await import(new URL("protocol.js", location.origin));
  const gl = new OffscreenCanvas(8, 8).getContext("webgl2");
  const submaps = new Submaps(gl, () => {});
  submaps.begin({ log_odds: new Array(256).fill(0), palette: new Array(257).fill([0, 0, 0]) });
  const pack = (bytes) => new Response(
    new Blob([bytes]).stream().pipeThrough(new CompressionStream("deflate"))).arrayBuffer();
  const place = { submap: 3, x: 0, y: 0, resolution: 0.05 };
  const [before, after, small] = await Promise.all(
    [[64, 1], [32, 2], [8, 3]].map(([n, value]) => pack(new Uint8Array(n * n).fill(value))));
  const patch = await pack(new Uint8Array(4).fill(9));
  // All at once, as where a page joins just when a submap is finished.
  submaps.take({ type: Type.SUBMAP, ...place, version: 1, finished: false, rows: 64, cols: 64,
    packed: before });
  submaps.take({ type: Type.SUBMAP_PATCH, submap: 3, base: 1, version: 2, row: 62, col: 62, rows: 2,
    cols: 2, packed: patch });
  submaps.take({ type: Type.SUBMAP_PREVIEW, ...place, rows: 8, cols: 8, packed: small });
  submaps.take({ type: Type.SUBMAP, ...place, version: 3, finished: true, rows: 32, cols: 32,
    packed: after });
  const wait = async () => {
    while (submaps.numPending > 0) await new Promise((done) => setTimeout(done, 10));
  };
  await wait();
  const submap = submaps.all.get(3);
  submaps.inflate(submap);
  await wait();
  submaps.upload(submap);
  const target = gl.createFramebuffer();
  gl.bindFramebuffer(gl.FRAMEBUFFER, target);
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, submap.cells, 0);
  const cell = new Uint32Array(4);
  gl.readPixels(4 + 31, 1 + 31, 1, 1, gl.RGBA_INTEGER, gl.UNSIGNED_INT, cell);
  const preview = submaps.previews.get(3);
  for (const worker of submaps.workers) worker.terminate();
  return { finished: submap.finished, rows: submap.rows, version: submap.version, cell: cell[0],
    preview: preview.rows, error: gl.getError() };
}"""
"""What stands in the last cell of a submap whose versions came faster than they can be inflated."""


def test_finished_submap_replaces_one_still_being_inflated(chromium, server):
    with opened(chromium, server.url) as page:
        page.settle()
        shown = page.page.evaluate(OVERTAKEN)
    assert shown == {
        "finished": True, "rows": 32, "version": 3, "cell": 2, "preview": 8, "error": 0,
    }  # fmt: skip


def test_cells_out_of_sight_are_let_go_and_come_back(chromium, server):
    squares = {"gl/composer.js": {"TILE = 512": "TILE = 128"}}  # this map is small
    little = squares | {"gl/submaps.js": {"MAX_CELL_BYTES = 160e6": "MAX_CELL_BYTES = 1"}}
    with (
        opened(chromium, server.url, changes=squares) as all_held,
        opened(chromium, server.url, changes=little) as page,
    ):
        for one in (all_held, page):
            one.settle()
        left, bottom = all_held.page.evaluate(f"cartoloop.toMap([0, {SIZE[1]}])")
        right, top = all_held.page.evaluate(f"cartoloop.toMap([{SIZE[0]}, 0])")
        held = []
        # Across the map and back; at another scale each, so that the whole picture is drawn again.
        for step, share in enumerate((0.3, 0.4, 0.5, 0.6, 0.7, 0.4)):
            x, y = left + share * (right - left), bottom + share * (top - bottom)
            for one in (all_held, page):
                one.look(x, y, 100.0 + step)
            assert np.array_equal(page.pixels(), all_held.pixels())
            held.append(page.state["held"]["cells"])
        assert 0 < min(held) < 0.8 * all_held.state["held"]["cells"]


def test_where_more_is_seen_than_can_be_held_it_comes_to_rest(chromium, server):
    few = {
        "gl/composer.js": {"TILE = 512": "TILE = 128"},
        "gl/tiles.js": {"MAX_TEXTURES = 200": "MAX_TEXTURES = 3"},
    }
    with opened(chromium, server.url, changes=few) as page:
        page.wait("s.held.squares === 3")
        drawn = [-1, page.state["frames"]["number"]]
        while drawn[-1] != drawn[-2] and len(drawn) < 30:
            page.page.wait_for_timeout(1000)
            drawn.append(page.state["frames"]["number"])
        assert drawn[-1] == drawn[-2]
        assert page.state["held"]["squares"] == 3


def test_silent_server_is_reported(chromium, server):
    """It may still run: the network does not report a tablet that is out of reach."""
    hasty = {
        "connection.js": {
            "PING_PERIOD_MS = 5000": "PING_PERIOD_MS = 200",
            "ANSWER_TIMEOUT_MS = 20000": "ANSWER_TIMEOUT_MS = 2000",
        }
    }
    routes = []
    num_mute = 0

    def relay(route):
        number = len(routes)
        routes.append(route)
        upstream = route.connect_to_server()
        upstream.on_message(lambda message: None if number < num_mute else route.send(message))

    with opened(chromium, "about:blank", changes=hasty) as page:
        page.page.route_web_socket("**/socket", relay)
        page.page.goto(server.url)
        page.settle()
        page.page.get_by_text("finished", exact=True).wait_for()

        num_mute = len(routes)
        page.page.get_by_text("no answer from the program", exact=True).wait_for()
        page.page.get_by_text("finished", exact=True).wait_for()
        page.settle()
        assert len(routes) > num_mute
