# SPDX-License-Identifier: Apache-2.0
"""Drive through a place again: its map is renewed and does not grow.

``python examples/refresh_a_map.py [OUT]``: a drive twice round a ring of corridors is simulated;
the second round is added to the map of the first.
"""

import argparse
import sys

import cartoloop
from cartoloop.config import Config, LifelongConfig
from cartoloop.simulation import make_world, simulate

LIFELONG = Config(lifelong=LifelongConfig(enabled=True))


def main(out: str = "example-refreshed") -> cartoloop.Result:
    """Map the first round, add the second, and save the map in the folder `out`."""
    drive = simulate(make_world("ring"), seed=1)
    middle = float(drive.stamps[len(drive.stamps) // 2])
    first, second = cartoloop.Mapper(), None
    for event in drive.events():
        if event.stamp <= middle:
            first.add(event)
            continue
        second = second or cartoloop.Mapper(LIFELONG, onto=first.finish())
        second.add(event)
    assert second is not None
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
