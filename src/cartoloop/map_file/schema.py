# SPDX-License-Identifier: Apache-2.0
"""The tables of ``map.cartoloop``. Any SQLite can read them; their columns are described here.

Poses are x, y [m], theta [rad]. The same map yields the same bytes.
"""

from __future__ import annotations

FILE_NAME = "map.cartoloop"

APPLICATION_ID = 0x6361_7274
"""In the header of the file: marks the database as a map. ASCII "cart"."""

SCHEMA_VERSION = 5
"""``user_version`` in the header of the file; increased when older readers would fail.

Version 2 had no tables of closures: all constraints stood in one table, with their score. Version 3
had fewer statuses and reasons. Version 4 had no sessions: it is one; and no edits.
"""

READABLE_VERSIONS = (2, 3, 4, SCHEMA_VERSION)

SESSIONS_VERSION = 5
"""The first version with a table of sessions."""

TABLES = """
-- name of the recording; config: JSON; report: JSON, report.json without what differs from run to
-- run (times, memory); program: version that wrote the file; edited_quality: JSON, the verdict on
-- the map with its edits. Everything else describes the map as mapped
CREATE TABLE about (key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;

-- x, y, theta: tf_map_submap. origin: centre of cell (0, 0) in the submap's frame [m].
-- cells: zlib stream of num_rows * num_cols bytes, row by row, row = y upwards: 0 never observed,
-- otherwise v for the probability 0.1 + (v - 1) * 0.8 / 254 that the cell is obstructed
CREATE TABLE submaps (
  submap INTEGER PRIMARY KEY, x REAL, y REAL, theta REAL,
  num_rows INTEGER, num_cols INTEGER, origin_x REAL, origin_y REAL, resolution REAL, cells BLOB);

-- x, y, theta: tf_map_node. scan: its row in trajectory. points: int16, all x, then
-- all y, in the node's frame in units of point_unit [m]: what searches match in submaps
CREATE TABLE nodes (
  node INTEGER PRIMARY KEY, scan INTEGER, x REAL, y REAL, theta REAL,
  num_points INTEGER, point_unit REAL, points BLOB);

-- The constraints of the graph but for the loop closures. kind 0: submap a to node b, which was
-- inserted into it; 2: node a to node b. x, y, theta: tf_a_b as measured; i...: upper triangle of
-- its inverse covariance, axes of a. constraint_id: place in the graph, in one sequence with
-- those of the closures
CREATE TABLE constraints (
  constraint_id INTEGER PRIMARY KEY, kind INTEGER, a INTEGER, b INTEGER, x REAL, y REAL, theta REAL,
  ixx REAL, ixy REAL, ixt REAL, iyy REAL, iyt REAL, itt REAL);

-- One row for each pair of submap and node that was requested or matched; first the requests.
-- status, reason, search_status (status after the search while mapping): codes, see the tables
-- statuses and reasons. constraint_id: place in the graph, NULL if not in it. x, y, theta:
-- predicted tf_submap_node, centre of the search window; linear_window [m], angular_window [rad]:
-- its radii; min_score: threshold applied; requested_at: number of nodes then. NULL: not requested
-- or not searched
CREATE TABLE closures (
  closure INTEGER PRIMARY KEY, submap INTEGER, node INTEGER, status INTEGER, reason INTEGER,
  search_status INTEGER, constraint_id INTEGER, node_submap INTEGER, x REAL, y REAL, theta REAL,
  linear_window REAL, angular_window REAL, min_score REAL, requested_at INTEGER);

-- What searches found, in the order in which it joined the graph, then the matches of the last
-- pass, which supersede them. x, y, theta: tf_submap_node as measured; i...: as of constraints;
-- residual: root mean square of 1 - M at the returns; moved_m, moved_rad: by the refinement. Of
-- searches only: score, runner_up: in [0, 1]; joined_at: number of nodes then
CREATE TABLE matches (
  match INTEGER PRIMARY KEY, closure INTEGER, x REAL, y REAL, theta REAL,
  ixx REAL, ixy REAL, ixt REAL, iyy REAL, iyt REAL, itt REAL, residual REAL, moved_m REAL,
  moved_rad REAL, score REAL, runner_up REAL, joined_at INTEGER);

-- Closures in the graph that no robust loss weakens, as those that join two parts
CREATE TABLE trusted (closure INTEGER PRIMARY KEY);

-- What adjustment does not move: a submap or a node, the other is NULL. No row: the first submap
CREATE TABLE held (number INTEGER PRIMARY KEY, submap INTEGER, node INTEGER);

CREATE TABLE statuses (status INTEGER PRIMARY KEY, name TEXT);

CREATE TABLE reasons (reason INTEGER PRIMARY KEY, name TEXT);

-- one row per scan, in the order of the recording: stamp [s], tf_map_tracking, and before loop
-- closure tf_local_tracking
CREATE TABLE trajectory (
  scan INTEGER PRIMARY KEY, stamp REAL, x REAL, y REAL, theta REAL,
  local_x REAL, local_y REAL, local_theta REAL);

-- What was edited, in order; the map is what the edits that are not undone make of the map as
-- mapped, which is in the other tables. kind, arguments (JSON): see docs/editing.md. Submaps, nodes
-- and poses in them are those of the map as mapped
CREATE TABLE edits (
  edit INTEGER PRIMARY KEY, kind TEXT NOT NULL, arguments TEXT NOT NULL,
  is_undone INTEGER NOT NULL);

-- The drives that the map is made of, in order: contiguous ranges of scans, nodes and submaps, each
-- with a local frame of its own. part: connected part; poses of different parts are in different
-- frames, those of part 0 in the map frame. stamp: of the first scan [s]; calibration: JSON, what
-- was learnt about the sensors
CREATE TABLE sessions (
  session INTEGER PRIMARY KEY, name TEXT, recording TEXT, fingerprint TEXT, first_scan INTEGER,
  first_node INTEGER, first_submap INTEGER, part INTEGER, stamp REAL, calibration TEXT);
"""
