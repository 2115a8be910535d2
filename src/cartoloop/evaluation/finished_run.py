# SPDX-License-Identifier: Apache-2.0
"""Reading back the graph and the loop closures of the folder that a run wrote."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from cartoloop.errors import InputError
from cartoloop.map_output.closures_file import CLOSURE_COLUMNS, NODE_COLUMNS, Stage
from cartoloop.readers.g2o import read_g2o

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Row = TypeVar("Row")


@dataclass(frozen=True)
class Closures:
    """Loop closures of one stage, row by row.

    Attributes
    ----------
    submap, node : int64 (k,), indices in the graph.
    tf_submap_node : float64 (k, 3), where the node was seen [m, m, rad].
    score, runner_up : float64 (k,), NaN where nothing was searched.
    residual_m, residual_deg : float64 (k,), by how much the final poses disagree.
    weight : float64 (k,), what the robust loss leaves of its information there, in [0, 1].
    """

    submap: IntArray
    node: IntArray
    tf_submap_node: FloatArray
    score: FloatArray
    runner_up: FloatArray
    residual_m: FloatArray
    residual_deg: FloatArray
    weight: FloatArray

    def __len__(self) -> int:
        return len(self.submap)


@dataclass(frozen=True)
class FinishedRun:
    """What a run wrote of its graph.

    Attributes
    ----------
    folder : where it was read from.
    stamps : float64 (n,), names of the nodes' scans [s].
    node_poses, submap_poses : float64 (n, 3), (s, 3), optimised [m, m, rad].
    own_submap, own_node : int64 (m,), which nodes were inserted into which submaps.
    own_pose : float64 (m, 3), where each was inserted, tf_submap_node [m, m, rad].
    closures : by stage.
    """

    folder: Path
    stamps: FloatArray
    node_poses: FloatArray
    submap_poses: FloatArray
    own_submap: IntArray
    own_node: IntArray
    own_pose: FloatArray
    closures: dict[Stage, Closures]

    @property
    def num_nodes(self) -> int:
        """How many nodes there are."""
        return len(self.node_poses)

    @property
    def num_submaps(self) -> int:
        """How many submaps there are."""
        return len(self.submap_poses)

    def first_submap(self) -> IntArray:
        """Return the oldest submap that each node was inserted into, shape (n,)."""
        first = np.full(self.num_nodes, self.num_submaps, dtype=np.int64)
        np.minimum.at(first, self.own_node, self.own_submap)
        return first


def read_run(folder: str | PathLike[str]) -> FinishedRun:
    """Return what ``cartoloop map`` wrote of the graph into a folder.

    Raises
    ------
    InputError
        ``nodes.csv``, ``closures.csv`` or ``graph.g2o`` is missing, malformed, or not of the same
        run as the others; or nothing was mapped.
    """
    folder = Path(folder)
    for name in ("nodes.csv", "closures.csv", "graph.g2o"):
        if not (folder / name).is_file():
            raise InputError(
                f"{folder}: has no {name}; give a folder that this version of 'cartoloop map' wrote"
            )
    nodes = _read_csv(folder / "nodes.csv", NODE_COLUMNS, _parse_node)
    if not nodes:
        raise InputError(f"{folder / 'nodes.csv'}: has no nodes: nothing was mapped")
    if [node for node, _, _ in nodes] != list(range(len(nodes))):
        raise InputError(f"{folder / 'nodes.csv'}: nodes are not 0, 1, 2, ...; map again")
    own = [(submap, node) for node, _, submaps in nodes for submap in submaps]
    own_submap, own_node = np.array(own, dtype=np.int64).reshape(-1, 2).T
    poses, own_pose = _read_graph(folder / "graph.g2o", len(nodes), own_submap, own_node)
    rows = _read_csv(folder / "closures.csv", CLOSURE_COLUMNS, _parse_closure)
    return FinishedRun(
        folder=folder,
        stamps=np.array([stamp for _, stamp, _ in nodes]),
        node_poses=poses[: len(nodes)],
        submap_poses=poses[len(nodes) :],
        own_submap=own_submap,
        own_node=own_node,
        own_pose=own_pose,
        closures={
            stage: _closures(rows, stage, folder, len(nodes), len(poses) - len(nodes))
            for stage in Stage
        },
    )


def _read_graph(
    path: Path, num_nodes: int, own_submap: IntArray, own_node: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return all poses, those of submaps last, and where nodes were inserted into submaps."""
    graph = read_g2o(path)
    submap = graph.index_a - num_nodes
    key = submap * num_nodes + graph.index_b
    order = np.argsort(key, kind="stable")
    place = np.searchsorted(key[order], own_submap * num_nodes + own_node)
    edge = order[np.minimum(place, len(order) - 1)] if len(order) else np.zeros(0, dtype=np.int64)
    if len(edge) != len(own_submap) or np.any(
        (submap[edge] != own_submap) | (graph.index_b[edge] != own_node)
    ):
        raise InputError(f"{path}: is not of the same run as nodes.csv beside it; map again")
    return graph.node_poses, graph.relative_poses[edge]


def _closures(
    rows: list[tuple[str, int, int, list[float]]],
    stage: Stage,
    folder: Path,
    num_nodes: int,
    num_submaps: int,
) -> Closures:
    chosen = [(submap, node, values) for name, submap, node, values in rows if name == stage]
    submap, node = (
        np.array([(submap, node) for submap, node, _ in chosen], np.int64).reshape(-1, 2).T
    )
    table = np.array([values for _, _, values in chosen], dtype=np.float64).reshape(-1, 8)
    if np.any((submap < 0) | (submap >= num_submaps) | (node < 0) | (node >= num_nodes)):
        raise InputError(
            f"{folder / 'closures.csv'}: names a node or a submap that graph.g2o beside it does "
            "not have; map again"
        )
    return Closures(submap, node, table[:, :3], *table[:, 3:].T)


def _parse_node(fields: list[str]) -> tuple[int, float, list[int]]:
    node, stamp, submaps = fields
    return int(node), _finite(stamp), [int(submap) for submap in submaps.split()]


def _parse_closure(fields: list[str]) -> tuple[str, int, int, list[float]]:
    stage, submap, node, *numbers = fields
    x, y, theta, score, runner_up, *residuals = numbers
    searched = [math.nan if text == "" else _finite(text) for text in (score, runner_up)]
    values = [*map(_finite, (x, y, theta)), *searched, *map(_finite, residuals)]
    return Stage(stage).value, int(submap), int(node), values


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{text} is not finite")
    return number


def _read_csv(path: Path, columns: tuple[str, ...], parse: Callable[[list[str]], Row]) -> list[Row]:
    """Return the rows of a CSV file as `parse` understands them."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({error}); map again") from error
    expected = ",".join(columns)
    if not lines or lines[0] != expected:
        raise InputError(f"{path}:1: expected the header '{expected}'; map again")
    rows = []
    for number, fields in enumerate(csv.reader(lines[1:]), start=2):
        try:
            if len(fields) != len(columns):
                raise ValueError(f"{len(fields)} fields where {len(columns)} are due")
            rows.append(parse(fields))
        except ValueError as error:
            raise InputError(f"{path}:{number}: is malformed ({error}); map again") from error
    return rows
