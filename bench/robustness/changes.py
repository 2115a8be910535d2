# SPDX-License-Identifier: Apache-2.0
"""Changes of a recording that should not matter, as a table.

Run: ``python -m bench.robustness.changes IN OUT CHANGE [SEED]`` writes a changed log.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from bench.robustness.carmen_text import CarmenText, read_carmen, write_carmen
from cartoloop.arrays import BoolArray, FloatArray
from cartoloop.errors import CartoloopError, ConfigError, InputError
from cartoloop.evaluation.relations import Relations
from cartoloop.sensor.pose import compose_all, relative_all

Rng = np.random.Generator
Apply = Callable[[CarmenText, Rng], None]

NEAREST, FARTHEST = 0.05, 40.0
"""Ranges between these are returns [m], to which noise is added."""


class NothingLeft(InputError):  # noqa: N818 - named for what happened
    """A change leaves no scan of a recording, or none that a relation names."""


@dataclass(frozen=True, slots=True)
class Change:
    """A change of a recording, or of how it is mapped.

    Attributes
    ----------
    name : of the row.
    apply : changes the log in place; None leaves it as it is.
    settings : parameters that are not the defaults, as ``key=value``.
    seeds : how many seeds are tried; more than one only where something is random.
    is_mirrored : whether left and right are exchanged.
    scale : of all lengths.
    """

    name: str
    apply: Apply | None = None
    settings: tuple[str, ...] = ()
    seeds: int = 1
    is_mirrored: bool = False
    scale: float = 1.0


def _drop_every(count: int) -> Apply:
    def apply(log: CarmenText, _: Rng) -> None:
        is_scan = log.is_scan
        log.keep(~is_scan | (np.cumsum(is_scan) % count != 0))

    return apply


def _sparse(spacing: float, turn: float) -> Apply:
    """Return the change that leaves a scan after each length [m] or turn [rad] of the odometry."""

    def apply(log: CarmenText, _: Rng) -> None:
        last = None
        for row in np.flatnonzero(log.is_scan).tolist():
            pose = log.poses[row]
            if last is not None:
                x, y, theta = (pose - last).tolist()
                if math.hypot(x, y) < spacing and abs(math.remainder(theta, math.tau)) < turn:
                    log.ranges[row] = None
                    log.tails[row] = ["0", "0", "0", *log.tails[row]]  # speeds, as ODOM has them
                    continue
            last = pose

    return apply


def _noise(sigma: float) -> Apply:
    def apply(log: CarmenText, rng: Rng) -> None:
        for ranges in log.ranges:
            if ranges is not None:
                seen = (ranges > NEAREST) & (ranges < FARTHEST)
                ranges[seen] += rng.normal(0, sigma, int(seen.sum()))

    return apply


def _start(seconds: float) -> Apply:
    def apply(log: CarmenText, _: Rng) -> None:
        log.keep(log.times >= log.times[0] + seconds)

    return apply


def _end(seconds: float) -> Apply:
    def apply(log: CarmenText, _: Rng) -> None:
        log.keep(log.times <= log.times[-1] - seconds)

    return apply


def _mirror(log: CarmenText, _: Rng) -> None:
    log.poses = log.poses * (1.0, -1.0, -1.0)
    log.ranges = [None if ranges is None else ranges[::-1] for ranges in log.ranges]


def _odometry_steps(change: Callable[[FloatArray], FloatArray]) -> Apply:
    """Return the change that changes the steps of the odometry, shape (n, 3)."""

    def apply(log: CarmenText, _: Rng) -> None:
        steps = change(relative_all(log.poses[:-1], log.poses[1:]))
        headings = log.poses[0, 2] + np.concatenate(([0.0], np.cumsum(steps[:, 2])))
        turned = np.column_stack((np.zeros((len(steps), 2)), headings[:-1]))
        moved = np.cumsum(compose_all(turned, steps)[:, :2], axis=0)
        places = log.poses[0, :2] + np.vstack((np.zeros((1, 2)), moved))
        log.poses = np.column_stack((places, headings))

    return apply


def _longer(share: float) -> Callable[[FloatArray], FloatArray]:
    return lambda steps: steps * (1.0 + share, 1.0 + share, 1.0)


def _drifting(radians_a_metre: float) -> Callable[[FloatArray], FloatArray]:
    def change(steps: FloatArray) -> FloatArray:
        turns = radians_a_metre * np.hypot(steps[:, 0], steps[:, 1])
        return np.column_stack((steps[:, :2], steps[:, 2] + turns))

    return change


def _newer_odometry(seconds: float) -> Apply:
    def apply(log: CarmenText, _: Rng) -> None:
        times = log.times
        known = times + np.arange(len(times)) * 1e-7  # so that all differ
        columns = (log.poses[:, 0], log.poses[:, 1], np.unwrap(log.poses[:, 2]))
        log.poses = np.column_stack(
            [np.interp(times + seconds, known, column) for column in columns]
        )

    return apply


def _thinned(every: int) -> Apply:
    def apply(log: CarmenText, _: Rng) -> None:
        step = math.radians(round(180.0 / log.num_beams * 2.0) / 2.0)
        log.angles = (-math.pi / 2, every * step)
        log.ranges = [None if ranges is None else ranges[::every] for ranges in log.ranges]

    return apply


def _missing(share: float) -> Apply:
    def apply(log: CarmenText, rng: Rng) -> None:
        no_return = log.no_return
        for ranges in log.ranges:
            if ranges is not None:
                ranges[rng.random(len(ranges)) < share] = no_return

    return apply


def _longer_ranges(share: float) -> Apply:
    def apply(log: CarmenText, _: Rng) -> None:
        for ranges in log.ranges:
            if ranges is not None:
                seen: BoolArray = (ranges > NEAREST) & (ranges < FARTHEST)
                ranges[seen] *= 1.0 + share

    return apply


UNCHANGED: Final = "unchanged"

NOISE_SEEDS = 5
"""Seeds of random changes."""

CHANGES: Final = {
    change.name: change
    for change in (
        Change(UNCHANGED),
        Change("drop50", _drop_every(50)),
        Change("noise1cm", _noise(0.01), seeds=NOISE_SEEDS),
        Change("start60", _start(60.0)),
        Change("end600", _end(600.0)),
        Change("mirror", _mirror, is_mirrored=True),
        Change("scale103", _odometry_steps(_longer(0.03))),
        Change("drift05", _odometry_steps(_drifting(math.radians(0.5)))),
        Change("toff02", _newer_odometry(0.2)),
        Change("start30", _start(30.0)),
        Change("start90", _start(90.0)),
        Change("start150", _start(150.0)),
        Change("start200", _start(200.0)),
        Change("start300", _start(300.0)),
        Change("drop2", _drop_every(2)),
        Change("sparse", _sparse(1.0, math.radians(30.0))),
        Change("beams2", _thinned(2)),
        Change("missing10", _missing(0.1), seeds=2),
        Change("noise2cm", _noise(0.02), seeds=2),
        Change("range101", _longer_ranges(0.01), scale=1.01),
        Change("scale095", _odometry_steps(_longer(-0.05))),
        Change("toff-02", _newer_odometry(-0.2)),
        Change("pixel4cm", settings=("local_slam.submaps.resolution=0.04",)),
        Change("pixel6cm", settings=("local_slam.submaps.resolution=0.06",)),
        Change("voxel5cm", settings=("sensor.voxel_filter_size=0.05",)),
        Change("no-odometry", settings=("local_slam.use_odometry=false",)),
    )
}
"""All changes by name: first those of the issue that this benchmark comes from, then others."""


def change_of(name: str) -> Change:
    """Return a change by its name.

    Raises
    ------
    ConfigError
        There is none.
    """
    if name not in CHANGES:
        raise ConfigError(f"no change {name!r} of recordings; choose from {', '.join(CHANGES)}")
    return CHANGES[name]


def changed_log(source: Path, target: Path, change: Change, seed: int) -> None:
    """Write a changed copy of a CARMEN log.

    Raises
    ------
    InputError
        The log cannot be read.
    NothingLeft
        The change leaves no scan of it.
    """
    log = read_carmen(source)
    if change.apply is not None:
        change.apply(log, np.random.default_rng(seed))
    if not log.is_scan.any():
        raise NothingLeft(f"{source.name}: {change.name} leaves nothing: the recording is shorter")
    write_carmen(target, log)


def changed_relations(relations: Relations, change: Change, num_beams: int) -> Relations:
    """Return relations as they are in the changed recording.

    The beams of a mirrored scan are named in the reverse order. Readers take the first beam of a
    scan to be at -90 degrees, so that scanners whose last beam is not at +90 degrees, as those of
    180 or 360 beams, look aside by one step after it: so does the robot that they find.
    """
    x, y, theta = relations.poses.T
    if change.is_mirrored:
        step = math.radians(round(180.0 / num_beams * 2.0) / 2.0)
        aside = math.pi - (num_beams - 1) * step
        mirrored = np.column_stack((x, -y, -theta))
        turned = np.column_stack((np.zeros((len(x), 2)), np.full(len(x), aside)))
        x, y, theta = compose_all(relative_all(turned, mirrored), turned).T
    return Relations(relations.stamps, np.column_stack((x * change.scale, y * change.scale, theta)))


def check_relations_left(relations: Relations, stamps: FloatArray, what: str) -> None:
    """Raise an error where all relations name scans outside a map.

    Parameters
    ----------
    stamps : of the scans of the map [s].
    what : the recording and its change, for the message.

    Raises
    ------
    NothingLeft
        No relation is between two scans of that time.
    """
    is_within = (relations.stamps >= stamps.min()) & (relations.stamps <= stamps.max())
    if not is_within.all(axis=1).any():
        raise NothingLeft(f"{what}: no verified relation is between scans that are left")


def main() -> None:
    """Write the changed log that the arguments name."""
    if len(sys.argv) not in (4, 5):
        sys.exit("usage: python -m bench.robustness.changes IN OUT CHANGE [SEED]")
    source, target, name = sys.argv[1:4]
    try:
        seed = int(sys.argv[4]) if len(sys.argv) > 4 else 0
        changed_log(Path(source), Path(target), change_of(name), seed)
    except (CartoloopError, ValueError) as error:
        sys.exit(f"error: {error}")


if __name__ == "__main__":
    main()
