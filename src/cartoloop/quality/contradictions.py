# SPDX-License-Identifier: Apache-2.0
"""Places where scans of different visits, or of consecutive nodes, contradict each other."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.config import QualityConfig
from cartoloop.quality.clusters import clusters, in_same_tiles
from cartoloop.quality.encounters import Encounters
from cartoloop.quality.pairs import MapContent, Pairs
from cartoloop.quality.places import MAX_PLACES, extent, place_around, stamps_of
from cartoloop.quality.slides import num_examined
from cartoloop.quality.verdict import Kind, Place, Severity

MIN_PLACE_M = 2.0
"""Shorter parts of the path that contradict each other are doors and people, not a place [m]."""

LONG_PLACE_M, LONG_DISPLACED_M, FAR_M = 25.0, 12.0, 0.5
"""However long the path, a place of the first length is doubtful, and one of the second where walls
stand twice, displaced by the third or more [m]. There, encounters must contradict as often as in a
map that is doubtful for their share: where a place was visited often, people, doors and returns
that are missing make a few of many contradict."""

STRETCH_M, STRETCH_SHARE, MIN_STRETCH_M, MIN_APART_M = 8.0, 0.9, 12.0, 4.0
"""A short place is doubtful, too, if a visit stands apart from all others there. Along a stretch of
path of the first length [m], encounters of the third length contradict [m]. They are this share of
all encounters there, and span the fourth length [m]. People and doors do not do that: in right maps
of real recordings the share was 0.6 at most, except for one place seen from 13 m away."""

MIN_DISPLACED_SHARE = 0.1
"""Walls stand twice where this share of the encounters that contradict fits better elsewhere."""

CLOSE_LOOPS = (
    "look whether the walls stand twice there; drive through the place once more, or search wider: "
    "--set global_slam.constraint_search.max_constraint_distance=40 and linear_search_window=20"
)


def contradictions(
    met: Encounters,
    share: float,
    paths: FloatArray,
    content: MapContent,
    config: QualityConfig,
) -> list[Place]:
    """Return the places where visits contradict each other, the largest first.

    Parameters
    ----------
    met : all encounters.
    share : of their length, that of those that contradict.
    paths : path length of each node [m].
    """
    places, stands_apart = [], _stands_apart(met, paths)
    for own, seen, stamps in _by_place(np.flatnonzero(met.contradicts), met, content):
        length = extent(content.graph.node_poses[seen, :2])
        if length < MIN_PLACE_M or len(own) < 2:
            continue
        shift = met.displacement[own]
        known = shift[np.isfinite(shift)]
        stands_twice = len(known) >= MIN_DISPLACED_SHARE * len(shift)
        apart = float(np.median(known)) if stands_twice else float("nan")
        longest = LONG_DISPLACED_M if apart >= FAR_M else LONG_PLACE_M
        is_doubtful = not apart < FAR_M and (
            bool(stands_apart[own].any())
            or (length >= longest and _share_around(own, met, content) >= config.doubtful_share)
        )
        severity = _severity_of_share(share, is_doubtful, config)
        what = (
            f"walls stand twice, about {apart:.1f} m apart"
            if stands_twice
            else "returns of one visit lie where another saw floor"
        )
        places.append(
            place_around(
                content.graph.node_poses[seen, :2],
                stamps,
                Kind.CONTRADICTION,
                severity,
                f"{what}, along {length:.0f} m",
                CLOSE_LOOPS,
            )
        )
    return sorted(places, key=lambda place: -place.radius)[:MAX_PLACES]


def _share_around(rows: IntArray, met: Encounters, content: MapContent) -> float:
    """Return the share of all encounters' length that contradicts where some contradict."""
    points = content.graph.node_poses[met.pairs.node[met.middle], :2]
    is_around = in_same_tiles(points, points[rows])
    total = float(met.length[is_around].sum())
    return float(met.length[is_around & met.contradicts].sum()) / total


