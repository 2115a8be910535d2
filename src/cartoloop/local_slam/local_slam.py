# SPDX-License-Identifier: Apache-2.0
"""Local SLAM (section IV): each scan is matched to the older active submap and inserted into both."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cartoloop.config import Config
from cartoloop.local_slam.motion_filter import MotionFilter
from cartoloop.local_slam.pose_extrapolator import PoseExtrapolator, Prediction
from cartoloop.scan_matching import correlative, least_squares
from cartoloop.sensor.events import LaserScan
from cartoloop.sensor.pose import FloatArray, Pose, compose, relative, transform_points
from cartoloop.sensor.range_filter import RangeData, RangeFilter, thin
from cartoloop.submaps.node import Node
from cartoloop.submaps.submap import ActiveSubmaps, Submap

import os
GATE=float(os.environ.get('GATE','1.05')); PW=float(os.environ.get('PW','0.1'));FT=float(os.environ.get('FT','5'));FR=float(os.environ.get('FR','5'));GX=float(os.environ.get('GX','1')); GT=float(os.environ.get('GT','1'))
@dataclass(frozen=True, slots=True)
class LocalSlamResult:
    tf_local_tracking: Pose
    node: Node | None


class LocalSlam:
    def __init__(self, config: Config, profiler=None) -> None:
        self._config = config.local_slam
        self._loop_filter = config.global_slam.constraint_search.adaptive_voxel_filter
        self._range_filter = RangeFilter(config.sensor)
        self._motion_filter = MotionFilter(self._config.motion_filter)
        self.extrapolator = PoseExtrapolator(use_odometry=self._config.use_odometry)
        self._active = ActiveSubmaps(self._config.submaps)
        self._num_nodes = 0
        self.debug = []
        self.typical = 0.5

    def add_scan(self, scan: LaserScan) -> LocalSlamResult:
        data = self._range_filter.apply(scan)
        prediction = self.extrapolator.predict(scan.time)
        points = thin(data.returns, self._config.adaptive_voxel_filter)
        tf_local_tracking, info = self._match(points, prediction, scan)
        self.extrapolator.add_pose(scan.time, tf_local_tracking)
        node = None
        if self._motion_filter.is_new(scan.time, tf_local_tracking):
            node = self._insert(scan.time, data, tf_local_tracking, info)
        return LocalSlamResult(tf_local_tracking, node)

    def _match(self, points, prediction: Prediction, scan):
        submap = self._active.matching
        if submap is None or len(points) == 0:
            return prediction.tf_local_tracking, np.eye(3)
        prior = relative(submap.tf_local_submap, prediction.tf_local_tracking)
        g = submap.grid
        c = self._config
        sm = least_squares.SmoothMap(g.cells, g.origin_x, g.origin_y, g.resolution)
        how = 0
        m = None
        if GATE:
            m = self._lsq(sm, points, prior, prior, prediction)
            moved = relative(prior, m.tf_grid_scan)
            if m.residual > self.typical * GATE or math.hypot(moved.x, moved.y) > GX or abs(moved.theta) > GT: how = 1
        else:
            how = 1
        if how:
            cm = correlative.match(g, points, prior, c.correlative_matcher)
            m2 = self._lsq(sm, points, cm.tf_grid_scan, prior, prediction)
            if m is None or m2.residual < m.residual:
                m = m2
        if m.residual > self.typical * 1.2:
            how = 2
            wide = c.correlative_matcher.model_copy(update=dict(linear_search_window=0.3, angular_search_window_deg=60.0))
            for guess in (self.extrapolator.at_rest(), self.extrapolator.at_constant_velocity(scan.time)):
                p2 = relative(submap.tf_local_submap, guess)
                cm = correlative.match(g, points, p2, wide)
                m2 = self._lsq(sm, points, cm.tf_grid_scan, cm.tf_grid_scan, None)
                if m2.residual < m.residual:
                    m = m2
        self.typical += 0.02 * (m.residual - self.typical)
        self.debug.append((scan.time, *relative(prior, m.tf_grid_scan), how, m.residual, m.iterations, len(points)))
        return compose(submap.tf_local_submap, m.tf_grid_scan), m.information

    def _lsq(self, sm, points, start, prior, prediction):
        ls = self._config.least_squares_matcher
        model = self.extrapolator.odometry_model
        if prediction is not None and prediction.by_odometry:
            st = max(FT * model.translation_error, 0.01); sr = max(FR * model.rotation_error, 0.005)
            if not model.is_known: st, sr = 0.05, 0.05
        else:
            st, sr = 0.2, 0.2
        wt, wr = st**-2, sr**-2
        return least_squares.match(sm, points, start, prior, np.array([wt, 0, 0, wt, 0, wr]),
            PW / self.typical**2, ls.max_num_iterations)

    def _insert(self, time, data: RangeData, tf_local_tracking, info):
        ins = self._active.insert(
            compose(tf_local_tracking, data.tf_tracking_sensor),
            transform_points(tf_local_tracking, data.returns),
            transform_points(tf_local_tracking, data.misses))
        node = Node(self._num_nodes, time, tf_local_tracking, thin(data.returns, self._loop_filter), ins.submaps, info, ins.finished)
        self._num_nodes += 1
        return node
