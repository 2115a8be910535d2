# SPDX-License-Identifier: Apache-2.0
"""Maps that may be the mirror image of what was scanned.

Mirrored scans fit to each other as well as any. Only the odometry shows that they are: it turns to
the other side.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cartoloop.quality.odometry_use import TURNS_ADVICE, TURNS_AGAINST, turns_against
from cartoloop.quality.pairs import MapContent
from cartoloop.quality.places import place_around, stamps_of
from cartoloop.quality.verdict import Kind, Place, Severity


def mirrored_places(content: MapContent, odometry: Mapping[str, Any] | None) -> list[Place]:
    """Return the whole map as a place if odometry and scans turn to different sides.

    Parameters
    ----------
    content : the map.
    odometry : its calibration, as in the report; None without odometry.
    """
    if not turns_against(odometry):
        return []
    graph = content.graph
    return [
        place_around(
            graph.node_poses[:, :2],
            stamps_of(content, np.arange(graph.num_nodes)),
            Kind.MIRRORED,
            Severity.DOUBTFUL,
            TURNS_AGAINST,
            TURNS_ADVICE,
        )
    ]
