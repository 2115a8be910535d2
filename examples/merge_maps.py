# SPDX-License-Identifier: Apache-2.0
"""Two drives, mapped each by itself, in one map: ``python examples/merge_maps.py [OUT [MAP...]]``.

Without maps, two parts of a drive around a ring of corridors are simulated and mapped first.
"""

import argparse
import sys

import cartoloop
from cartoloop.simulation import make_world, simulate


def simulated_maps() -> list[cartoloop.Result]:
    """Return the maps of the beginning and of the end of a drive, which overlap."""
    drive = simulate(make_world("ring"), seed=1, duration=120.0)
    start = float(drive.stamps[0])
    maps = []
    for first, last in ((start, start + 90.0), (start + 40.0, start + 120.0)):
        mapper = cartoloop.Mapper()
        for event in drive.events():
            if first <= event.stamp <= last:
                mapper.add(event)
        maps.append(mapper.finish())
    return maps


def main(out: str = "example-merged", maps: list[str] | None = None) -> cartoloop.Result:
    """Merge `maps` and save the result in the folder `out`."""
    merged = cartoloop.merge(maps or simulated_maps())
    merged.save(out)
    joined = sum(session.part == 0 for session in merged.sessions)
    print(f"{joined} of {len(merged.sessions)} sessions in one map: {out}")  # noqa: T201
    return merged


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Merge maps.")
    parser.add_argument("out", nargs="?", default="example-merged", help="folder for the map")
    parser.add_argument("maps", nargs="*", help="maps; by default two are simulated")
    try:
        main(**vars(parser.parse_args()))
    except cartoloop.CartoloopError as error:  # a line for the user: what is wrong, and where
        sys.exit(str(error))
