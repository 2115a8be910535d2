# SPDX-License-Identifier: Apache-2.0
"""From findings to places: where on the map, how bad, why, and what to try."""

from __future__ import annotations

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.config import QualityConfig
from cartoloop.quality import by_session
from cartoloop.quality.clusters import clusters
from cartoloop.quality.encounters import Encounters
from cartoloop.quality.motion import SMOOTHED_OVER, Corridors, Event, Standing
from cartoloop.quality.pairs import MapContent, Pairs
from cartoloop.quality.slides import num_examined
from cartoloop.quality.verdict import Kind, Place, Severity
from cartoloop.quality.weak_closures import WeakBundle

MIN_PLACE_M = 2.0
"""Shorter parts of the path that contradict each other are doors and people, not a place [m]."""

LONG_PLACE_M, FAR_M = 25.0, 0.5
"""However long the path, a place of this length, displaced by so much or more, is doubtful [m]."""

MAX_PLACES = 20
"""Places of one kind that are kept, the largest."""

CLOSE_LOOPS = (
    "look whether the walls stand twice there; drive through the place once more, or search wider: "
    "--set global_slam.constraint_search.max_constraint_distance=40 and linear_search_window=20"
)


def contradictions(
    met: Encounters, share: float, content: MapContent, config: QualityConfig
) -> list[Place]:
    """Return the places where visits contradict each other, the largest first.

    Parameters
    ----------
    met : all encounters.
    share : of their length, that of those that contradict.
    """
    rows = np.flatnonzero(met.contradicts)
    nodes = met.pairs.node[(met.first[rows] + met.end[rows] - 1) // 2]
    places = []
    for cluster in clusters(content.graph.node_poses[nodes, :2]):
        own = rows[cluster]
        members = np.concatenate([np.arange(met.first[row], met.end[row]) for row in own.tolist()])
        seen = np.unique(met.pairs.node[members])
        length = _extent(content.graph.node_poses[seen, :2])
        if length < MIN_PLACE_M or len(own) < 2:
            continue
        shift = met.displacement[own]
        known = shift[np.isfinite(shift)]
        apart = float(np.median(known)) if len(known) else float("nan")
        stamps = _stamps(content, np.concatenate((seen, met.pairs.own_node[members])))
        is_long = length >= LONG_PLACE_M and not apart < FAR_M
        severity = _severity_of_share(share, is_long, config)
        what = (
            f"walls stand twice, about {apart:.1f} m apart"
            if len(known)
            else "returns of one visit lie where another saw floor"
        )
        places.append(
            _place(
                content.graph.node_poses[seen, :2],
                stamps,
                Kind.CONTRADICTION,
                severity,
                f"{what}, along {length:.0f} m",
                CLOSE_LOOPS,
            )
        )
    return sorted(places, key=lambda place: -place.radius)[:MAX_PLACES]


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
    nodes = met.pairs.node[(met.first[rows] + met.end[rows] - 1) // 2]
    places = []
    for cluster in clusters(content.graph.node_poses[nodes, :2]):
        own = rows[cluster]
        members = np.concatenate([np.arange(met.first[row], met.end[row]) for row in own.tolist()])
        seen = np.unique(met.pairs.node[members])
        places.append(
            _place(
                content.graph.node_poses[seen, :2],
                _stamps(content, np.concatenate((seen, met.pairs.own_node[members]))),
                Kind.CONTRADICTION,
                Severity.WRONG if is_wrong else Severity.DOUBTFUL,
                f"visits are displaced along the path against each other by {apart:.1f} m: doors "
                f"and corners fit there, along {_extent(content.graph.node_poses[seen, :2]):.0f} m",
                "the distance along bare walls was measured wrongly: `cartoloop doctor` examines "
                "the odometry; " + CLOSE_LOOPS,
            )
        )
    return sorted(places, key=lambda place: -place.radius)[:MAX_PLACES]


def _severity_of_share(share: float, is_long: bool, config: QualityConfig) -> Severity:
    if share >= config.wrong_share:
        return Severity.WRONG
    if share >= config.doubtful_share or is_long:
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
            _place(
                content.graph.node_poses[seen, :2],
                _stamps(content, seen),
                Kind.BREAK,
                severity,
                f"consecutive scans do not fit to each other ({100 * share:.0f}% of the path)",
                "scans are too sparse, too short or too noisy to be matched: record slower or with "
                "a longer range, or with odometry; `cartoloop doctor` examines the recording",
            )
        )
    return sorted(places, key=lambda place: -place.radius)[:MAX_PLACES]


def gap_places(found: list[Event], content: MapContent) -> list[Place]:
    """Return the places of gaps in the recording."""
    return [
        _at_scan(
            event,
            content,
            Kind.GAP,
            Severity.DOUBTFUL,
            f"{event.seconds:.1f} s of the recording are missing while the robot drove: it moved "
            f"some {event.expected:.1f} m by its speed, {event.moved:.1f} m by the scans",
            "map the parts before and after it alone; record without interruption, or stand still "
            "while the recording is paused",
        )
        for event in found
    ][:MAX_PLACES]


BRIDGED_M, BRIDGED_SHARE = 5.0, 0.8
"""A gap is bridged if later visits agree with submaps of before over so much path [m], and if they
are this share of all that meet them."""


def misfit_places(found: list[Event], met: Encounters, content: MapContent) -> list[Place]:
    """Return the places of gaps across which scans do not fit; minor ones where others do."""
    places = []
    for event in found:
        is_bridged = _is_bridged(event, met, content)
        places.append(
            _at_scan(
                event,
                content,
                Kind.GAP,
                Severity.MINOR if is_bridged else Severity.DOUBTFUL,
                f"{event.seconds:.1f} s of the recording are missing, and the scans before and "
                "after it do not fit to each other: the robot was moved or turned",
                "map the parts before and after it alone; record without interruption, or stand "
                "still while the recording is paused",
            )
        )
    return places[:MAX_PLACES]


def _is_bridged(event: Event, met: Encounters, content: MapContent) -> bool:
    """Return whether visits after an event agree with what was seen before it."""
    node = int(np.searchsorted(content.node_scan_index, event.scan))
    first, own = met.pairs.node[met.first], met.pairs.own_node[met.first]
    bridges = (first >= node) != (own >= node)
    agrees = float(met.length[bridges & ~met.contradicts].sum())
    share = agrees / max(float(met.length[bridges].sum()), 1e-9)
    return agrees >= BRIDGED_M and share >= BRIDGED_SHARE


def jump_places(found: list[Event], content: MapContent) -> list[Place]:
    """Return the places where the pose jumped."""
    return [
        _at_scan(
            event,
            content,
            Kind.JUMP,
            Severity.DOUBTFUL,
            f"the pose jumps by {event.moved:.1f} m from one scan to the next",
            "the odometry may have jumped: try --set local_slam.use_odometry=false; "
            "`cartoloop doctor` examines it",
        )
        for event in found
    ][:MAX_PLACES]


def blind_places(
    found: list[Event], met: Encounters, content: MapContent, config: QualityConfig
) -> list[Place]:
    """Return the places where nothing was matched; minor ones where visits across them agree."""
    return [
        _at_scan(
            event,
            content,
            Kind.BLIND,
            Severity.DOUBTFUL
            if event.moved > config.doubtful_blind_length and not _is_bridged(event, met, content)
            else Severity.MINOR,
            f"no scan was matched over {event.moved:.1f} m: they rest on the odometry alone",
            "the surroundings may be farther away than sensor.max_range; drive along a wall, or "
            "through the place once more",
        )
        for event in found
    ][:MAX_PLACES]


STANDS_CHANGED, STANDS_CHANGED_LONG, STANDS_CHANGED_CORRIDOR = 0.35, 0.12, 0.02
STANDS_S, STANDS_LONG_S = 10.0, 20.0
"""Poses that stand still for so long [s] while this share of the returns moves from node to node
are stuck: people make up a tenth. In a corridor less moves: only what stands out from its walls."""


def standing_places(found: list[Standing], halls: Corridors, content: MapContent) -> list[Place]:
    """Return the places where poses stand still though the scans change."""
    places = []
    for stand in found:
        in_corridor = _is_in_corridor(halls, stand.first, stand.last)
        is_long = stand.seconds >= STANDS_LONG_S
        limit = STANDS_CHANGED
        if is_long:
            limit = STANDS_CHANGED_CORRIDOR if in_corridor else STANDS_CHANGED_LONG
        if stand.seconds < STANDS_S or stand.changed < limit:
            continue
        nodes = np.arange(stand.first, stand.last + 1)
        places.append(
            _place(
                content.graph.node_poses[nodes, :2],
                _stamps(content, nodes),
                Kind.CORRIDOR,
                Severity.DOUBTFUL,
                f"the pose stands still for {stand.seconds:.0f} s, but "
                f"{100 * stand.changed:.0f}% of the returns change",
                "the robot probably moved and no scan showed by how far: record with odometry that "
                "works; `cartoloop doctor` examines it",
            )
        )
    return places[:MAX_PLACES]


def _is_in_corridor(halls: Corridors, first: int, last: int) -> bool:
    chosen = (halls.nodes >= first - 3) & (halls.nodes <= last + 3)
    return bool(np.any(chosen)) and float(np.mean(halls.is_corridor[chosen])) > 0.5


SCALE_ERROR, SCALE_OF_ROTATION, NO_ODOMETRY_ERROR = 0.002, 1.6, 0.05
"""Expected error of a corridor's length, as a share of it: of good odometry; more for each radian
of its typical error of a step, by which bad odometry is recognised; and without odometry."""


def corridor_places(
    halls: Corridors, rotation_error: float | None, content: MapContent, config: QualityConfig
) -> list[Place]:
    """Return the corridors whose lengths are not well known.

    Parameters
    ----------
    rotation_error : median error of a step of the odometry [rad], None without odometry.
    """
    share = NO_ODOMETRY_ERROR
    if rotation_error is not None:
        share = SCALE_ERROR + SCALE_OF_ROTATION * rotation_error
    poses, places = content.graph.node_poses[:, :2], []
    rows = np.flatnonzero(halls.is_corridor)
    for run in np.split(rows, np.flatnonzero(np.diff(rows) > SMOOTHED_OVER) + 1):
        nodes = halls.nodes[run]
        if len(nodes) < 2:
            continue
        length = _extent(poses[nodes])
        if (error := share * length) <= config.doubtful_length_error:
            continue
        on_what = "the odometry, which is poor" if rotation_error is not None else "nothing else"
        places.append(
            _place(
                poses[nodes],
                _stamps(content, nodes),
                Kind.CORRIDOR,
                Severity.DOUBTFUL,
                f"a corridor of {length:.0f} m in which scans hardly measure the distance: it "
                f"rests on {on_what}, and may be {error:.1f} m too long or too short",
                "compare its length with a tape measure; record with better odometry, or put "
                "boxes along the walls",
            )
        )
    return places[:MAX_PLACES]


def weak_closure_places(found: list[WeakBundle], content: MapContent) -> list[Place]:
    """Return the places that only a few loop closures hold: worth a look, and no more."""
    places = []
    for bundle in found:
        closures = (
            "one loop closure"
            if bundle.num_closures == 1
            else f"{bundle.num_closures} loop closures"
        )
        without = (
            f"the path between its ends would be {bundle.detour:.0f} m long"
            if bundle.detour < by_session.APART_M
            else "nothing would connect its ends"
        )
        places.append(
            _place(
                content.graph.node_poses[bundle.nodes, :2],
                _stamps(content, bundle.nodes),
                Kind.WEAK_CLOSURE,
                Severity.MINOR,
                f"{closures} alone hold the map together here: without, {without}",
                "drive once more, for some metres, where both visits have been",
            )
        )
    return places[:MAX_PLACES]


def of_nodes(
    first: int,
    last: int,
    content: MapContent,
    kind: Kind,
    severity: Severity,
    reason: str,
    advice: str,
) -> Place:
    """Return the place of a part of the path, given its first and last node."""
    nodes = np.arange(first, last + 1)
    points = content.graph.node_poses[nodes, :2]
    return _place(points, _stamps(content, nodes), kind, severity, reason, advice)


def _extent(points: FloatArray) -> float:
    """Return the diagonal of the box around points [m]."""
    size = points.max(axis=0) - points.min(axis=0)
    return float(np.hypot(size[0], size[1]))


def _stamps(content: MapContent, nodes: IntArray) -> FloatArray:
    stamps: FloatArray = content.stamps[content.node_scan_index[nodes]]
    return stamps


def _at_scan(
    event: Event, content: MapContent, kind: Kind, severity: Severity, reason: str, advice: str
) -> Place:
    scans = np.array((event.scan - 1, event.scan))
    return _place(
        content.trajectory[scans, :2], content.stamps[scans], kind, severity, reason, advice
    )


def _place(
    points: FloatArray,
    stamps: FloatArray,
    kind: Kind,
    severity: Severity,
    reason: str,
    advice: str,
) -> Place:
    """Return the place around points (n, 2) [m], seen at some time stamps."""
    low, high = points.min(axis=0), points.max(axis=0)
    x, y = ((low + high) / 2.0).tolist()
    radius = max(1.0, float(np.hypot(*(high - low))) / 2.0 + 0.5)
    return Place(
        round(x, 3),
        round(y, 3),
        round(radius, 3),
        float(stamps.min()),
        float(stamps.max()),
        kind,
        severity,
        reason,
        advice,
    )


def is_confirmed(met: Encounters, num_nodes: int) -> BoolArray:
    """Return which nodes are in an encounter that agrees, or met in one, shape (num_nodes,)."""
    confirmed = np.zeros(num_nodes, dtype=np.bool_)
    for row in np.flatnonzero(~met.contradicts).tolist():
        own = slice(int(met.first[row]), int(met.end[row]))
        confirmed[met.pairs.node[own]] = True
        confirmed[met.pairs.own_node[own]] = True
    return confirmed
