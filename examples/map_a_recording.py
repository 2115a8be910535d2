# SPDX-License-Identifier: Apache-2.0
"""Map a recording and save everything: ``python examples/map_a_recording.py [LOG [OUT]]``.

Without arguments, a recording of a drive through a ring of corridors is simulated first.
"""

import argparse
import sys
import tempfile
from pathlib import Path

import cartoloop
from cartoloop.simulation import make_world, simulate


def main(log: str | None = None, out: str = "example-ring") -> cartoloop.Result:
    """Map the recording `log` into the folder `out`."""
    with tempfile.TemporaryDirectory() as folder:
        if log is None:
            log = str(Path(folder) / "ring.log.gz")
            simulate(make_world("ring"), seed=1, duration=60.0).write_log(log)
        result = cartoloop.map_recording(log, out=out)
    print(f"{len(result.stamps)} scans mapped in {result.report.wall_s:.1f} s: {out}")  # noqa: T201
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Map a recording.")
    parser.add_argument("log", nargs="?", help="recording; by default one is simulated")
    parser.add_argument("out", nargs="?", default="example-ring", help="folder for the map")
    try:
        main(**vars(parser.parse_args()))
    except cartoloop.CartoloopError as error:  # a line for the user: what is wrong, and where
        sys.exit(str(error))
