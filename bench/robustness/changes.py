# SPDX-License-Identifier: Apache-2.0
"""Changes of a recording that should not matter, as a table.

Run: ``python -m bench.robustness.changes IN OUT CHANGE [SEED]`` writes a changed log.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from bench.robustness.carmen_text import CarmenText, read_carmen, write_carmen
from bench.robustness.log_changes import (
    Apply,
    blocked,
    drifting,
    drop_every,
    end,
    frozen,
    held,
    jittering_odometry,
    longer,
    longer_ranges,
    lost_scans,
    mirror,
    missing,
    multiplied,
    newer_odometry,
    noise,
    noise_share,
    odometry_steps,
    one_scan_in,
    outliers,
    pauses,
    reverse_beams,
    seldom_read,
    short_sighted,
    slanting,
    sparse,
    start,
    thinned,
    twice,
)
from bench.robustness.odometry_changes import (
    coarse_odometry,
    drifting_clock,
    far_origin,
    left_handed,
    no_motion,
    restarted,
    second_half,
    skidding_turns,
    turning_in_bursts,
    turning_more,
)
from bench.robustness.people import people
from bench.robustness.scanner_changes import (
    biased,
    bumps,
    mounted,
    narrow,
    own_parts,
    rounded,
    wider_fan,
    zero_for_none,
)
from bench.robustness.several_changes import (
    both,
    cheap_robot,
    combined,
    depth_camera,
    lossy_robot,
    scaled,
)
from bench.robustness.stamp_changes import (
    NewTimes,
    late_at_random,
    late_in_bursts,
    played_backwards,
    renamed,
    rounded_stamps,
    stretched,
    with_new_times,
)
from bench.robustness.view_faults import (
    blinded,
    companion,
    mixed_pixels,
    warming,
)
from cartoloop.arrays import FloatArray
from cartoloop.errors import CartoloopError, ConfigError, InputError
from cartoloop.evaluation.relations import Relations
from cartoloop.sensor.pose import compose_all, relative_all


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
    new_times : of the readings, in their order or reversed; None leaves them.
    scale : of all lengths.
    """

    name: str
    apply: Apply | None = None
    settings: tuple[str, ...] = ()
    seeds: int = 1
    is_mirrored: bool = False
    new_times: NewTimes | None = None
    scale: float = 1.0


UNCHANGED: Final = "unchanged"

NOISE_SEEDS = 5
"""Seeds of random changes."""

NO_ODOMETRY: Final = ("local_slam.use_odometry=false",)

