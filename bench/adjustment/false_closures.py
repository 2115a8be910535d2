# SPDX-License-Identifier: Apache-2.0
"""``python -m bench false-closures``: one adjustment of graphs in which many closures are false.

Loop closures of synthetic graphs are replaced by false ones. The error is that of the nodes against
an adjustment without the false ones, which is the best that a loss can reach. Two kinds:

*random*: each false closure is wrong by itself, by metres and at any heading nearby.

*agreeing*: false closures come in groups, as where a place looks like another. All closures between
a submap and a stretch of the path are wrong by the same transform, so they support each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from bench.adjustment.synthetic_graphs import bipartite_graph
from bench.environment import environment
from bench.record import Figure, Record, Row
from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.global_slam.pose_adjustment import AdjustmentOptions, adjust
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.pose_adjustment import Loss
from cartoloop.sensor.pose import compose_all, wrap_angles

KINDS = ("random", "agreeing")
SHARES = (0.1, 0.3, 0.5)
"""Shares of the closures that are false."""
SIZE = (3_000, 60, 7_500)
"""Nodes, submaps and constraints of a graph."""
SEEDS = 10

_OFFSET_M = (1.0, 7.0)
"""How far false closures are off [m]: as far as searches in a window of 7 m can be."""
_TURN_RAD = 0.5
"""Largest error of their headings [rad]."""
_GROUP_NODES = 60
"""Nodes of a stretch of the path [nodes], 12 m."""


class FalseClosures(NamedTuple):
    """A graph that starts with drift, and where it belongs.

    Attributes
    ----------
    graph : with false closures.
    is_false : bool, shape (num_constraints,).
    node_poses : adjusted without them, shape (num_nodes, 3) [m, m, rad].
    """

    graph: PoseGraph
    is_false: BoolArray
    node_poses: FloatArray

    def error(self) -> float:
        """Return the mean distance of the graph's nodes from where they belong [m]."""
        offsets = self.graph.node_poses[:, :2] - self.node_poses[:, :2]
        return float(np.hypot(offsets[:, 0], offsets[:, 1]).mean())


def run(seeds: int = SEEDS, losses: Sequence[Loss] = tuple(Loss)) -> Record:
    """Adjust graphs with false closures once with each loss, and with the default.

    Parameters
    ----------
    seeds : graphs of each kind and share.
    losses : at their default scales.

    Returns
    -------
    record : a row for each kind, share and loss.
    """
    default = AdjustmentOptions()
    named = {f"{loss}": AdjustmentOptions(loss) for loss in losses if loss is not default.loss}
    rows = []
    for kind in KINDS:
        for share in SHARES:
            graphs = [graph_with_false_closures(kind, share, seed) for seed in range(seeds)]
            for name, options in {f"{default.loss} (default)": default, **named}.items():
                case: dict[str, str | int | float] = {"false": kind, "share": share, "loss": name}
                rows.append(Row(case, _figures(graphs, options)))
    return Record("false-closures", tuple(rows), environment())


def _figures(graphs: Sequence[FalseClosures], options: AdjustmentOptions) -> dict[str, Figure]:
    errors, iterations = [], []
    for made in graphs:
        copied = made._replace(graph=made.graph.copy())
        iterations.append(adjust(copied.graph, options).iterations)
        errors.append(copied.error())
    return {
        "mean error": Figure.exact(float(np.mean(errors)), "m"),
        "largest error": Figure.exact(max(errors), "m"),
        "iterations": Figure.exact_of_inputs(iterations),
    }


def graph_with_false_closures(
    kind: str, share: float, seed: int, size: tuple[int, int, int] = SIZE
) -> FalseClosures:
    """Return a graph in which a share of the loop closures is false; same arguments, same bytes."""
    made = bipartite_graph(*size, seed=seed)
    graph, rng = made.graph, np.random.default_rng([seed, KINDS.index(kind)])
    closures = np.flatnonzero(graph.kinds == ConstraintKind.LOOP_CLOSURE)
    if kind == "agreeing":
        stretches = graph.index_b[closures] // _GROUP_NODES
        groups = _numbered(np.column_stack((graph.index_a[closures], stretches)))
    else:
        groups = np.arange(closures.size)
    chosen = _groups_of_share(groups, share, rng)
    is_false = np.zeros(graph.num_constraints, dtype=bool)
    is_false[closures[chosen[groups]]] = True
    errors = _errors(chosen.size, rng)[groups[chosen[groups]]]
    measured = graph.relative_poses.copy()
    measured[is_false] = compose_all(errors, measured[is_false])
    measured[:, 2] = wrap_angles(measured[:, 2])
    spoilt = graph.without(np.ones(graph.num_constraints, dtype=bool))
    spoilt.add_constraints(graph.kinds, graph.index_a, graph.index_b, measured, graph.informations)
    clean = spoilt.without(is_false)
    clean.submap_poses[:], clean.node_poses[:] = made.submaps, made.nodes
    adjust(clean, AdjustmentOptions(Loss.NONE))
    return FalseClosures(spoilt, is_false, clean.node_poses.copy())


def _numbered(rows: IntArray) -> IntArray:
    """Return the number of each row among the different ones."""
    return np.unique(rows, axis=0, return_inverse=True)[1].ravel().astype(np.int64)


def _groups_of_share(groups: IntArray, share: float, rng: np.random.Generator) -> BoolArray:
    """Return which groups are false, bool: as many at random as hold a share of the closures."""
    sizes = np.bincount(groups)
    order = rng.permutation(sizes.size)
    is_false = np.zeros(sizes.size, dtype=bool)
    is_false[order[: np.searchsorted(np.cumsum(sizes[order]), share * groups.size) + 1]] = True
    return is_false


def _errors(count: int, rng: np.random.Generator) -> FloatArray:
    distance, direction = rng.uniform(*_OFFSET_M, count), rng.uniform(-np.pi, np.pi, count)
    turn = rng.uniform(-_TURN_RAD, _TURN_RAD, count)
    return np.column_stack((distance * np.cos(direction), distance * np.sin(direction), turn))
