# SPDX-License-Identifier: Apache-2.0
"""A small map made by hand, to be edited: a square of nodes, three submaps, four closures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cartoloop.map_editing.editor import Editor
from cartoloop.report import InputSummary
from cartoloop.session import Session
from tests.evaluation.hand_made_run import closure, hand_made_result

CLOSURES = [closure(0, 5, 0.05), closure(0, 4), closure(1, 5, -0.3), closure(2, 0)]


def finished_map():
    """A map that can be edited; closure 2 disagrees with the others."""
    result = hand_made_result(CLOSURES, rejected=[closure(1, 0, 3.0)])
    rng = np.random.default_rng(5)
    points = [rng.uniform(-1.0, 1.0, (30, 2)) for _ in range(6)]
    report = replace(
        result.report,
        finished=True,
        input=InputSummary("a.log", 6, 5.0, 16.0),
        nodes=6,
        submaps=3,
    )
    return replace(
        result,
        report=report,
        node_points=points,
        sessions=(Session("a.log", "a.log", stamp=100.0),),
    )


def editor():
    """An editor of it that has no folder."""
    return Editor(finished_map())


def poses_of(result):
    """All poses of a map in one array."""
    graph = result.graph
    return np.concatenate((graph.submap_poses, graph.node_poses, result.trajectory))
