# SPDX-License-Identifier: Apache-2.0
"""What an edit changes in a map, in figures and in words."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cartoloop.global_slam.pose_adjustment import constraint_residuals
from cartoloop.global_slam.pose_graph import (
    TRUE_ROTATION_RAD,
    TRUE_TRANSLATION_M,
    ConstraintKind,
    PoseGraph,
)
from cartoloop.map_editing.apply import AnyMap, Applied
from cartoloop.map_editing.rigid_fit import PointFit
from cartoloop.quality import by_session, motion
from cartoloop.sensor.pose import wrap_angles
from cartoloop.sensor.scan_points import ScanPoints

_SHOWN_POINTS = 20
"""Control points whose residuals are printed."""


@dataclass(frozen=True, slots=True)
class Change:
    """What an edit has changed, or would change.

    Attributes
    ----------
    number : of the edit.
    what : the edit in words.
    moved_m, moved_rad : by how much poses of nodes moved, at most.
    mean_moved_m : the same in the mean [m].
    scans, nodes, submaps, closures, returns : how many more of them the map has, less where
        negative; `returns` are those of nodes.
    contradicted : loop closures in the graph that the other constraints contradict now, by more
        than 0.2 m or 1 degree.
    fit : of control points.
    warnings : what the user may not have meant, a sentence each.
    """

    number: int
    what: str
    moved_m: float
    moved_rad: float
    mean_moved_m: float
    scans: int
    nodes: int
    submaps: int
    closures: int
    returns: int
    contradicted: int
    fit: PointFit | None = None
    warnings: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """The change for people, some lines."""
        lines = [f"edit {self.number}: {self.what}"]
        moved = "no pose moved"
        if self.moved_m > 0.0 or self.moved_rad > 0.0:
            degrees = math.degrees(self.moved_rad)
            moved = f"poses moved by at most {self.moved_m:.3f} m, {degrees:.2f} deg; "
            moved += f"{self.mean_moved_m:.3f} m in the mean"
        lines.append(f"  {moved}")
        counts = {
            "scans": self.scans,
            "nodes": self.nodes,
            "submaps": self.submaps,
            "loop closures": self.closures,
            "returns of nodes": self.returns,
        }
        changed = [f"{count:+d} {name}" for name, count in counts.items() if count]
        if changed:
            lines.append(f"  {', '.join(changed)}")
        if self.contradicted:
            lines.append(
                f"  {self.contradicted} loop closures in the graph disagree by more than "
                f"{TRUE_TRANSLATION_M:g} m or {math.degrees(TRUE_ROTATION_RAD):g} deg; see "
                "'closures --worst 10'"
            )
        if self.fit is not None:
            lines += _fit_lines(self.fit)
        lines += [f"  warning: {warning}" for warning in self.warnings]
        return "\n".join(lines)


def change_of(
    number: int,
    what: str,
    before: Applied[AnyMap],
    after: Applied[AnyMap],
    fit: PointFit | None = None,
) -> Change:
    """Return what has changed from one state of a map to the next."""
    old, new = before.map.graph, after.map.graph
    _, in_old, in_new = np.intersect1d(
        before.kept.nodes, after.kept.nodes, assume_unique=True, return_indices=True
    )
    moved = new.node_poses[in_new] - old.node_poses[in_old]
    metres, radians = np.hypot(moved[:, 0], moved[:, 1]), np.abs(wrap_angles(moved[:, 2]))
    return Change(
        number=number,
        what=what,
        moved_m=float(metres.max(initial=0.0)),
        moved_rad=float(radians.max(initial=0.0)),
        mean_moved_m=float(metres.mean()) if len(metres) else 0.0,
        scans=len(after.kept.scans) - len(before.kept.scans),
        nodes=new.num_nodes - old.num_nodes,
        submaps=new.num_submaps - old.num_submaps,
        closures=new.num_loop_closures - old.num_loop_closures,
        returns=_num_returns(after) - _num_returns(before),
        contradicted=num_contradicted(new),
        fit=fit,
        warnings=_warnings(number, before, after, fit),
    )


def _warnings(
    number: int, before: Applied[AnyMap], after: Applied[AnyMap], fit: PointFit | None
) -> tuple[str, ...]:
    """Return what the user may not have meant with an edit."""
    found = []
    if fit is not None and fit.is_doubtful:
        largest = int(np.argmax(fit.distances)) + 1
        which = f"; point {largest} fits worst" if len(fit.residuals) > 2 else ""
        found.append(
            f"the points do not fit the map: one may be mistyped, or x and y exchanged{which}"
        )
    is_fitted = any(earlier < number for earlier in after.fits)
    edits = after.map.edits[number : number + 1]
    if is_fitted and any(edit.kind == "align" and not edit.is_undone for edit in edits):
        found.append(
            "the map is turned away from the survey, about the origin of its frame; 'undo' turns "
            "it back"
        )
    torn_before = {
        before.map.stamps[tear.scan] for tear in by_session.events(before.map, motion.tears)
    }
    torn = [
        tear
        for tear in by_session.events(after.map, motion.tears)
        if after.map.stamps[tear.scan] not in torn_before
    ]
    if torn:
        worst = max(torn, key=lambda tear: tear.moved)
        found.append(
            f"the path is torn: {worst.moved:.1f} m from one scan to the next at "
            f"{after.map.stamps[worst.scan]:.3f}, {worst.expected:.1f} m by the scans; pins or "
            "closures contradict each other"
        )
    return tuple(found)


def num_contradicted(graph: PoseGraph) -> int:
    """Return how many loop closures of a graph the other constraints contradict."""
    closures = np.flatnonzero(graph.kinds == ConstraintKind.LOOP_CLOSURE)
    metres, radians = constraint_residuals(graph, closures)
    return int(np.count_nonzero((metres > TRUE_TRANSLATION_M) | (radians > TRUE_ROTATION_RAD)))


def _num_returns(applied: Applied[AnyMap]) -> int:
    points = applied.map.node_points
    return int(points.counts.sum()) if isinstance(points, ScanPoints) else sum(map(len, points))


def _fit_lines(fit: PointFit) -> list[str]:
    x, y, theta = fit.tf_surveyed_map
    distances = fit.distances
    lines = [f"  moved by x {x:.3f} m, y {y:.3f} m, turned by {math.degrees(theta):.3f} deg"]
    shown = list(zip(fit.residuals.tolist(), distances.tolist(), strict=True))[:_SHOWN_POINTS]
    lines += [
        f"  point {number}: residual x {dx:+.3f} m, y {dy:+.3f} m, {distance:.3f} m"
        for number, ((dx, dy), distance) in enumerate(shown, 1)
    ]
    rms = math.sqrt(float(np.mean(distances**2)))
    last = f"  residuals: root mean square {rms:.3f} m, largest {distances.max():.3f} m"
    if fit.scale > 0.0:
        word = "larger" if fit.larger >= 0.0 else "smaller"
        last += f"; the map is {100.0 * abs(fit.larger):.2f}% {word} than the survey, "
        last += "which is left so"
    lines.append(last)
    return lines
