# SPDX-License-Identifier: Apache-2.0
"""A run with a node for each scan, for what is found by times and poses alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cartoloop.global_slam.pose_graph import PoseGraph


@dataclass
class Run:
    stamps: np.ndarray
    trajectory: np.ndarray

    @property
    def node_scan_index(self):
        return np.arange(len(self.stamps))

    @property
    def graph(self):
        graph = PoseGraph()
        graph.add_nodes(self.trajectory)
        return graph


def drive(gap, moved, steps=0.2, half=50):
    """Return a run at 1 m/s without some seconds and metres in the middle."""
    stamps, poses = 100.0 + 0.2 * np.arange(2 * half), np.zeros((2 * half, 3))
    poses[:, 0] = steps * np.arange(2 * half)
    stamps[half:] += gap
    poses[half:, 0] += moved
    return Run(stamps, poses)
