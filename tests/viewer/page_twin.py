# SPDX-License-Identifier: Apache-2.0
"""A page in Python: reads messages and draws the map as ``docs/viewer-protocol.md`` describes."""

from __future__ import annotations

import json
import zlib
from time import monotonic

import numpy as np
from websockets.sync.client import connect

from cartoloop.viewer.protocol import MessageType, messages
from tests.limits import LIMIT_S


class Page:
    """What a page knows after the messages that it was sent."""

    def __init__(self):
        self.num_bytes = 0
        self.order = []
        self.json = {}
        self.submaps = {}
        self.previews = {}
        self.tables = {}
        self.revisions = {}
        self.answers = []
        self.is_complete = False
        self._answers = None

    def receive(self, data):
        assert isinstance(data, bytes)
        self.num_bytes += len(data)
        for kind, payload in messages(data):
            self.order.append(MessageType(kind))
            getattr(self, f"_{MessageType(kind).name.lower()}", self._other)(kind, payload)

    @property
    def hello(self):
        return self.json[MessageType.HELLO]

    @property
    def readings(self):
        return self.json[MessageType.READINGS]

    @property
    def playback(self):
        return self.json[MessageType.PLAYBACK]

    def _other(self, kind, payload):
        content = json.loads(payload)
        self.json[MessageType(kind)] = content
        if "id" in content:
            self.answers.append((MessageType(kind), content))

    def _complete(self, kind, payload):
        assert json.loads(payload) == {}
        self.is_complete = True

    def _answer(self, kind, payload):
        self._answers = json.loads(payload)["id"]

    def _picture(self, kind, payload):
        self._take_answer(MessageType.PICTURE, {"png": payload})

    def _before(self, kind, payload):
        num_submaps, num_nodes = np.frombuffer(payload, "<u4", 2).tolist()
        submaps = np.frombuffer(payload, "<f8", 3 * num_submaps, 8).reshape(-1, 3)
        nodes = np.frombuffer(payload, "<f8", 3 * num_nodes, 8 + 24 * num_submaps).reshape(-1, 3)
        assert len(payload) == 8 + 24 * num_submaps + 24 * num_nodes
        self._take_answer(MessageType.BEFORE, {"submaps": submaps, "nodes": nodes})

    def _take_answer(self, kind, content):
        self.answers.append((kind, content | {"id": self._answers}))
        self._answers = None

    def _submap(self, kind, payload):
        submap, version, flags, rows, cols, _ = np.frombuffer(payload, "<u4", 6).tolist()
        x, y, resolution = np.frombuffer(payload, "<f8", 3, 24).tolist()
        cells = np.frombuffer(zlib.decompress(payload[48:]), np.uint8).reshape(rows, cols).copy()
        self.submaps[submap] = {
            "version": version, "finished": flags & 1, "x": x, "y": y, "resolution": resolution,
            "cells": cells,
        }  # fmt: skip

    def _submap_preview(self, kind, payload):
        submap, _, rows, cols = np.frombuffer(payload, "<u4", 4).tolist()
        x, y, resolution = np.frombuffer(payload, "<f8", 3, 16).tolist()
        cells = np.frombuffer(zlib.decompress(payload[40:]), np.uint8).reshape(rows, cols)
        self.previews[submap] = {"x": x, "y": y, "resolution": resolution, "cells": cells}

    def _submap_patch(self, kind, payload):
        submap, base, version, row, col, rows, cols, _ = np.frombuffer(payload, "<u4", 8).tolist()
        known = self.submaps[submap]
        if known["version"] != base:
            return
        cells = np.frombuffer(zlib.decompress(payload[32:]), np.uint8).reshape(rows, cols)
        known["cells"][row : row + rows, col : col + cols] = cells
        known["version"] = version

    def _rows(self, name, payload, read):
        first, count, total, revision = np.frombuffer(payload, "<u4", 4).tolist()
        rows = read(count)
        assert first + count == total
        if name in self.revisions and self.revisions[name] != revision:
            assert first == 0
        self.revisions[name] = revision
        before = self.tables.get(name)
        if first:
            rows = np.concatenate((before[:first], rows))
        self.tables[name] = rows

    def _submap_poses(self, kind, payload):
        self._rows(
            "submap_poses",
            payload,
            lambda count: np.frombuffer(payload, "<f8", 3 * count, 16).reshape(-1, 3),
        )

    def _nodes(self, kind, payload):
        self._rows(
            "nodes",
            payload,
            lambda count: np.frombuffer(payload, "<f8", 3 * count, 16).reshape(-1, 3),
        )

    def _node_times(self, kind, payload):
        self._rows("node_times", payload, lambda count: np.frombuffer(payload, "<f8", count, 16))

    def _path(self, kind, payload):
        self._rows(
            "path",
            payload,
            lambda count: np.frombuffer(payload, "<f8", 3 * count, 16).reshape(-1, 3),
        )

    def _constraints(self, kind, payload):
        def read(count):
            columns = (
                np.frombuffer(payload, "<u4", count, 16),
                np.frombuffer(payload, "<u4", count, 16 + 4 * count),
                np.frombuffer(payload, "<f4", 3 * count, 16 + 8 * count).reshape(-1, 3),
                np.frombuffer(payload, "u1", count, 16 + 20 * count),
            )
            assert len(payload) == 16 + 21 * count
            return np.column_stack(columns).astype(np.float64)

        self._rows("constraints", payload, read)

    def _scan(self, kind, payload):
        self.scan = read_scan(payload)

    def _node_scan(self, kind, payload):
        self._take_answer(MessageType.NODE_SCAN, read_scan(payload))

    def compose(self, lower, shape):
        """Return the picture of cells, uint8 (rows, cols, 3), row 0 being the lowest y.

        And which of them lie exactly between two cells of a submap, so that either is the nearest.
        `lower` is the (column, row) of its first cell in the lattice of the map.
        """
        between = np.zeros(shape, bool)
        resolution = self.hello["resolution"]
        log_odds = np.array(self.hello["log_odds"], np.float32)
        total, known = np.zeros(shape, np.float32), np.zeros(shape, bool)
        x = (lower[0] + 0.5 + np.arange(shape[1])) * resolution
        y = ((lower[1] + 0.5 + np.arange(shape[0])) * resolution)[:, np.newaxis]
        for submap, texture in self.submaps.items():
            px, py, theta = self.tables["submap_poses"][submap]
            dx, dy = x - px, y - py
            u = (np.cos(theta) * dx + np.sin(theta) * dy - texture["x"]) / texture["resolution"]
            v = (np.cos(theta) * dy - np.sin(theta) * dx - texture["y"]) / texture["resolution"]
            cells = np.pad(texture["cells"], 2)
            inside = (u > -1.5) & (v > -1.5)
            inside &= (u < texture["cells"].shape[1] + 0.5) & (v < texture["cells"].shape[0] + 0.5)
            u, v = u[inside] + 2, v[inside] + 2
            between[inside] |= (abs(u % 1.0 - 0.5) < 1e-6) | (abs(v % 1.0 - 0.5) < 1e-6)
            nearest = cells[np.floor(v + 0.5).astype(int), np.floor(u + 0.5).astype(int)] != 0
            col, row = np.floor(u).astype(int), np.floor(v).astype(int)
            u, v = u - col, v - row
            evidence = np.where(cells != 0, log_odds[cells], 0.0)
            value = (1 - v) * ((1 - u) * evidence[row, col] + u * evidence[row, col + 1])
            value += v * ((1 - u) * evidence[row + 1, col] + u * evidence[row + 1, col + 1])
            total[inside] += np.where(nearest, value, 0.0).astype(np.float32)
            known[inside] |= nearest
        limit = self.hello["max_log_odds"]
        level = np.rint(255.0 / (1.0 + np.exp(-np.clip(total, -limit, limit)))).astype(int)
        colours = np.array(self.hello["palette"], np.uint8)
        return colours[np.where(known, level, 256)], between


