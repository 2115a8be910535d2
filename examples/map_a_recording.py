# SPDX-License-Identifier: Apache-2.0
"""Map a recording and save everything: ``python examples/map_a_recording.py LOG OUT``."""

import sys

import cartoloop


def main(log: str, out: str) -> None:
    """Map the recording `log` into the folder `out`."""
    mapper = cartoloop.Mapper()
    for event in cartoloop.read(log):  # scans, odometry, IMU in order of time
        mapper.add(event)
    result = mapper.finish()  # poses, submaps, constraints
    result.save(out)


if __name__ == "__main__":
    main(*sys.argv[1:])
