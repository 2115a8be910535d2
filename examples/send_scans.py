# SPDX-License-Identifier: Apache-2.0
"""A robot that sends scans: ``python examples/send_scans.py 7000``.

Start ``cartoloop live tcp://127.0.0.1:7000 -o room`` before. The robot drives through a square room
of 8 m by 8 m, faster than real robots do, and says when it is done.
"""

import json
import math
import socket
import sys
import time

ROOM = 4.0  # half its edge [m]
NUM_BEAMS = 271
STEP = math.radians(1.0)


def measure(x: float, y: float, theta: float) -> list[float]:
    """Return the distances to the walls of the room, as seen from a pose [m]."""
    ranges = []
    for beam in range(NUM_BEAMS):
        angle = theta - math.radians(135.0) + STEP * beam
        dx, dy = math.cos(angle), math.sin(angle)
        to_x = (math.copysign(ROOM, dx) - x) / dx if dx else math.inf
        to_y = (math.copysign(ROOM, dy) - y) / dy if dy else math.inf
        ranges.append(round(min(to_x, to_y), 3))
    return ranges


def main(port: int, num_scans: int = 100, pause: float = 0.01) -> None:
    """Send a drive to the program that listens at a port of this machine."""
    with socket.create_connection(("127.0.0.1", port)) as connection:
        for k in range(num_scans):
            x, y, theta = -2.0 + 0.03 * k, -1.0 + 0.01 * k, 0.01 * k
            stamp = 0.1 * k
            messages = (
                {"type": "odometry", "stamp": stamp, "x": x, "y": y, "theta": theta},
                {
                    "type": "scan",
                    "stamp": stamp,
                    "angle_min": math.radians(-135.0),
                    "angle_increment": STEP,
                    "ranges": measure(x, y, theta),
                },
            )
            for message in messages:
                connection.sendall(json.dumps(message).encode() + b"\n")
            time.sleep(pause)
        connection.sendall(b'{"type": "end"}\n')


if __name__ == "__main__":
    main(int(sys.argv[1]))
