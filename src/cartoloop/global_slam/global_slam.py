# SPDX-License-Identifier: Apache-2.0
"""Global SLAM (section V): nodes and submaps into the pose graph, loop closures, adjustment."""

from __future__ import annotations

import math

import numpy as np

from cartoloop.config import GlobalSlamConfig
from cartoloop.global_slam.constraint_search import ConstraintSearch, FinishedSubmap
from cartoloop.global_slam.loop_closure import SearchRequest
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.sensor.pose import IDENTITY, Pose, compose, inverse, relative, relative_all
from cartoloop.submaps.node import Node
from cartoloop.global_slam import pose_adjustment
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import shortest_path


class GlobalSlam:
    def __init__(self, config: GlobalSlamConfig) -> None:
        self.config = config
        self.graph = PoseGraph()
        self.search = ConstraintSearch(config.constraint_search, config.num_threads)
        self.finished: dict[int, FinishedSubmap] = {}
        self.points = []
        self.node_submaps = []
        self.submap_pose_local: list[Pose] = []
        self.tf_map_local = IDENTITY
        self.travelled = [0.0]
        self.submap_travelled = []
        self.last_local = None
        self.closures = []
        self.tie = None
        self.num_adjust = 0
        self.info_log = []

    def add_node(self, node: Node) -> None:
        g = self.graph
        if self.last_local is not None:
            self.travelled.append(self.travelled[-1] + math.hypot(node.tf_local_tracking.x - self.last_local.x, node.tf_local_tracking.y - self.last_local.y))
        self.last_local = node.tf_local_tracking
        for s in node.submaps:
            if s.index == g.num_submaps:
                g.add_submap(compose(self.tf_map_local, s.tf_local_submap))
                if s.index == 0: g.fix_submap(0)
                self.submap_pose_local.append(s.tf_local_submap)
                self.submap_travelled.append(self.travelled[-1])
        g.add_node(compose(self.tf_map_local, node.tf_local_tracking))
        self.points.append(node.points)
        self.node_submaps.append(tuple(s.index for s in node.submaps))
        for s in node.submaps:
            g.add_constraint(ConstraintKind.INTRA_SUBMAP, s.index, node.index, relative(s.tf_local_submap, node.tf_local_tracking), node.information)
        if self.config.optimize_every_n_nodes == 0: return
        self.search_node(node)
        if node.finished is not None:
            self.finish_submap(node.finished.index, node.finished.grid.finish())
        if g.num_nodes % self.config.optimize_every_n_nodes == 0:
            self.adjust()

    def finish_submap(self, index, grid):
        f = FinishedSubmap(index, grid)
        self.finished[index] = f
        c = self.config.constraint_search
        nodes = self.graph.node_poses
        sp = self.graph.submap_poses[index]
        d = np.hypot(nodes[:, 0] - sp[0], nodes[:, 1] - sp[1])
        reqs = []
        for n in np.flatnonzero(d < c.max_constraint_distance):
            n = int(n)
            if index in self.node_submaps[n]: continue
            r = self.request(index, n)
            if r: reqs.append(r)
        for k in range(0, len(reqs), 50):
            self.search.submit(f, reqs[k:k + 50])

    def search_node(self, node):
        c = self.config.constraint_search
        p = self.graph.node_poses[node.index]
        for index, f in self.finished.items():
            if index in self.node_submaps[node.index]: continue
            sp = self.graph.submap_poses[index]
            if math.hypot(p[0] - sp[0], p[1] - sp[1]) > c.max_constraint_distance: continue
            r = self.request(index, node.index)
            if r: self.search.submit(f, [r])

    def uncertain_length(self, submap, node):
        own = self.node_submaps[node][0]
        L = abs(self.travelled[node] - self.submap_travelled[submap])
        if self.tie is not None and submap < len(self.tie):
            k = min(own, len(self.tie) - 1)
            L = min(L, self.tie[submap, k] + abs(self.travelled[node] - self.submap_travelled[k]))
        return L

    def request(self, submap, node):
        c = self.config.constraint_search
        L = self.uncertain_length(submap, node)
        every = 10 if L < 10 else 3
        if (node + submap) % every: return None
        if len(self.points[node]) < 20: return None
        w = min(c.linear_search_window, 0.5 + 0.05 * L)
        a = min(math.radians(c.angular_search_window_deg), math.radians(5 + 0.5 * L))
        est = relative(Pose(*self.graph.submap_poses[submap].tolist()), Pose(*self.graph.node_poses[node].tolist()))
        return SearchRequest(submap, node, self.points[node], est, w, a)

    def adjust(self, final=False):
        for c in self.search.collect():
            self.graph.add_constraint(ConstraintKind.LOOP_CLOSURE, c.submap, c.node, c.tf_submap_node, c.information, score=c.score, runner_up=c.runner_up)
        res = pose_adjustment.adjust(self.graph, self.options(final))
        self.num_adjust += 1
        self.update_frames()

    def options(self, final):
        p = self.config.pose_adjustment
        return pose_adjustment.AdjustmentOptions(loss=pose_adjustment.Loss(p.loss), loss_scale=p.loss_scale, max_iterations=p.max_num_final_iterations if final else p.max_num_iterations)

    def update_frames(self):
        g = self.graph
        last = g.num_submaps - 1
        self.tf_map_local = compose(Pose(*g.submap_poses[last].tolist()), inverse(self.submap_pose_local[last]))
        # uncertain lengths between submaps
        m = g.num_submaps
        t = np.array(self.submap_travelled)
        i = np.arange(m - 1)
        k = g.kinds == ConstraintKind.LOOP_CLOSURE
        b = np.array([s[0] for s in self.node_submaps])[g.index_b[k]]
        a = g.index_a[k]
        e = relative_all(g.submap_poses[g.index_a[k]], g.node_poses[g.index_b[k]]) - g.relative_poses[k]
        ok = (np.hypot(e[:, 0], e[:, 1]) < 0.2)
        a, b = a[ok], b[ok]
        wt = np.concatenate((np.maximum(np.diff(t), 1e-3), np.full(len(a), 0.5)))
        r = np.concatenate((i, a)); c = np.concatenate((i + 1, b))
        keep = r != c
        o = np.lexsort((wt[keep], c[keep], r[keep]))
        r, c, wt = r[keep][o], c[keep][o], wt[keep][o]
        first = np.r_[True, (np.diff(r) != 0) | (np.diff(c) != 0)]
        G = coo_matrix((wt[first], (r[first], c[first])), shape=(m, m)).tocsr()
        self.tie = shortest_path(G, directed=False)
