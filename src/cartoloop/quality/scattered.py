# SPDX-License-Identifier: Apache-2.0
"""Submaps whose scans do not show the same walls: their ranges are wrong.

Every other examination compares visits. Where nothing is seen twice, a broken scanner, or beams in
another order, would go unnoticed.
"""

from __future__ import annotations

import numpy as np

from cartoloop.global_slam.closure_search import mean_score
from cartoloop.quality.confirmed import near_walls, own_rows
from cartoloop.quality.pairs import MapContent
from cartoloop.quality.places import MAX_PLACES, place_around, stamps_of
from cartoloop.quality.verdict import Kind, Place, Severity
from cartoloop.sensor.scan_points import ScanPoints

MIN_NODES, MIN_RETURNS = 10, 300
"""Submaps of fewer nodes, or with fewer returns, say nothing."""

SUSPECT_SCORE = 0.55
"""Mean probability at the returns of a submap's own scans below which it is looked at closely."""

MIN_SHARE_ON_WALLS = 0.4
"""Share of these returns that lie on walls of the submap at least. In recordings of all kinds 0.5
was the least; of random ranges it is 0.25 to 0.4."""


def scattered_places(content: MapContent, scans: ScanPoints) -> list[Place]:
    """Return the submaps whose own returns hardly lie on their walls, the worst first.

    Parameters
    ----------
    content : the map.
    scans : the returns of its nodes.
    """
    graph = content.graph
    found = []
    rows_of = own_rows(graph, graph.num_submaps)
    for grid, rows in zip(content.submap_grids, rows_of, strict=True):
        nodes, tf_submap_node = graph.index_b[rows], graph.relative_poses[rows]
        returns = scans.take(nodes)
        counts = returns.counts
        if len(rows) < MIN_NODES or counts.sum() < MIN_RETURNS or not grid.size:
            continue
        if mean_score(grid, returns, tf_submap_node) >= SUSPECT_SCORE:
            continue
        of_return = np.repeat(np.arange(len(rows)), counts)
        points = np.concatenate([returns[i] for i in range(len(rows))])
        on_wall, is_known = near_walls(grid, points, tf_submap_node[of_return])
        share = float(on_wall.sum() / max(is_known.sum(), 1))
        if is_known.sum() >= MIN_RETURNS and share < MIN_SHARE_ON_WALLS:
            found.append((share, nodes))
    found.sort(key=lambda one: one[0])
    return [
        place_around(
            graph.node_poses[nodes, :2],
            stamps_of(content, nodes),
            Kind.SCATTERED,
            Severity.WRONG,
            f"scans do not show the same walls: only {100 * share:.0f}% of the returns lie on "
            "walls of the map of these scans",
            "look at the ranges of the recording: `cartoloop doctor` examines it; the scanner may "
            "be broken, its beams in another order, or its range much shorter than it reports",
        )
        for share, nodes in found[:MAX_PLACES]
    ]
