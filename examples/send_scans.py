# SPDX-License-Identifier: Apache-2.0
"""A robot that sends scans while it drives: ``python examples/send_scans.py [PORT]``.

With a port, it sends to ``cartoloop live tcp://127.0.0.1:PORT -o room``, which must be running;
without one, it starts that program itself. The robot drives through a square room of 8 m by 8 m,
faster than real robots do, and sends a last message at the end.
"""

import argparse
import json
import math
import re
import socket
import subprocess
import sys
import time

HALF_ROOM_M = 4.0
NUM_BEAMS = 271
ANGLE_MIN, STEP = math.radians(-135.0), math.radians(1.0)


def measure(x: float, y: float, theta: float) -> list[float]:
    """Return the ranges [m] to the walls of the room from a pose."""
    ranges = []
    for beam in range(NUM_BEAMS):
        angle = theta + ANGLE_MIN + STEP * beam
        dx, dy = math.cos(angle), math.sin(angle)
        to_x = (math.copysign(HALF_ROOM_M, dx) - x) / dx if dx else math.inf
        to_y = (math.copysign(HALF_ROOM_M, dy) - y) / dy if dy else math.inf
        ranges.append(round(min(to_x, to_y), 3))
    return ranges


def send(port: int, num_scans: int = 100, pause: float = 0.01) -> None:
    """Send a drive to a program that listens on a port of this machine."""
    with socket.create_connection(("127.0.0.1", port)) as connection:
        for k in range(num_scans):
            x, y, theta = -2.0 + 0.03 * k, -1.0 + 0.01 * k, 0.01 * k
            stamp = 0.1 * k
            messages = (
                {"type": "odometry", "stamp": stamp, "x": x, "y": y, "theta": theta},
                {
                    "type": "scan",
                    "stamp": stamp,
                    "angle_min": ANGLE_MIN,
                    "angle_increment": STEP,
                    "ranges": measure(x, y, theta),
                },
            )
            for message in messages:
                connection.sendall(json.dumps(message).encode() + b"\n")
            time.sleep(pause)
        connection.sendall(b'{"type": "end"}\n')


def main(port: int | None = None, out: str = "example-room") -> None:
    """Send a drive to `port`, or to a mapper that is started here and maps into `out`."""
    if port is not None:
        send(port)
        return
    command = ["live", "tcp://127.0.0.1:0", "--no-drop", "--overwrite", "-o", out]
    with subprocess.Popen(
        [sys.executable, "-m", "cartoloop", *command], stderr=subprocess.PIPE, text=True
    ) as mapper:
        assert mapper.stderr is not None
        line = ""
        for line in mapper.stderr:
            if match := re.search(r"listening on tcp://127\.0\.0\.1:(\d+)", line):
                send(int(match[1]))
    if mapper.returncode:
        sys.exit(line.strip())  # what it said last


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Send scans to a mapper while driving.")
    parser.add_argument("port", nargs="?", type=int, help="by default a mapper is started here")
    parser.add_argument("out", nargs="?", default="example-room", help="folder of that mapper")
    given = parser.parse_args()
    try:
        main(given.port, given.out)
    except (OSError, OverflowError) as error:
        sys.exit(
            f"port {given.port}: {error}; first start "
            f"`cartoloop live tcp://127.0.0.1:{given.port or 7000} -o room`"
        )
