# SPDX-License-Identifier: Apache-2.0
"""The tables of ``map.cartoloop``. Any SQLite reads them; this page says what stands in them.

Poses are x, y [m], theta [rad]. The same map yields the same bytes.
"""

from __future__ import annotations

FILE_NAME = "map.cartoloop"

APPLICATION_ID = 0x6361_7274
"""Stands in the file's header: it is such a map, not any database. ASCII "cart"."""

SCHEMA_VERSION = 2
"""Stands in the file's header as ``user_version``; rises when readers of the old would fail."""

TABLES = """
-- name of the recording; config: JSON; report: JSON, report.json without what differs from run to
-- run (times, memory); program: version that wrote the file
CREATE TABLE about (key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;

-- x, y, theta: tf_map_submap. origin: centre of cell (0, 0) in the submap's frame [m].
-- cells: zlib stream of num_rows * num_cols bytes, row by row, row = y upwards: 0 never observed,
-- otherwise v for the probability 0.1 + (v - 1) * 0.8 / 254 that the cell is obstructed
CREATE TABLE submaps (
  submap INTEGER PRIMARY KEY, x REAL, y REAL, theta REAL,
  num_rows INTEGER, num_cols INTEGER, origin_x REAL, origin_y REAL, resolution REAL, cells BLOB);

-- x, y, theta: tf_map_node. scan: its row in trajectory. points: int16, all x, then
-- all y, in the node's frame in units of point_unit [m]: what loop closure seeks in submaps
CREATE TABLE nodes (
  node INTEGER PRIMARY KEY, scan INTEGER, x REAL, y REAL, theta REAL,
  num_points INTEGER, point_unit REAL, points BLOB);

-- kind 0: submap a to node b, which was inserted into it; 1: submap a to node b, found by search;
-- 2: node a to node b; 3: as 1, but taken out in the end because the rest contradicted it.
-- x, y, theta: tf_a_b as measured; i...: upper triangle of its inverse covariance, axes of a.
-- score, runner_up: of the match, in [0, 1], NULL where nothing was searched
CREATE TABLE constraints (
  constraint_id INTEGER PRIMARY KEY, kind INTEGER, a INTEGER, b INTEGER, x REAL, y REAL, theta REAL,
  ixx REAL, ixy REAL, ixt REAL, iyy REAL, iyt REAL, itt REAL, score REAL, runner_up REAL);

-- one row a scan, in the order of the recording: stamp [s], tf_map_tracking, and before loop
-- closure tf_local_tracking
CREATE TABLE trajectory (
  scan INTEGER PRIMARY KEY, stamp REAL, x REAL, y REAL, theta REAL,
  local_x REAL, local_y REAL, local_theta REAL);
"""

REJECTED = 3
"""Kind of a loop closure that is not in the graph; the others are those of the pose graph."""
