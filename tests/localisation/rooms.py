# SPDX-License-Identifier: Apache-2.0
"""Rooms of rectangles: their maps as images, and what a scanner measures in them."""

from __future__ import annotations

import json
import math
from functools import cache

import numpy as np
from PIL import Image

from cartoloop.evaluation.map_image import MapImage
from cartoloop.kernels.wall_ranges import wall_ranges
from cartoloop.localisation.known_map import known_map_of_image
from cartoloop.sensor.events import LaserScan, Odometry, ScanGeometry
from cartoloop.sensor.pose import IDENTITY, Pose, relative, transform_points

GEOMETRY = ScanGeometry(-math.pi, math.radians(2.0), 180, 0.05, 30.0)
SIZE_M = 12.0

ROOM = (
    ((1, 1), (9, 1), (9, 10), (6, 10), (6, 6), (1, 6)),
    ((3, 2.5), (3.6, 2.5), (3.6, 3), (3, 3)),
)
"""An L-shaped room with a pillar: no two places are alike."""

BOX = (((1, 1), (9, 1), (9, 6), (1, 6)),)
"""A rectangle: each place is like the one turned by half a turn."""

START = Pose(4.7, 3.4, 0.3)


def walls(polygons):
    """Return the walls of polygons, shape (n, 4)."""
    parts = [
        (*a, *b)
        for polygon in polygons
        for a, b in zip(polygon, (*polygon[1:], polygon[0]), strict=True)
    ]
    return np.array(parts, dtype=np.float64)


def image(polygons, resolution=0.05, origin=IDENTITY):
    """Return the map of a room, whose pixels lie at a pose: 1 on walls, 0 inside, 0.196 outside."""
    count = round(1.5 * SIZE_M / resolution)
    row, col = np.mgrid[0:count, 0:count]
    centres = np.column_stack((col.ravel() + 0.5, row.ravel() + 0.5)) * resolution
    points = transform_points(origin, centres)
    occupancy = np.where(_inside(polygons, points), 0.0, 1.0 - 205.0 / 255.0)
    for x1, y1, x2, y2 in walls(polygons):
        along = np.array((x2 - x1, y2 - y1))
        length = np.linalg.norm(along)
        at = (points - (x1, y1)) @ along / length**2
        nearest = np.array((x1, y1)) + np.clip(at, 0.0, 1.0)[:, None] * along
        occupancy[np.linalg.norm(points - nearest, axis=1) <= 0.6 * resolution] = 1.0
    shape = (count, count)
    return MapImage(occupancy.reshape(shape).astype(np.float32), resolution, origin, 0.65, 0.25)


_image_of = cache(image)  # drawn once for all maps


def _inside(polygons, points):
    """Return which points are inside of an odd number of polygons."""
    inside = np.zeros(len(points), dtype=bool)
    for x1, y1, x2, y2 in walls(polygons):
        if y1 == y2:
            continue
        crosses = (y1 <= points[:, 1]) != (y2 <= points[:, 1])
        at = x1 + (points[:, 1] - y1) / (y2 - y1) * (x2 - x1)
        inside ^= crosses & (points[:, 0] < at)
    return inside


def known_map(polygons, resolution=0.05, origin=IDENTITY):
    """Return the map of a room for localisation."""
    return known_map_of_image(_image_of(polygons, resolution, origin))


def ranges(polygons, pose, seed=0):
    """Return what a scanner measures at a pose, with noise."""
    out = np.empty((1, GEOMETRY.num_beams))
    wall_ranges(
        walls(polygons), np.array((pose,)), GEOMETRY.angle_min, GEOMETRY.angle_increment, 30.0, out
    )
    return out[0] + np.random.default_rng(seed).normal(0.0, 0.01, GEOMETRY.num_beams)


def points(polygons, pose):
    """Return the returns of a scan, tracking frame."""
    measured = ranges(polygons, pose)
    angles = GEOMETRY.angles
    return measured[:, None] * np.column_stack((np.cos(angles), np.sin(angles)))


def events(polygons, poses, first=0, with_odometry=True):
    """Yield odometry and scans at poses, 0.1 s apart."""
    for k, pose in enumerate(poses, first):
        if with_odometry:
            yield Odometry(0.1 * k, 0.1 * k, relative(poses[0], pose))
        yield LaserScan(0.1 * k, 0.1 * k, ranges(polygons, pose, k), GEOMETRY)


def drive(start, steps, step=0.08, turn=0.0):
    """Return poses of a drive at constant speed."""
    poses = [start]
    for _ in range(steps):
        x, y, theta = poses[-1]
        poses.append(Pose(x + step * math.cos(theta), y + step * math.sin(theta), theta + turn))
    return poses


def apart(pose, other):
    """Return the distance [m] and the angle [deg] between two poses."""
    step = relative(Pose(*pose), Pose(*other))
    return math.hypot(step.x, step.y), abs(math.degrees(step.theta))


def write_image(folder, polygons):
    """Write the map of a room as other programs do; return the path of the YAML file."""
    shown = image(polygons)
    shades = np.rint(255.0 * (1.0 - shown.occupancy[::-1])).astype(np.uint8)
    Image.fromarray(shades).save(folder / "room.pgm")
    (folder / "room.yaml").write_text(
        f"image: room.pgm\nresolution: {shown.resolution}\norigin: [0, 0, 0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.25\n"
    )
    return folder / "room.yaml"


def carmen_text(polygons, poses):
    """Return a drive as a CARMEN log, of the beams ahead."""
    lines = []
    for k, pose in enumerate(poses):
        ahead = " ".join(f"{value:.3f}" for value in ranges(polygons, pose, k)[45:136])
        x, y, theta = relative(poses[0], pose)
        at = f"{x:.4f} {y:.4f} {theta:.4f}"
        lines.append(f"ODOM {at} 0 0 0 {0.1 * k:.2f} host {0.1 * k:.2f}")
        lines.append(f"FLASER 91 {ahead} {at} {at} {0.1 * k:.2f} host {0.1 * k:.2f}")
    return "\n".join(lines) + "\n"


def message_lines(polygons, poses):
    """Return a drive as the messages of a live source, lines of JSON."""
    for event in events(polygons, poses):
        if isinstance(event, LaserScan):
            message = {
                "type": "scan",
                "stamp": event.stamp,
                "angle_min": GEOMETRY.angle_min,
                "angle_increment": GEOMETRY.angle_increment,
                "ranges": event.ranges.round(4).tolist(),
            }
        else:
            x, y, theta = event.tf_odom_tracking
            message = {"type": "odometry", "stamp": event.stamp, "x": x, "y": y, "theta": theta}
        yield json.dumps(message).encode() + b"\n"