def read_scan(payload):
    """Return a scan as a dictionary."""
    time, *pose = np.frombuffer(payload, "<f8", 4).tolist()
    number, count = np.frombuffer(payload, "<u4", 2, 32).tolist()
    points = np.frombuffer(payload, "<f4", 2 * count, 40).reshape(-1, 2)
    return {"time": time, "pose": pose, "number": number, "points": points}


def join(url, **options):
    """Return a connection to the server at its URL, as its own page opens it."""
    place, _, query = url.partition("?")
    options.setdefault("origin", place.rstrip("/"))
    options.setdefault("open_timeout", LIMIT_S)
    options.setdefault("max_queue", None)
    options.setdefault("ping_interval", None)  # a machine may be too busy to answer in time
    socket = place.replace("http:", "ws:") + "socket" + (f"?{query}" if query else "")
    return connect(socket, max_size=None, compression=None, **options)


def look(connection, page=None, until=lambda page: page.is_complete, timeout=LIMIT_S):
    """Receive until the page knows enough, and return it."""
    page = page or Page()
    end = monotonic() + timeout
    while not until(page):
        assert monotonic() < end, f"not seen in {timeout} s; readings: {page.readings}"
        page.receive(connection.recv(timeout=timeout))
    return page


def ask(connection, page, **request):
    """Send a request and return its answer."""
    page.answers.clear()
    connection.send(json.dumps(request))
    look(connection, page, lambda page: page.answers)
    return page.answers[0]
