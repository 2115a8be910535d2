# SPDX-License-Identifier: Apache-2.0
"""Whether a map is the same as before: a hash of what mapping goes on from."""

from __future__ import annotations

import hashlib

import numpy as np

from cartoloop.map_data import MapData

_DIGEST_BYTES = 16


def map_digest(content: MapData) -> str:
    """Return a hash of the scans, the graph, the grids and the returns of a map.

    Two maps with the same hash yield the same bytes when the same session is added to them.
    """
    digest, graph = hashlib.blake2b(digest_size=_DIGEST_BYTES), content.graph
    columns = (
        content.stamps,
        content.local_trajectory,
        content.node_scan_index,
        graph.submap_poses,
        graph.node_poses,
        graph.kinds,
        graph.index_a,
        graph.index_b,
        graph.relative_poses,
        graph.informations,
        graph.closure_rows,
        graph.is_trusted,
        content.closures.status,
        content.closures.search_status,
        *content.node_points,
    )
    for column in columns:
        digest.update(np.ascontiguousarray(column).tobytes())
    for grid in content.submap_grids:
        digest.update(grid.packed)
    for session in content.sessions:
        place = (session.first_scan, session.first_node, session.first_submap, session.part)
        digest.update(repr(place).encode())
    return digest.hexdigest()
