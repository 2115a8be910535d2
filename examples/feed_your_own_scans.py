# SPDX-License-Identifier: Apache-2.0
"""Map scans that come from a program instead of a file: ``python examples/feed_your_own_scans.py``.

A robot drives across a square room of 8 m by 8 m while it turns. Its scanner has a field of view
of 270 degrees; there is no odometry. The mapped poses are compared with the true ones.
"""

import math

import numpy as np

import cartoloop

HALF_ROOM_M = 4.0

GEOMETRY = cartoloop.ScanGeometry(
    angle_min=math.radians(-135.0),
    angle_increment=math.radians(0.5),
    num_beams=541,
    range_min=0.1,
    range_max=30.0,
)


def measure(x: float, y: float, theta: float) -> np.ndarray:
    """Return the ranges [m] to the walls of the room and to a pillar from a pose."""
    dx, dy = np.cos(theta + GEOMETRY.angles), np.sin(theta + GEOMETRY.angles)
    with np.errstate(divide="ignore"):
        to_walls = np.minimum(
            (np.copysign(HALF_ROOM_M, dx) - x) / dx,
            (np.copysign(HALF_ROOM_M, dy) - y) / dy,
        )
    # A pillar of 0.3 m radius at (2, 1): the near intersection of each beam with the circle.
    along = (2.0 - x) * dx + (1.0 - y) * dy
    aside = np.hypot(2.0 - x, 1.0 - y) ** 2 - along**2
    cut = (aside < 0.3**2) & (along > 0.0)
    to_pillar = along - np.sqrt(np.where(cut, 0.3**2 - aside, 0.0))
    return np.where(cut, to_pillar, to_walls)


def main() -> float:
    """Map the room; return the largest position error [m]."""
    mapper = cartoloop.Mapper()
    truth = [(-2.0 + 0.02 * k, -1.0 + 0.005 * k, 0.01 * k) for k in range(200)]
    for k, pose in enumerate(truth):
        seconds = 0.1 * k
        mapper.add(cartoloop.LaserScan(seconds, seconds, measure(*pose), GEOMETRY))
    result = mapper.finish()

    # The first scan is the origin of the map: transform the true positions to its frame.
    offset = np.array(truth)[:, :2] - truth[0][:2]
    error = float(np.hypot(*(result.trajectory[:, :2] - offset).T).max())
    print(f"{len(result.stamps)} scans mapped, {error:.3f} m position error at most")  # noqa: T201
    return error


if __name__ == "__main__":
    main()
