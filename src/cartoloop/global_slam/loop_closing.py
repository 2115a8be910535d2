# SPDX-License-Identifier: Apache-2.0
"""Takes loop closures into the pose graph and the record, and adjusts the poses to them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cartoloop.config import GlobalSlamConfig
from cartoloop.global_slam.closure_matches import SearchMatches
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.graph_adjustment import (
    AdjustmentRun,
    GraphAdjustment,
    violated_closures,
)
from cartoloop.global_slam.graph_building import GraphBuilder
from cartoloop.global_slam.graph_records import PoseNotes, matches_record
from cartoloop.global_slam.pair_selection import PairSelection
from cartoloop.global_slam.part_joins import Join
from cartoloop.global_slam.pose_graph import ClosureConstraints, PoseGraph
from cartoloop.global_slam.sessions import SessionRanges
from cartoloop.journal.frames import Kind
from cartoloop.journal.outcomes import RecordedOutcomes
from cartoloop.runtime.stage_timer import StageTimer
from cartoloop.sensor.pose import IDENTITY, Pose, compose, inverse


class LoopClosing:
    """Adds loop closures to a graph, adjusts it, and removes those that prove to be false.

    Parameters
    ----------
    config : parameters of global SLAM.
    graph : pose graph, to which others add nodes and submaps.
    closures : the record of all pairs that were requested or matched.
    sessions : of the graph.
    builder : adds the nodes and submaps.
    pairs : selects pairs by the closures that hold.
    timer : takes the times.
    outcomes : of a run with a journal; what is believed and the poses are recorded there.

    Attributes
    ----------
    tf_map_local : pose of the local frame in the map since the last adjustment.
    """

    def __init__(
        self,
        config: GlobalSlamConfig,
        graph: PoseGraph,
        closures: Closures,
        sessions: SessionRanges,
        builder: GraphBuilder,
        pairs: PairSelection,
        timer: StageTimer,
        outcomes: RecordedOutcomes,
    ) -> None:
        self._graph = graph
        self._closures = closures
        self._sessions = sessions
        self._builder = builder
        self._pairs = pairs
        self._timer = timer
        self._recorded = outcomes
        self._poses = PoseNotes(outcomes)
        self._adjustment = GraphAdjustment(graph, config, config.pose_adjustment.mapping_share)
        self.tf_map_local = IDENTITY

    @property
    def runs(self) -> Sequence[AdjustmentRun]:
        """The runs of pose adjustment so far."""
        return self._adjustment.runs

    def add(self, found: SearchMatches, *, are_trusted: bool) -> None:
        """Add loop closures to the record and to the graph."""
        submaps, nodes = self._closures.submap[found.row], self._closures.node[found.row]
        self._closures.add_found(found, self._graph.num_nodes)
        self._pairs.note_found(submaps, nodes)
        self._graph.add_loop_closures(
            ClosureConstraints(found.row, submaps, nodes, found.tf_submap_node, found.information),
            are_trusted=are_trusted,
        )

    def believe(self, found: SearchMatches, max_num_iterations: int) -> None:
        """Add loop closures that agree with each other, and adjust."""
        if self._recorded.replay(Kind.BELIEVED) is None and self._recorded.is_recording:
            self._recorded.record(Kind.BELIEVED, matches_record(found))
        self.add(found, are_trusted=True)
        self.adjust(max_num_iterations)

    def join(self, join: Join, max_num_iterations: int) -> None:
        """Add the closures that hold two parts together, and adjust."""
        self._adjustment.forget_poses()
        self.add(join.found, are_trusted=True)
        self.add(join.nearby, are_trusted=False)
        self._adjust(max_num_iterations)

    def adjust(self, max_num_iterations: int) -> None:
        """Adjust all poses."""
        with self._timer.measure("adjust"):
            self._adjust(max_num_iterations)

    def settle(self, max_num_iterations: int) -> None:
        """Adjust the finished map, with the chain as strong as the poses bear out."""
        with self._timer.measure("adjust"):
            self._weigh_chain()
            self._adjust(max_num_iterations)

    def remove_contradicted(self, max_num_iterations: int, *, weigh_chain: bool) -> None:
        """Remove the loop closures that the other constraints contradict, and adjust again.

        Parameters
        ----------
        weigh_chain : whether the chain is to be as strong as the poses bear out, as by `settle`.
        """
        with self._timer.measure("adjust"):
            if weigh_chain:
                self._weigh_chain()
            closures, is_violated = violated_closures(self._graph)
            if is_violated.any():
                is_false = np.zeros(self._graph.num_constraints, dtype=bool)
                is_false[closures[is_violated]] = True
                self._closures.note_contradicted(self._graph.closure_rows[is_false])
                self._graph.remove(is_false)
                self._adjust(max_num_iterations)

    def _weigh_chain(self) -> None:
        is_repaired = self._closures.is_repaired
        self._adjustment.weigh_chain(len(self._sessions), is_repaired=is_repaired)

    def _adjust(self, max_num_iterations: int) -> None:
        holding = self._adjustment.run(max_num_iterations)
        newest = Pose(*self._graph.submap_poses[-1].tolist())
        self.tf_map_local = compose(newest, inverse(self._builder.tf_local_last_submap))
        self._poses.note(self._graph.submap_poses)
        self._pairs.note_adjusted(self._graph, holding)
