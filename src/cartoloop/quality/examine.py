# SPDX-License-Identifier: Apache-2.0
"""The examination of a finished map, and the verdict on it. Start reading here."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.config import QualityConfig
from cartoloop.quality import by_session, motion, places
from cartoloop.quality.encounters import Encounters, encounters
from cartoloop.quality.pairs import MapContent, compared_pairs, path_lengths
from cartoloop.quality.slides import slides
from cartoloop.quality.verdict import VERDICTS, Kind, Place, Quality, Severity
from cartoloop.quality.walls import wall_offsets
from cartoloop.quality.weak_closures import weak_bundles
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.session import ranges

MIN_NODES = 3
"""With fewer nodes there is nothing to compare."""

MIN_DETOUR_M = 100.0
"""Closures that save such a path hold a part of the map [m]: its end is a metre uncertain."""

HEADING_DRIFT = math.radians(0.1)
"""Drift of the heading that is expected of local SLAM [rad / sqrt(m)]: 0.04 to 0.3 degrees were
measured, the last in corridors a hundred metres long."""


def examine(
    content: MapContent, config: QualityConfig, odometry: Mapping[str, Any] | None = None
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
    points = content.node_points
    scans = points if isinstance(points, ScanPoints) else ScanPoints.of(points)
    paths = by_session.paths_apart(path_lengths(content.graph.node_poses), content.sessions)
    pairs = compared_pairs(content, scans, config, paths, by_session.same_part(content))
    is_apart = pairs.path >= config.min_visit_path
    met = encounters(pairs.take(is_apart), paths, content, scans, config)
    consecutive = pairs.take(~is_apart)
    share = _share(met)
    gaps, jumps = (by_session.events(content, find) for find in (motion.gaps, motion.jumps))
    known = {event.scan for event in gaps}
    misfits = by_session.events(content, motion.misfits)
    misfits = [event for event in misfits if event.scan not in known]
    blind = by_session.events(content, motion.blind_stretches)
    stands = by_session.standing(content, motion.standing)
    halls = by_session.corridors_of(content, config.max_range)
    rotation_error = None
    if odometry is not None and odometry.get("translation_error_m") is not None:
        # Nothing known of turns means that there were none.
        rotation_error = odometry.get("rotation_error_rad") or 0.0
    found = [
        *places.contradictions(met, share, content, config),
        *places.slide_places(slides(met, content, scans, config), met, content),
        *places.breaks(consecutive, content, config),
        *places.gap_places(gaps, content),
        *places.misfit_places(misfits, met, content),
        *places.jump_places(jumps, content),
        *places.blind_places(blind, met, content, config),
        *places.standing_places(stands, halls, content),
        *places.corridor_places(halls, rotation_error, content, config),
        *places.weak_closure_places(weak_bundles(content.graph, paths, MIN_DETOUR_M), content),
        *_open_ends(met, paths, content, config),
    ]
    order = {Severity.WRONG: 0, Severity.DOUBTFUL: 1, Severity.MINOR: 2}
    found.sort(key=lambda place: order[place.severity])
    worst = found[0].severity if found else Severity.MINOR
    bad = consecutive.contradiction > config.consecutive_contradiction
    figures = {
        "revisited_m": float(met.length.sum()),
        "contradicted_share": share,
        "displacement_m": _median(met.displacement),
        "consecutive_pairs": float(len(consecutive)),
        "consecutive_contradicted_share": float(np.mean(bad)) if len(bad) else 0.0,
        "gaps": float(len(gaps) + len(misfits)),
        "jumps": float(len(jumps)),
        "unmatched_m": float(sum(event.moved for event in blind)),
        "corridor_share": float(np.mean(halls.is_corridor)) if len(halls.nodes) else 0.0,
        "confirmed_share": _confirmed_share(met, paths),
        **_wall_figures(wall_offsets(content.graph.node_poses, scans, paths, config)),
    }
    return Quality(
        VERDICTS[worst], tuple(found), {name: round(value, 4) for name, value in figures.items()}
    )


def _share(met: Encounters) -> float:
    """Return the share of the revisited path that contradicts itself."""
    total = float(met.length.sum())
    return float(met.length[met.contradicts].sum()) / total if total > 0.0 else 0.0


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
    confirmed = places.is_confirmed(met, len(paths))
    if paths[-1] <= 0.0 or not confirmed.any():
        return 0.0
    at = paths[confirmed]
    steps, whole = np.diff(at), np.diff(paths)
    length = whole[whole < by_session.APART_M].sum()
    return float(min(steps[steps < 5.0].sum() / max(length, 1e-9), 1.0))


def _open_ends(
    met: Encounters, paths: FloatArray, content: MapContent, config: QualityConfig
) -> list[Place]:
    """Return the beginning and the end of the path as far as no other visit confirms them.

    The position at the end of a path of length L is uncertain by sigma L^1.5 / sqrt(3), if the
    heading is a random walk of sigma [rad / sqrt(m)].
    """
    is_confirmed = places.is_confirmed(met, len(paths))
    ends = []
    firsts = [session.first_node for session in content.sessions]
    for nodes in ranges(firsts, len(paths)):
        confirmed = nodes.start + np.flatnonzero(is_confirmed[nodes])
        first, last = nodes.start, nodes.stop - 1
        if len(confirmed):
            ends += [(first, int(confirmed[0])), (int(confirmed[-1]), last)]
        elif last > first:
            ends.append((first, last))
    found = []
    for start, end in ends:
        length = float(paths[end] - paths[start])
        error = HEADING_DRIFT * length**1.5 / math.sqrt(3.0)
        if error <= config.doubtful_open_error:
            continue
        found.append(
            places.of_nodes(
                start,
                end,
                content,
                Kind.OPEN,
                Severity.DOUBTFUL,
                f"{length:.0f} m of the path come back nowhere: an error of {error:.0f} m would "
                "not show",
                "let the robot return to places that it has seen, best along the way that it came",
            )
        )
    return found
