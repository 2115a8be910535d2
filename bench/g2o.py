# SPDX-License-Identifier: Apache-2.0
"""2D pose graphs in g2o's text format, plain or gzip.

Lines ``VERTEX_SE2 id x y theta``, ``EDGE_SE2 id_a id_b x y theta i_xx i_xy i_xt i_yy i_yt i_tt``
and ``FIX id``; others are skipped. g2o measures an edge's error in the frame of the *measured*
b, eq. (5) in the frame of a: with R the measured rotation, e_g2o = -R^T e, so that the information
matrix is turned on reading.
"""

from __future__ import annotations

import gzip
import logging
import math
import zlib
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cartoloop.errors import InputError
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.sensor.pose import IDENTITY, Pose, compose, inverse

FloatArray = NDArray[np.float64]

LARGEST_NUMBER = 1e100
"""Sums of products of larger ones are not finite."""

_logger = logging.getLogger(__name__)

_GZIP_MAGIC = b"\x1f\x8b"


@dataclass
class _Contents:
    poses: dict[int, Pose] = field(default_factory=dict)
    edge_ids: list[tuple[int, int]] = field(default_factory=list)
    edge_values: list[list[float]] = field(default_factory=list)
    fixed: list[int] = field(default_factory=list)


def read_g2o(path: Path) -> PoseGraph:
    """Return the graph in a g2o file: all its vertices are nodes, in ascending order of their ids.

    Vertices that edges name but no line places are placed along a breadth-first spanning tree of
    the edges, from the vertices that are placed, or else from the lowest id at the origin.

    Raises
    ------
    InputError
        The file cannot be read, or holds neither vertex nor edge.

    Notes
    -----
    Lines that are malformed, hold a value that is not finite or an information matrix that is not
    positive semidefinite, or join a vertex to itself, are skipped, and counted in a warning.
    """
    contents = _parse(path, _lines(path))
    if not contents.poses and not contents.edge_ids:
        raise InputError(
            f"{path}: holds neither VERTEX_SE2 nor EDGE_SE2 lines: is it a 2D g2o file?"
        )
    _place_missing(contents)
    ids = sorted(contents.poses)
    node_of = {vertex: node for node, vertex in enumerate(ids)}
    graph = PoseGraph()
    graph.add_nodes(np.array([contents.poses[vertex] for vertex in ids]))
    if contents.edge_ids:
        values = np.array(contents.edge_values)
        graph.add_constraints(
            ConstraintKind.NODE_TO_NODE,
            [node_of[a] for a, _ in contents.edge_ids],
            [node_of[b] for _, b in contents.edge_ids],
            values[:, :3],
            _information_in_frame_of_a(values),
        )
    for vertex in contents.fixed:
        graph.fix_node(node_of[vertex])
    return graph


def _lines(path: Path) -> list[str]:
    try:
        data = path.read_bytes()
        if data.startswith(_GZIP_MAGIC):
            data = gzip.decompress(data)
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(f"{path}: cannot be read ({error}): check the file") from error
    try:
        return data.decode().splitlines()
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not text: give a g2o file, plain or gzip") from error


def _parse(path: Path, lines: list[str]) -> _Contents:
    contents = _Contents()
    faults: list[str] = []
    for number, line in enumerate(lines, start=1):
        tag, *words = line.split() or [""]
        try:
            if tag == "VERTEX_SE2":
                vertex, *pose = _numbers(words, num_ids=1, num_values=3)
                contents.poses[int(vertex)] = Pose(*pose)
            elif tag == "EDGE_SE2":
                a, b, *values = _numbers(words, num_ids=2, num_values=9)
                _check_edge(int(a), int(b), values)
                contents.edge_ids.append((int(a), int(b)))
                contents.edge_values.append(values)
            elif tag == "FIX":
                contents.fixed.extend(int(word) for word in words)
        except (ValueError, OverflowError, np.linalg.LinAlgError) as error:
            faults.append(f"{path}:{number}: {tag} line is malformed: {error}")
    known = contents.poses.keys() | {vertex for edge in contents.edge_ids for vertex in edge}
    unknown = [vertex for vertex in contents.fixed if vertex not in known]
    faults += [f"{path}: FIX names vertex {v}, which is not in the file" for v in unknown]
    contents.fixed = [vertex for vertex in contents.fixed if vertex in known]
    if faults:
        _logger.warning("%d lines are skipped, the first: %s", len(faults), faults[0])
    return contents


def _numbers(words: list[str], num_ids: int, num_values: int) -> list[float]:
    if len(words) != num_ids + num_values:
        raise ValueError(f"{len(words)} numbers where {num_ids + num_values} are due")
    numbers: list[float] = [int(word) for word in words[:num_ids]]
    numbers += [float(word) for word in words[num_ids:]]
    if not all(math.isfinite(number) for number in numbers):
        raise ValueError("a number is not finite")
    if max(map(abs, numbers)) > LARGEST_NUMBER:
        raise ValueError("a number is out of all bounds")
    return numbers


def _check_edge(a: int, b: int, values: list[float]) -> None:
    if a == b:
        raise ValueError(f"vertex {a} is joined to itself")
    information = _symmetric(np.array([values]))[0]
    eigenvalues = np.linalg.eigvalsh(information)
    if eigenvalues[0] < -1e-6 * max(eigenvalues[2], 0.0):
        raise ValueError("the information matrix is not positive semidefinite")


def _symmetric(values: FloatArray) -> FloatArray:
    """Return information matrices (n, 3, 3) from the upper halves in columns 3 to 8."""
    matrices: FloatArray = values[:, [3, 4, 5, 4, 6, 7, 5, 7, 8]].reshape(-1, 3, 3)
    return matrices


def _information_in_frame_of_a(values: FloatArray) -> FloatArray:
    rotation = np.zeros((len(values), 3, 3))
    cos, sin = np.cos(values[:, 2]), np.sin(values[:, 2])
    rotation[:, 0, 0] = rotation[:, 1, 1] = cos
    rotation[:, 0, 1], rotation[:, 1, 0] = -sin, sin
    rotation[:, 2, 2] = 1.0
    turned = rotation @ _symmetric(values) @ rotation.transpose(0, 2, 1)
    symmetric: FloatArray = 0.5 * (turned + turned.transpose(0, 2, 1))
    return symmetric


def _place_missing(contents: _Contents) -> None:
    """Place the vertices without a line along the edges, nearest in number of edges first."""
    seen_from: dict[int, list[tuple[int, Pose]]] = {}
    for (a, b), values in zip(contents.edge_ids, contents.edge_values, strict=True):
        tf_a_b = Pose(*values[:3])
        seen_from.setdefault(a, []).append((b, tf_a_b))
        seen_from.setdefault(b, []).append((a, inverse(tf_a_b)))
    missing = sorted(seen_from.keys() - contents.poses.keys())
    if not missing:
        return
    queue = deque(sorted(contents.poses))
    for start in [None, *missing]:
        if start is not None and start not in contents.poses:
            contents.poses[start] = IDENTITY
            queue.append(start)
        while queue:
            a = queue.popleft()
            for b, tf_a_b in seen_from.get(a, ()):
                if b not in contents.poses:
                    contents.poses[b] = compose(contents.poses[a], tf_a_b)
                    queue.append(b)
