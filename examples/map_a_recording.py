# SPDX-License-Identifier: Apache-2.0
"""Map a recording and save everything: ``python examples/map_a_recording.py [LOG [OUT]]``.

Without arguments, a recording of a drive through a ring of corridors is simulated first.
"""

import sys
import tempfile
from pathlib import Path

import cartoloop
from cartoloop.simulation import make_world, simulate


def main(log: str | None = None, out: str = "example-map") -> cartoloop.Result:
    """Map the recording `log` into the folder `out`."""
    with tempfile.TemporaryDirectory() as folder:
        if log is None:
            log = str(Path(folder) / "ring.log.gz")
            simulate(make_world("ring"), seed=1, duration=60.0).write_log(log)
        result = cartoloop.map_recording(log, out=out)
    print(f"{len(result.stamps)} scans mapped in {result.report.wall_s:.1f} s: {out}")  # noqa: T201
    return result


if __name__ == "__main__":
    main(*sys.argv[1:])
