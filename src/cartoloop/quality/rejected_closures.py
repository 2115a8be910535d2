# SPDX-License-Identifier: Apache-2.0
"""Loop closures that the others contradict: where they are many, the others may be the false ones.

The adjustment leaves out what does not agree with the rest. A few false closures are found in any
building, and the rest is right. Where a large share is left out, the path may be bent between
places that were seen again, and it is chance which closures are kept.
"""

from __future__ import annotations

import numpy as np

from cartoloop.global_slam.closure_status import Status
from cartoloop.quality.pairs import MappedContent
from cartoloop.quality.places import place_around, stamps_of
from cartoloop.quality.verdict import Kind, Place, Severity

MIN_REJECTED, DOUBTFUL_SHARE = 5, 0.2
"""Number of rejected closures, and their share of all that the last pass matched, from which a map
is doubtful. In the maps of table IV in docs/results.md it is 1.5% at most; of tinySLAM's exp1,
with a bent map, 15 of 27 closures are rejected."""


def rejected_places(content: MappedContent) -> list[Place]:
    """Return the place of the rejected loop closures if they are many."""
    closures = content.closures
    rows = np.flatnonzero(closures.status == Status.CONTRADICTED)
    num_rejected = len(rows)
    total = num_rejected + content.graph.num_loop_closures
    if num_rejected < MIN_REJECTED or num_rejected < DOUBTFUL_SHARE * total:
        return []
    nodes = np.unique(closures.node[rows]).astype(np.int64)
    return [
        place_around(
            content.graph.node_poses[nodes, :2],
            stamps_of(content, nodes),
            Kind.REJECTED,
            Severity.DOUBTFUL,
            f"{num_rejected} of {total} loop closures contradict the others and were left out",
            "look which of them are right (closures.csv, or the view); drive once more, for some "
            "metres, where both visits have been",
        )
    ]
