# SPDX-License-Identifier: Apache-2.0
"""Edits in words."""

from __future__ import annotations

import math
from typing import Any

from cartoloop.map_data import Edit

_SHOWN_PAIRS = 3
"""Closures of one edit that are named."""


def described(edit: Edit) -> str:
    """Return an edit, whose arguments were checked, in a few words."""
    given: dict[str, Any] = dict(edit.arguments)
    what = edit.kind
    match edit.kind:
        case "drop":
            pairs = [f"submap {submap} - node {node}" for submap, node in given["pairs"]]
            more = len(pairs) - _SHOWN_PAIRS
            shown = ", ".join(pairs[:_SHOWN_PAIRS]) + (f" and {more} more" if more > 0 else "")
            what = f"drop {'closures' if len(pairs) > 1 else 'closure'} {shown}"
        case "add":
            pair = f"submap {given['submap']} - node {given['node']}"
            what = f"add closure {pair}, score {given['score']:.3f}"
        case "pin":
            vertex = "submap" if given["submap"] is not None else "node"
            what = f"pin {vertex} {given[vertex]}"
        case "control_points":
            what = f"move the map to {len(given['points'])} control points"
        case "align":
            what = f"turn the map to {math.degrees(given['angle']):.2f} deg from as mapped"
        case "forget_time":
            what = f"forget the scans from {given['from_stamp']:.3f} to {given['to_stamp']:.3f}"
            if (scans := given.get("scans")) is not None:
                what += f" of the session that begins with scan {scans[0]}"
        case "forget_area":
            width, height = given["size"]
            what = f"forget an area of {width:.2f} m by {height:.2f} m"
        case "split":
            what = f"split a session before scan {given['scan']}: {given['name']}"
        case "rename":
            what = f"call the session that begins with scan {given['scan']} {given['name']}"
    return what
