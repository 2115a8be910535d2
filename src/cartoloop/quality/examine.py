# SPDX-License-Identifier: Apache-2.0
"""The examination of a finished map, and the verdict on it. Start reading here."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.config import QualityConfig
from cartoloop.quality import by_session, contradictions, motion, motion_places, weak_places
from cartoloop.quality.along_corridors import are_here, nodes_here, shifts_along
from cartoloop.quality.blind_stretches import blind_stretches
from cartoloop.quality.clock_jumps import clock_jump_places, clock_jumps
from cartoloop.quality.corridor_places import NodeVisits, corridor_places, measured_by_odometry
from cartoloop.quality.corridor_shifts import shifted_places
from cartoloop.quality.corridors import Corridors
from cartoloop.quality.encounters import Encounters
from cartoloop.quality.leaps import leap_places, leaps
from cartoloop.quality.mirrored import mirrored_places
from cartoloop.quality.pairs import MappedContent, Pairs, scans_of
from cartoloop.quality.rejected_closures import rejected_places
from cartoloop.quality.scattered import scattered_places
from cartoloop.quality.slides import slides
from cartoloop.quality.unseen_drives import unseen_drives, unseen_places
from cartoloop.quality.verdict import VERDICTS, Place, Quality, Severity
from cartoloop.quality.visit_offsets import displacement_by_scale, offset_places, visit_offsets
from cartoloop.quality.visits import Visits, compare_visits
from cartoloop.quality.walls import wall_offsets
from cartoloop.quality.weak_closures import weak_bundles
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.submaps.finished_grid import kept_cells

MIN_NODES = 3
"""With fewer nodes there is nothing to compare."""

MIN_DETOUR_M = 100.0
"""Closures that save such a path hold a part of the map [m]: its end is a metre uncertain."""

_ORDER = (Severity.WRONG, Severity.DOUBTFUL, Severity.MINOR)


def examine(
    content: MappedContent, config: QualityConfig, odometry: Mapping[str, Any] | None = None
) -> Quality:
    """Return what speaks against a map, without the truth and without trust in its closures.

    Parameters
    ----------
    content : the map.
    config : limits.
    odometry : its calibration, as in the report; None without odometry.
    """
    if not config.enabled or content.graph.num_nodes < MIN_NODES or len(content.node_points) == 0:
        return Quality()
    with kept_cells(content.submap_grids):
        return _examined(content, config, odometry)


def _examined(
    content: MappedContent, config: QualityConfig, odometry: Mapping[str, Any] | None
) -> Quality:
    """Return what speaks against a map that is large enough to be examined."""
    scans = scans_of(content)
    visits = compare_visits(content, scans, config)
    met, seen, consecutive, paths = visits
    share_of_all = _share(met, seen)
    share = max(_share(met), share_of_all)
    gaps, jumps, tears = (
        by_session.events(content, find) for find in (motion.gaps, motion.jumps, motion.tears)
    )
    misfits = by_session.events(content, motion.misfits)
    only_clock = clock_jumps(gaps, {event.scan for event in misfits}, content, odometry)
    misfits, tears = _without(misfits, gaps), motion_places.without_gaps(tears, gaps, content)
    blind = _blind(content)
    stands = by_session.standing(content, motion.standing)
    halls = by_session.corridors_of(content, config.max_range, odometry)
    shifts = shifts_along(met, content, scans, paths)
    found = [
        *contradictions.contradictions(met, share, paths, content, config),
        *contradictions.contradictions(seen, share_of_all, paths, content, config),
        *shifted_places(content, scans),
        *contradictions.breaks(consecutive, content, config),
        *scattered_places(content, scans),
        *mirrored_places(content, odometry),
        *motion_places.gap_places(_without(gaps, only_clock), met, shifts, content),
        *leap_places(by_session.events(content, leaps), content),
        *unseen_places(_without(by_session.events(content, unseen_drives), gaps), met, content),
        *clock_jump_places(only_clock, content),
        *motion_places.misfit_places(misfits, met, content),
        *motion_places.jump_places(jumps, met, content),
        *motion_places.tear_places(tears, content),
        *motion_places.blind_places(blind, met, odometry, content, config),
        *motion_places.standing_places(stands, halls, odometry, content),
        *_displaced_places(visits, shifts, halls, odometry, content, scans, config),
        *rejected_places(content),
        *weak_places.weak_closure_places(weak_bundles(content.graph, paths, MIN_DETOUR_M), content),
        *weak_places.open_ends(met, paths, content, config),
    ]
    found.sort(key=lambda place: _ORDER.index(place.severity))
    worst = found[0].severity if found else Severity.MINOR
    figures = {
        **_visit_figures(met, seen, share, paths),
        **_consecutive_figures(consecutive, config),
        "gaps": float(len(gaps) + len(misfits)),
        "jumps": float(len(jumps) + len(tears)),
        "unmatched_m": float(sum(event.moved for event in blind)),
        "corridor_share": float(np.mean(halls.is_corridor)) if len(halls.nodes) else 0.0,
        **_wall_figures(wall_offsets(content.graph.node_poses, scans, paths, config)),
    }
    return Quality(
        VERDICTS[worst], tuple(found), {name: round(value, 4) for name, value in figures.items()}
    )


def _displaced_places(
    visits: Visits,
    shifts: FloatArray,
    halls: Corridors,
    odometry: Mapping[str, Any] | None,
    content: MappedContent,
    scans: ScanPoints,
    config: QualityConfig,
) -> list[Place]:
    """Return where the path is, or may be, too long or too short.

    Parameters
    ----------
    shifts : by which visits fit better along the path.
    """
    met, paths = visits.met, visits.paths
    by_odometry = measured_by_odometry(halls, odometry, content)
    displaced = displacement_by_scale(content, by_odometry, odometry)
    slid = slides(met, content, scans, config, are_here(shifts))
    nodes = NodeVisits(
        weak_places.is_visited(met, len(paths)), nodes_here(met, shifts, len(paths)), displaced
    )
    return [
        *contradictions.slide_places(slid, met, content),
        *corridor_places(halls, odometry, nodes, content, config),
        *offset_places(met, visit_offsets(met, shifts, displaced, paths), content),
    ]


def _without(events: list[motion.Event], others: list[motion.Event]) -> list[motion.Event]:
    """Return the events that do not happen at the scans of others."""
    scans = {event.scan for event in others}
    return [event for event in events if event.scan not in scans]


def _blind(content: MappedContent) -> list[motion.Event]:
    """Return the stretches that scans say little about, as far as returns were not forgotten."""
    is_whole = not any(edit.kind == "forget_area" and not edit.is_undone for edit in content.edits)
    return by_session.events(content, partial(blind_stretches, is_whole=is_whole))


def _consecutive_figures(consecutive: Pairs, config: QualityConfig) -> dict[str, float]:
    """Return how many scans were compared with the ones before, and how many contradict them."""
    bad = consecutive.contradiction > config.consecutive_contradiction
    return {
        "consecutive_pairs": float(len(consecutive)),
        "consecutive_contradicted_share": float(np.mean(bad)) if len(bad) else 0.0,
    }


def _visit_figures(
    met: Encounters, seen: Encounters, share: float, paths: FloatArray
) -> dict[str, float]:
    """Return the figures of the comparison of visits."""
    return {
        "revisited_m": float(met.length.sum()),
        "seen_again_m": float(seen.length.sum()),
        "contradicted_share": share,
        "displacement_m": _median(met.displacement),
        "confirmed_share": _confirmed_share(met, paths),
    }


def _share(*visits: Encounters) -> float:
    """Return the share of the revisited path that contradicts itself."""
    total = sum(float(met.length.sum()) for met in visits)
    contradicted = sum(float(met.length[met.contradicts].sum()) for met in visits)
    return contradicted / total if total > 0.0 else 0.0


def _wall_figures(offsets: FloatArray) -> dict[str, float]:
    """Return how far apart visits show the same walls."""
    middle, most = np.quantile(offsets, (0.5, 0.9)).tolist() if len(offsets) else (0.0, 0.0)
    return {
        "walls_compared": float(len(offsets)),
        "wall_offset_m": middle,
        "wall_offset_90_m": most,
    }


def _median(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else 0.0


def _confirmed_share(met: Encounters, paths: FloatArray) -> float:
    """Return the share of the path that another visit confirms."""
    confirmed = weak_places.is_confirmed(met, len(paths))
    if paths[-1] <= 0.0 or not confirmed.any():
        return 0.0
    at = paths[confirmed]
    steps, whole = np.diff(at), np.diff(paths)
    length = whole[whole < by_session.APART_M].sum()
    return float(min(steps[steps < 5.0].sum() / max(length, 1e-9), 1.0))
