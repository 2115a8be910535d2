# SPDX-License-Identifier: Apache-2.0
"""Localise a robot where furniture was moved: what differs is listed, and taken over into the map.

``python examples/report_changes.py [OUT]``: 40 s of a drive through an office are mapped, with a
crate in the corridor. On the next drive the crate stands elsewhere.
"""

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

import cartoloop
from cartoloop.localisation.changes.output import save_changes, table
from cartoloop.simulation import Recording, make_world, simulate

BEFORE, AFTER = (30.0, 6.58), (24.0, 6.58)
"""Lower left corner of the crate on both days [m, frame of the simulated building]."""

WIDTH_M, DEPTH_M = 0.8, 0.4


def drive(corner: tuple[float, float], seed: int) -> Recording:
    """Return a drive with the crate at a corner."""
    x, y = corner
    across, up = x + WIDTH_M, y + DEPTH_M
    corners = [(x, y), (across, y), (across, up), (x, up)]
    crate = np.array([(*a, *b) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)])
    world = make_world("office")
    walls = np.vstack((world.walls, crate))
    return simulate(replace(world, walls=walls), seed=seed, duration=40.0)


def main(out: str = "example-changes") -> list[str]:
    """Map one drive, localise the next in the map, update it; return the kinds of the changes."""
    folder = Path(out)
    mapper = cartoloop.Mapper()
    for event in drive(BEFORE, seed=1).events():
        mapper.add(event)
    mapper.finish().save(folder / "map")

    later = drive(AFTER, seed=2)
    localizer = cartoloop.Localizer(folder / "map", watch_changes=True)
    for event in later.events():
        localizer.add(event)
    changes = localizer.changes()
    print(table(changes))  # noqa: T201
    save_changes(changes, folder)

    recording = folder / "later.log"
    later.write_log(recording)
    cartoloop.update_map(folder / "map", recording)
    print(f"updated: {folder / 'map'}")  # noqa: T201
    return [area.kind.value for area in changes.areas]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Report what differs from a map.")
    parser.add_argument("out", nargs="?", default="example-changes", help="folder for all files")
    try:
        main(**vars(parser.parse_args()))
    except cartoloop.CartoloopError as error:  # a line for the user: what is wrong, and where
        sys.exit(str(error))