def _stands_apart(met: Encounters, paths: FloatArray) -> BoolArray:
    """Return which encounters contradict as nearly all do along their stretch of a path.

    Of either path: that of the scans, and that of the submaps that they are compared with.
    """
    found = np.zeros(len(met), dtype=np.bool_)
    for nodes in (met.pairs.node, met.pairs.own_node):
        at = paths[nodes[met.middle]]
        order = np.argsort(at, kind="stable")
        lengths = np.where(met.contradicts, met.length, 0.0)
        total, against = (
            np.concatenate(([0.0], np.cumsum(each[order]))) for each in (met.length, lengths)
        )
        first, end = np.searchsorted(at[order], at[order] - STRETCH_M), np.arange(1, len(met) + 1)
        contradicting = against[end] - against[first]
        is_apart = contradicting >= np.maximum(
            STRETCH_SHARE * (total[end] - total[first]), MIN_STRETCH_M
        )
        for row in np.flatnonzero(is_apart).tolist():
            rows = order[first[row] : end[row]]
            rows = rows[met.contradicts[rows]]
            if at[rows[-1]] - at[rows[0]] >= MIN_APART_M:
                found[rows] = True
    return found


WRONG_SLIDE_SHARE = 0.25
"""A map is wrong if this share of the encounters is displaced along the path by one distance."""


def slide_places(displacements: FloatArray, met: Encounters, content: MapContent) -> list[Place]:
    """Return where visits are displaced along the path against each other.

    Parameters
    ----------
    displacements : those that agree, see :func:`cartoloop.quality.slides.slides`.
    met : the encounters.
    """
    rows = np.flatnonzero(np.isfinite(displacements))
    if len(rows) == 0:
        return []
    apart = float(np.median(displacements[rows]))
    is_wrong = len(rows) >= WRONG_SLIDE_SHARE * num_examined(len(met))
    places = []
    for _, seen, stamps in _by_place(rows, met, content):
        places.append(
            place_around(
                content.graph.node_poses[seen, :2],
                stamps,
                Kind.CONTRADICTION,
                Severity.WRONG if is_wrong else Severity.DOUBTFUL,
                f"visits are displaced along the path against each other by {apart:.1f} m: doors "
                f"and corners fit there, along {extent(content.graph.node_poses[seen, :2]):.0f} m",
                "the distance along bare walls was measured wrongly: `cartoloop doctor` examines "
                "the odometry; " + CLOSE_LOOPS,
            )
        )
    return sorted(places, key=lambda place: -place.radius)[:MAX_PLACES]


def _by_place(
    rows: IntArray, met: Encounters, content: MapContent
) -> Iterator[tuple[IntArray, IntArray, FloatArray]]:
    """Yield the encounters of each place, their nodes, and the stamps of all that they compare."""
    nodes = met.pairs.node[met.middle[rows]]
    for cluster in clusters(content.graph.node_poses[nodes, :2]):
        own = rows[cluster]
        members = np.concatenate([np.arange(met.first[row], met.end[row]) for row in own.tolist()])
        seen = np.unique(met.pairs.node[members])
        yield own, seen, stamps_of(content, np.concatenate((seen, met.pairs.own_node[members])))


def _severity_of_share(share: float, is_doubtful: bool, config: QualityConfig) -> Severity:
    if share >= config.wrong_share:
        return Severity.WRONG
    if share >= config.doubtful_share or is_doubtful:
        return Severity.DOUBTFUL
    return Severity.MINOR


def breaks(consecutive: Pairs, content: MapContent, config: QualityConfig) -> list[Place]:
    """Return where consecutive scans do not fit to each other, if that is often so."""
    if len(consecutive) < config.min_consecutive_pairs:
        return []
    bad = consecutive.contradiction > config.consecutive_contradiction
    share = float(np.mean(bad))
    if share < config.doubtful_break_share:
        return []
    severity = Severity.WRONG if share > 2.0 * config.doubtful_break_share else Severity.DOUBTFUL
    nodes = np.unique(consecutive.node[bad])
    places = []
    for cluster in clusters(content.graph.node_poses[nodes, :2]):
        seen = nodes[cluster]
        places.append(
            place_around(
                content.graph.node_poses[seen, :2],
                stamps_of(content, seen),
                Kind.BREAK,
                severity,
                f"consecutive scans do not fit to each other ({100 * share:.0f}% of the path)",
                "scans are too sparse, too short or too noisy to be matched: record slower or with "
                "a longer range, or with odometry; `cartoloop doctor` examines the recording",
            )
        )
    return sorted(places, key=lambda place: -place.radius)[:MAX_PLACES]
