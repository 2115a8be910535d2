# SPDX-License-Identifier: Apache-2.0
"""A map while edits are applied to it, one by one, in the numbering of the map as mapped."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.global_slam.closure_matches import FinalMatches
from cartoloop.global_slam.closure_status import Reason
from cartoloop.global_slam.graph_adjustment import final_chain_share, final_decision_share
from cartoloop.global_slam.pose_adjustment import AdjustmentOptions, adjust
from cartoloop.global_slam.pose_graph import ClosureConstraints
from cartoloop.map_data import MapData
from cartoloop.map_editing.arguments import Add, ForgetArea, ForgetTime
from cartoloop.map_editing.rectangle import Rectangle, returns_inside
from cartoloop.map_editing.rigid_fit import PointFit, fit_points
from cartoloop.map_editing.sessions import joined, main_part, renamed, split
from cartoloop.sensor.pose import IDENTITY, Pose, compose, compose_all, inverse, relative_all
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.session import MAIN_PART

_SYMMETRIC = np.array(((0, 1, 2), (1, 3, 4), (2, 4, 5)))


class WorkingMap:
    """A map that is edited.

    Parameters
    ----------
    original : the map as mapped, which stays as it is.

    Attributes
    ----------
    graph, closures : copies of those of the map, changed by the edits; poses are those of the last
        adjustment. Nothing is removed from them but constraints.
    sessions : those of the map.
    tf_map_original : by how much the map as a whole was moved: all of it that is connected.
    is_forgotten : which scans are left out, shape (num_scans,).
    areas : of each submap the rectangles, in its frame, whose cells become unknown.
    is_erased : which points of all nodes are left out; None for none of them.
    """

    def __init__(self, original: MapData) -> None:
        self._original = original
        self.graph = original.graph.copy()
        self.closures = original.closures.copy()
        self.sessions = original.sessions
        self.tf_map_original = IDENTITY
        self.is_forgotten: BoolArray = np.zeros(len(original.stamps), dtype=bool)
        self.areas: dict[int, list[Rectangle]] = {}
        self.is_erased: BoolArray | None = None
        self._held: tuple[dict[int, None], dict[int, None]] = ({}, {})
        self._is_adjusted = True

    @cached_property
    def points(self) -> ScanPoints:
        """The returns of all nodes of the map as mapped."""
        points = self._original.node_points
        return points if isinstance(points, ScanPoints) else ScanPoints.of(points)

    def drop(self, pairs: Iterable[tuple[int, int]]) -> None:
        """Remove the closures of these pairs that are in the graph."""
        graph, closures = self.graph, self.closures
        rows = [row for pair in pairs if (row := closures.find(*pair)) is not None]
        is_dropped = np.isin(graph.closure_rows, np.array(rows, dtype=np.int64))
        is_dropped &= graph.closure_rows >= 0
        if is_dropped.any():
            closures.note_removed(graph.closure_rows[is_dropped])
            graph.remove(is_dropped)
            self._is_adjusted = False

    def add(self, closure: Add) -> None:
        """Add a closure that no robust loss weakens, unless its pair has one in the graph."""
        row = self.closures.find(closure.submap, closure.node)
        if row is not None and np.any(self.graph.closure_rows == row):
            return
        self._join_parts(closure)
        information = np.array(closure.information)[_SYMMETRIC]
        match = FinalMatches(
            submap=np.array([closure.submap]),
            node=np.array([closure.node]),
            tf_submap_node=np.array([closure.tf_submap_node]),
            information=information[np.newaxis],
            residual=np.array([closure.residual]),
            moved_m=np.array([closure.moved[0]]),
            moved_rad=np.array([closure.moved[1]]),
            reason=np.array([Reason.EDIT], dtype=np.int8),
        )
        row = self.closures.note_added(match)
        self.graph.add_loop_closures(
            ClosureConstraints(
                np.array([row]), match.submap, match.node, match.tf_submap_node, match.information
            ),
            are_trusted=True,
        )
        self._is_adjusted = False

    def pin(self, submap: int | None, node: int | None, pose: Pose) -> None:
        """Hold a submap or a node at a pose of the map as mapped.

        The first pin moves the whole map; from then on the first submap is not held any more.
        """
        graph = self.graph
        if submap is not None:
            index, held, poses = submap, self._held[0], graph.submap_poses
        elif node is not None:
            index, held, poses = node, self._held[1], graph.node_poses
        else:
            raise ValueError("a pin holds either a submap or a node")
        num_held = len(self._held[0]) + len(self._held[1])
        is_first = num_held == (1 if index in held else 0)
        target = compose(self.tf_map_original, pose)
        if is_first:
            self.adjust()
            self.move(compose(target, inverse(Pose(*poses[index].tolist()))))
        else:
            self._is_adjusted = False
        poses[index] = target
        held[index] = None
        graph.hold_only(*self._held)

    def move(self, tf_new_old: Pose) -> None:
        """Move the whole map, but for parts that are apart."""
        self._move_part(MAIN_PART, tf_new_old)
        self.tf_map_original = compose(tf_new_old, self.tf_map_original)

    def _move_part(self, part: int, tf_new_old: Pose) -> None:
        graph, by = self.graph, np.array(tf_new_old)
        placed = replace(self._original, sessions=self.sessions)
        submaps, nodes = placed.submap_parts == part, placed.node_parts == part
        graph.submap_poses[submaps] = compose_all(by, graph.submap_poses[submaps])
        graph.node_poses[nodes] = compose_all(by, graph.node_poses[nodes])

    def _join_parts(self, closure: Add) -> None:
        """Move a part to where a closure sees it from another, and make them one."""
        placed = replace(self._original, sessions=self.sessions)
        of_submap = int(placed.submap_parts[closure.submap])
        of_node = int(placed.node_parts[closure.node])
        if of_submap == of_node:
            return
        self.adjust()
        node = Pose(*self.graph.node_poses[closure.node].tolist())
        submap = Pose(*self.graph.submap_poses[closure.submap].tolist())
        seen = compose(submap, Pose(*closure.tf_submap_node))
        if of_submap < of_node:
            self._move_part(of_node, compose(seen, inverse(node)))
        else:
            self._move_part(of_submap, compose(node, inverse(seen)))
        low, high = sorted((of_submap, of_node))
        self.sessions = joined(self.sessions, high, low)

    def turn_to(self, angle: float) -> None:
        """Turn the map about its origin until it is turned by `angle` [rad] from as mapped."""
        self.adjust()
        self.move(Pose(0.0, 0.0, angle - self.tf_map_original.theta))

    def move_to_points(
        self, nodes: IntArray, tf_node_place: FloatArray, surveyed: FloatArray
    ) -> PointFit:
        """Move the whole map so that places agree best with their surveyed positions.

        Parameters
        ----------
        nodes : shape (n,).
        tf_node_place : shape (n, 2), places in the frames of the nodes [m].
        surveyed : shape (n, 2) [m].
        """
        self.adjust()
        places = np.column_stack((tf_node_place, np.zeros(len(nodes))))
        fit = fit_points(compose_all(self.graph.node_poses[nodes], places)[:, :2], surveyed)
        self.move(fit.tf_surveyed_map)
        return fit

    def forget_time(self, span: ForgetTime) -> None:
        """Leave out the scans from one stamp to another."""
        stamps = self._original.stamps
        inside = (stamps >= span.from_stamp) & (stamps <= span.to_stamp)
        if span.scans is not None:
            first, end = span.scans
            inside[:first] = False
            inside[end:] = False
        self.is_forgotten |= inside

    def forget_area(self, area: ForgetArea) -> None:
        """Leave out what was seen in a rectangle."""
        self.adjust()
        corner = np.array(compose(self.tf_map_original, Pose(*area.corner)))
        graph = self.graph
        submaps, nodes = main_part(self._original, self.sessions)
        of_submaps = relative_all(graph.submap_poses[submaps], corner)
        for submap, corner_seen in zip(submaps.tolist(), of_submaps.tolist(), strict=True):
            rectangle = Rectangle(Pose(*corner_seen), *area.size)
            self.areas.setdefault(submap, []).append(rectangle)
        points = self.points
        if len(points) == 0:
            return
        rectangle = Rectangle(Pose(*corner.tolist()), *area.size)
        inside = returns_inside(rectangle, points, graph.node_poses)
        is_placed = np.zeros(graph.num_nodes, dtype=bool)
        is_placed[nodes] = True
        inside &= np.repeat(is_placed, points.counts)
        self.is_erased = inside if self.is_erased is None else self.is_erased | inside

    def split(self, scan: int, name: str) -> None:
        """Split a session before a scan."""
        self.sessions = split(self._original, self.sessions, scan, name)

    def rename(self, scan: int, name: str) -> None:
        """Give the session that begins with a scan another name."""
        self.sessions = renamed(self.sessions, scan, name)

    def adjust(self) -> None:
        """Adjust the poses, if the constraints or what is held have changed since."""
        if self._is_adjusted:
            return
        config = self._original.config.global_slam.pose_adjustment
        options = AdjustmentOptions(
            loss=config.loss,
            loss_scale=config.loss_scale,
            max_iterations=config.max_num_final_iterations,
            relative_tolerance=config.tolerance,
            chain_share=final_chain_share(
                self.graph, config, is_repaired=self._original.closures.is_repaired
            ),
            decision_share=final_decision_share(config, len(self._original.sessions)),
            flexible_share=config.flexible_share,
        )
        adjust(self.graph, options)
        self._is_adjusted = True
