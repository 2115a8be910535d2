# SPDX-License-Identifier: Apache-2.0
"""Drive through a place again: its map is renewed and does not grow.

``python examples/refresh_a_map.py [OUT]``: 90 s of a drive around a ring of corridors are mapped;
the drive from 40 s on is added as another session.
"""

import argparse
import sys

import cartoloop
from cartoloop.config import Config, LifelongConfig
from cartoloop.simulation import make_world, simulate

LIFELONG = Config(lifelong=LifelongConfig(enabled=True))


def main(out: str = "example-refreshed") -> cartoloop.Result:
    """Map the drive, add the way driven again, and save the map in the folder `out`."""
    drive = simulate(make_world("ring"), seed=1, duration=120.0)
    start = float(drive.stamps[0])
    first = cartoloop.Mapper()
    for event in drive.events():
        if event.stamp <= start + 90.0:
            first.add(event)
    second = cartoloop.Mapper(LIFELONG, onto=first.finish())
    for event in drive.events():
        if event.stamp > start + 40.0:
            second.add(event)
    result = second.finish()
    result.save(out)
    removed = result.report.extra["lifelong"]
    print(  # noqa: T201
        f"{removed['removed_submaps']} submaps gave way, {result.graph.num_submaps} are left: {out}"
    )
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Drive through a place again.")
    parser.add_argument("out", nargs="?", default="example-refreshed", help="folder for the map")
    try:
        main(**vars(parser.parse_args()))
    except cartoloop.CartoloopError as error:  # a line for the user: what is wrong, and where
        sys.exit(str(error))