CHANGES: Final = {
    change.name: change
    for change in (
        Change(UNCHANGED),
        Change("drop50", drop_every(50)),
        Change("noise1cm", noise(0.01), seeds=NOISE_SEEDS),
        Change("start60", start(60.0)),
        Change("end600", end(600.0)),
        Change("mirror", mirror, is_mirrored=True),
        Change("scale103", odometry_steps(longer(0.03))),
        Change("drift05", odometry_steps(drifting(math.radians(0.5)))),
        Change("toff02", newer_odometry(0.2)),
        Change("start30", start(30.0)),
        Change("start90", start(90.0)),
        Change("start150", start(150.0)),
        Change("start200", start(200.0)),
        Change("start300", start(300.0)),
        Change("drop2", drop_every(2)),
        Change("sparse", sparse(1.0, math.radians(30.0))),
        Change("beams2", thinned(2)),
        Change("missing10", missing(0.1), seeds=2),
        Change("noise2cm", noise(0.02), seeds=2),
        Change("range101", longer_ranges(0.01), scale=1.01),
        Change("scale095", odometry_steps(longer(-0.05))),
        Change("toff-02", newer_odometry(-0.2)),
        Change("pixel4cm", settings=("local_slam.submaps.resolution=0.04",)),
        Change("pixel6cm", settings=("local_slam.submaps.resolution=0.06",)),
        Change("voxel5cm", settings=("sensor.voxel_filter_size=0.05",)),
        Change("blocked", blocked(0.2, 0.12)),
        Change("outliers2", outliers(0.02), seeds=2),
        Change("noise-share", noise_share(0.015), seeds=2),
        Change("pauses", pauses(60.0, 3.0)),
        Change("gaps", lost_scans(0.05, 4.0), seeds=3),
        Change("slanting", slanting(0.05)),
        Change("twice", twice),
        Change("backwards", new_times=played_backwards),
        Change("bursts", new_times=late_in_bursts(15.0, 0.5, 2.5), seeds=2),
        Change("people", people(3), seeds=3),
        Change("late", new_times=late_at_random(0.1), seeds=3),
        Change("held", held(0.01, 0.5)),
        Change("upside-down", reverse_beams, settings=("sensor.upside_down=true",)),
        Change("jitter", jittering_odometry(0.1), seeds=2),
        Change("frozen", frozen(0.15, 5.0), seeds=2),
        Change("wheels2", odometry_steps(multiplied(2.0))),
        Change("seldom-read", seldom_read(1.0)),
        Change("range8", short_sighted(8.0)),
        Change("cheap", cheap_robot, seeds=2),
        Change("lossy", lossy_robot, seeds=3),
        Change("combined", combined, seeds=NOISE_SEEDS),
        Change("no-odometry", settings=NO_ODOMETRY),
        Change("view120", narrow(math.radians(120.0))),
        Change("view90", narrow(math.radians(90.0))),
        Change("third", one_scan_in(3)),
        Change("range5", short_sighted(5.0)),
        Change("rounded5cm", rounded(0.05)),
        Change("bias3cm", biased(0.03)),
        Change("own-parts", own_parts(0.06)),
        Change("bumps", bumps(0.05, 1.0, 4.0), seeds=2),
        Change("zeros", zero_for_none),
        Change("rear", mounted(0.0, 0.0, math.pi)),
        Change("ahead30", mounted(0.3, 0.0, 0.0)),
        Change("aside20", mounted(-0.1, 0.2, 0.0)),
        Change("yaw5", mounted(0.1, 0.0, math.radians(5.0))),
        Change("turns110", odometry_steps(turning_more(0.1))),
        Change("turns090", odometry_steps(turning_more(-0.1))),
        Change("skid", skidding_turns(0.4, 5.0), seeds=2),
        Change("coarse", coarse_odometry(0.01, math.radians(1.0), 0.5)),
        Change("yaw-bursts", turning_in_bursts(math.radians(1.0), 0.2, 10.0), seeds=2),
        Change("clock-drift", drifting_clock(1e-4)),
        Change("seconds", new_times=rounded_stamps),
        Change("second-half", second_half),
        Change("restart", restarted(5.0)),
        Change("mirror-backwards", mirror, is_mirrored=True, new_times=played_backwards),
        Change("backwards-clock", newer_odometry(-0.4), new_times=played_backwards),
        Change("start60-no-odometry", start(60.0), settings=NO_ODOMETRY),
        Change("third-no-odometry", one_scan_in(3), settings=NO_ODOMETRY),
        Change("range8-no-odometry", short_sighted(8.0), settings=NO_ODOMETRY),
        Change("noise2cm-third", both(noise(0.02), one_scan_in(3)), seeds=2),
        Change(
            "view120-jitter", both(narrow(math.radians(120.0)), jittering_odometry(0.1)), seeds=2
        ),
        Change("fan101", wider_fan(0.01)),
        Change("zero-odometry", no_motion),
        Change("left-handed", left_handed),
        Change("depth-camera", depth_camera, seeds=2),
        Change("view120-no-odometry", narrow(math.radians(120.0)), settings=NO_ODOMETRY),
        Change("mixed-pixels", mixed_pixels(0.5), seeds=2),
        Change("blinded", blinded(0.2, 20.0, math.radians(60.0)), seeds=2),
        Change("held4", held(0.003, 4.0)),
        Change("companion-ahead", companion(0.0), seeds=2),
        Change("companion-aside", companion(math.radians(60.0)), seeds=2),
        Change("companion-no-odometry", companion(0.0), settings=NO_ODOMETRY, seeds=2),
        Change("warming", warming(0.04)),
        Change("far-origin", far_origin),
        Change("faster", new_times=stretched(0.4)),
        Change("slower", new_times=stretched(3.0)),
        Change("smaller", scaled(0.8), scale=0.8),
        Change("larger", scaled(1.25), scale=1.25),
        Change("range8-turns110", both(short_sighted(8.0), odometry_steps(turning_more(0.1)))),
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
    if change.new_times is not None:
        with_new_times(log, change.new_times, np.random.default_rng(seed))
    if not log.is_scan.any():
        raise NothingLeft(f"{source.name}: {change.name} leaves nothing: the recording is shorter")
    write_carmen(target, log)


def changed_relations(
    relations: Relations, change: Change, log: CarmenText, seed: int = 0
) -> Relations:
    """Return relations as they are in the changed recording; `log` is the unchanged one.

    The beams of a mirrored scan are named in the reverse order. Readers take the first beam of a
    scan to be at -90 degrees, so that scanners whose last beam is not at +90 degrees, as those of
    180 or 360 beams, look aside by one step after it: so does the robot that they find.
    """
    x, y, theta = relations.poses.T
    num_beams, stamps = log.num_beams, relations.stamps
    if change.new_times is not None:
        stamps = renamed(stamps, log, change.new_times, np.random.default_rng(seed))
    if change.is_mirrored:
        step = math.radians(round(180.0 / num_beams * 2.0) / 2.0)
        aside = math.pi - (num_beams - 1) * step
        mirrored = np.column_stack((x, -y, -theta))
        turned = np.column_stack((np.zeros((len(x), 2)), np.full(len(x), aside)))
        x, y, theta = compose_all(relative_all(turned, mirrored), turned).T
    return Relations(stamps, np.column_stack((x * change.scale, y * change.scale, theta)))


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
