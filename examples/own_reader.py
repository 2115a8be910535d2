# SPDX-License-Identifier: Apache-2.0
"""Read a format of your own: three functions, and the map is drawn.

The format here has a line a scan: milliseconds, the pose by the wheels in millimetres and degrees,
and 120 ranges in centimetres, 3 degrees apart all around, 0 where there is no echo::

    SCAN 1500 | 120 35 90.0 | 231 230 0 402 ...

python examples/own_reader.py RECORDING OUT
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence

import numpy as np

import cartoloop
from cartoloop.readers import LineError, LineFormat, LineLog, Reading
from cartoloop.sensor.events import ScanGeometry
from cartoloop.sensor.pose import Pose


def recognise(head: Sequence[bytes]) -> bool:
    """Tell whether a file is of this format, by its first lines."""
    return bool(head) and head[0].startswith(b"SCAN ")


def geometry(head: Sequence[bytes]) -> ScanGeometry:
    """Return where the beams look (from straight ahead, counter-clockwise) and how far."""
    return ScanGeometry(
        angle_min=0.0,
        angle_increment=math.radians(3.0),
        num_beams=120,
        range_min=0.05,
        range_max=20.0,
        tf_tracking_sensor=Pose(0.1, 0.0, 0.0),  # 10 cm in front of the wheels' axle
    )


def parser(head: Sequence[bytes]) -> Callable[[bytes], Reading | None]:
    """Return the function that reads a line."""

    def parse(line: bytes) -> Reading | None:
        if not line.startswith(b"SCAN "):
            return None  # nothing to map with
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


def main(recording: str, out: str) -> None:
    """Map the recording into the folder `out`."""
    log = LineLog(recording, MY_FORMAT)
    mapper = cartoloop.Mapper()
    for event in log:
        mapper.add(event)
    mapper.finish().save(out)
    print(f"{mapper.num_scans} scans mapped, skipped: {log.skipped or 'nothing'}")  # noqa: T201


if __name__ == "__main__":
    main(*sys.argv[1:])
