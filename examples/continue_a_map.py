# SPDX-License-Identifier: Apache-2.0
"""Add a recording to a map: ``python examples/continue_a_map.py [MAP LOG [OUT]]``.

Without them, two parts of a drive around a ring of corridors are simulated; the first is mapped.
"""

import argparse
import sys
from collections.abc import Iterable

import cartoloop
from cartoloop.sensor.events import SensorEvent
from cartoloop.simulation import make_world, simulate


def simulated() -> tuple[cartoloop.Result, list[SensorEvent]]:
    """Return the map of the beginning of a drive, and the events of its end, which overlap."""
    drive = simulate(make_world("ring"), seed=1, duration=120.0)
    start, mapper = float(drive.stamps[0]), cartoloop.Mapper()
    for event in drive.events():
        if event.stamp <= start + 90.0:
            mapper.add(event)
    return mapper.finish(), [event for event in drive.events() if event.stamp > start + 40.0]


def main(
    onto: str | None = None, log: str | None = None, out: str = "example-continued"
) -> cartoloop.Result:
    """Add the recording `log` to the map `onto`, and save both in the folder `out`."""
    base: str | cartoloop.Result
    events: Iterable[SensorEvent]
    if onto is None or log is None:
        base, events = simulated()
    else:
        base, events = onto, cartoloop.read(log)
    mapper = cartoloop.Mapper(onto=base)
    for event in events:
        mapper.add(event)
    result = mapper.finish()
    result.save(out)
    where = "found its place" if result.sessions[-1].part == 0 else "is apart"
    print(f"session {len(result.sessions)} {where}: {out}")  # noqa: T201
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Add a recording to a map.")
    parser.add_argument("onto", nargs="?", help="folder of the map; by default one is simulated")
    parser.add_argument("log", nargs="?", help="recording")
    parser.add_argument("out", nargs="?", default="example-continued", help="folder for the map")
    try:
        main(**vars(parser.parse_args()))
    except cartoloop.CartoloopError as error:  # a line for the user: what is wrong, and where
        sys.exit(str(error))
