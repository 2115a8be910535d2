# SPDX-License-Identifier: Apache-2.0
"""Map a recording in a format of your own: ``python examples/own_reader.py [RECORDING [OUT]]``.

The format has one line per scan: milliseconds, the odometry pose in millimetres and degrees, and
120 ranges in centimetres, 3 degrees apart all around, 0 for no return::

    SCAN 1500 | 120 35 90.0 | 231 230 0 402 ...

Without arguments, a recording in this format is simulated first.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

import cartoloop
from cartoloop.readers import LineError, LineFormat, LineLog, Reading
from cartoloop.sensor.events import ScanGeometry
from cartoloop.sensor.pose import Pose
from cartoloop.simulation import Lidar, make_world, simulate


def recognise(head: Sequence[bytes]) -> bool:
    """Return whether a file has this format, from its first lines."""
    return bool(head) and head[0].startswith(b"SCAN ")


def geometry(head: Sequence[bytes]) -> ScanGeometry:
    """Return angles (from straight ahead, counter-clockwise) and range limits of the beams."""
    return ScanGeometry(
        angle_min=0.0,
        angle_increment=math.radians(3.0),
        num_beams=120,
        range_min=0.05,
        range_max=20.0,
        tf_tracking_sensor=Pose(0.1, 0.0, 0.0),  # 10 cm in front of the axle
    )


def parser(head: Sequence[bytes]) -> Callable[[bytes], Reading | None]:
    """Return the function that reads a line."""

    def parse(line: bytes) -> Reading | None:
        if not line.startswith(b"SCAN "):
            return None  # another kind of line
        try:
            time, pose, ranges = (part.split() for part in line[5:].split(b"|"))
            x, y, degrees = map(float, pose)
            return Reading(
                stamp=float(time[0]) / 1000.0,
                tf_odom_tracking=Pose(x / 1000.0, y / 1000.0, math.radians(degrees)),
                ranges=np.array(ranges, dtype=np.float64) / 100.0,
            )
        except (ValueError, IndexError):
            raise LineError("damaged line", "not 'SCAN ms | x y deg | ranges'") from None

    return parse


MY_FORMAT = LineFormat("my format", recognise, geometry, parser)


def write_simulated(path: Path) -> None:
    """Write a simulated recording in this format, with a damaged line at its end."""
    lidar = Lidar(
        num_beams=120,
        angle_min=0.0,
        angle_increment=math.radians(3.0),
        range_max=20.0,
        no_return=20.0,
        tf_tracking_sensor=Pose(0.1, 0.0, 0.0),
    )
    recording = simulate(make_world("corridor"), lidar, seed=1, duration=10.0)
    with path.open("w") as file:
        for stamp, pose, ranges in zip(
            recording.stamps, recording.odometry_poses, recording.ranges, strict=True
        ):
            x, y, theta = pose
            centimetres = (f"{100.0 * r:.0f}" if r < lidar.range_max else "0" for r in ranges)
            odometry = f"{1e3 * x:.0f} {1e3 * y:.0f} {math.degrees(theta):.1f}"
            print(f"SCAN {1e3 * stamp:.0f} | {odometry} | {' '.join(centimetres)}", file=file)
        print("SCAN 99999 | here", file=file)


def main(recording: str | None = None, out: str = "example-corridor") -> None:
    """Map the recording into the folder `out`."""
    with tempfile.TemporaryDirectory() as folder:
        if recording is None:
            recording = str(Path(folder) / "my.log")
            write_simulated(Path(recording))
        result = cartoloop.map_recording(LineLog(recording, MY_FORMAT), out=out)
    skipped = result.report.skipped or "nothing"
    print(f"{len(result.stamps)} scans mapped, skipped: {skipped}")  # noqa: T201


if __name__ == "__main__":
    arguments = argparse.ArgumentParser(description="Map a recording in a format of your own.")
    arguments.add_argument("recording", nargs="?", help="by default one is simulated")
    arguments.add_argument("out", nargs="?", default="example-corridor", help="folder for the map")
    try:
        main(**vars(arguments.parse_args()))
    except cartoloop.CartoloopError as error:  # a line for the user: what is wrong, and where
        sys.exit(str(error))
