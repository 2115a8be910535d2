# SPDX-License-Identifier: Apache-2.0
"""The runs of pose adjustment while a graph grows, and which loop closures they contradict."""

from __future__ import annotations

import math
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from cartoloop.config import GlobalSlamConfig, PoseAdjustmentConfig
from cartoloop.global_slam.pose_adjustment import (
    AdjustmentOptions,
    PoseAdjuster,
    chain_share,
    constraint_residuals,
)
from cartoloop.global_slam.pose_graph import (
    TRUE_ROTATION_RAD,
    TRUE_TRANSLATION_M,
    ConstraintKind,
    PoseGraph,
)


@dataclass(frozen=True, slots=True)
class AdjustmentRun:
    """One run of pose adjustment.

    Attributes
    ----------
    nodes, submaps, constraints : size of the graph.
    iterations : linear systems solved.
    ms : time that it took [ms].
    """

    nodes: int
    submaps: int
    constraints: int
    iterations: int
    ms: float


class GraphAdjustment:
    """Adjusts one graph again and again.

    Parameters
    ----------
    graph : may grow, and its closures may be replaced.
    config : parameters.
    share : of the information of intra-submap constraints that is used.

    Attributes
    ----------
    runs : so far.
    """

    def __init__(self, graph: PoseGraph, config: GlobalSlamConfig, share: float = 1.0) -> None:
        self._graph = graph
        self._config = config
        self._adjuster = PoseAdjuster(graph)
        self._revision = graph.revision
        self._share = share
        self._decision_share = 1.0
        self.runs: list[AdjustmentRun] = []

    def run(self, max_num_iterations: int) -> NDArray[np.int64]:
        """Adjust all poses; return the constraints that are loop closures and hold by now."""
        config, graph = self._config.pose_adjustment, self._graph
        options = AdjustmentOptions(
            loss=config.loss,
            loss_scale=config.loss_scale,
            max_iterations=max_num_iterations,
            relative_tolerance=config.tolerance,
            chain_share=self._share,
            decision_share=self._decision_share,
            flexible_share=config.flexible_share,
        )
        start = perf_counter()
        if self._revision != graph.revision:
            self._adjuster = PoseAdjuster(graph)
            self._revision = graph.revision
        done = self._adjuster.adjust(options)
        self.runs.append(
            AdjustmentRun(
                nodes=graph.num_nodes,
                submaps=graph.num_submaps,
                constraints=len(graph.kinds),
                iterations=done.iterations,
                ms=1e3 * (perf_counter() - start),
            )
        )
        closures, is_violated = violated_closures(graph)
        self._distrust_strained(closures)
        return closures[~is_violated | graph.is_trusted[closures]]

    def weigh_chain(self, num_sessions: int, *, is_repaired: bool = False) -> None:
        """Use as much of the information of intra-submap constraints as the poses bear out.

        Parameters
        ----------
        is_repaired : see :func:`final_chain_share`.
        """
        config = self._config.pose_adjustment
        self._share = final_chain_share(self._graph, config, is_repaired=is_repaired)
        self._decision_share = final_decision_share(config, num_sessions)
        self._adjuster = PoseAdjuster(self._graph)

    def forget_poses(self) -> None:
        """Note that poses were changed otherwise: the next run plans again."""
        self._adjuster = PoseAdjuster(self._graph)

    def _distrust_strained(self, closures: NDArray[np.int64]) -> None:
        """Leave trusted closures that the rest of the graph contradicts to the robust loss.

        Two hypotheses that agreed may be false all the same. Later closures show that.
        """
        trusted = closures[self._graph.is_trusted[closures]]
        if len(trusted) == 0:
            return
        wide = self._config.constraint_search.wide_search
        translation_error, rotation_error = constraint_residuals(self._graph, trusted)
        is_strained = (translation_error > wide.max_strain) | (
            rotation_error > math.radians(wide.max_strain_deg)
        )
        if is_strained.any():
            self._graph.is_trusted[trusted[is_strained]] = False
            # The adjuster assumes that constraints stay as they are.
            self._adjuster = PoseAdjuster(self._graph)


def final_chain_share(
    graph: PoseGraph, config: PoseAdjustmentConfig, *, is_repaired: bool
) -> float:
    """Return the share of the chain's information that a finished map is adjusted with.

    Parameters
    ----------
    is_repaired : whether visits contradicted each other until they were matched. Then the chain
        that led them astray is too sure of itself, and few matches hold against it: it has a
        smaller share.
    """
    share = chain_share(graph, config.max_chain_chi_square)
    return min(share, config.repaired_share) if is_repaired else share


def final_decision_share(config: PoseAdjustmentConfig, num_sessions: int) -> float:
    """Return the share of the chain's information that decides which closures of a map are false.

    The chain of submaps does not connect sessions. Where few closures do, all of its information
    would outweigh them: there it is the same share as while mapping.
    """
    return config.mapping_share if num_sessions > 1 else 1.0


def violated_closures(graph: PoseGraph) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return the constraints that are loop closures, and which of them must be false."""
    closures = np.flatnonzero(graph.kinds == ConstraintKind.LOOP_CLOSURE)
    translation_error, rotation_error = constraint_residuals(graph, closures)
    return closures, (
        (translation_error > TRUE_TRANSLATION_M) | (rotation_error > TRUE_ROTATION_RAD)
    )
