# SPDX-License-Identifier: Apache-2.0
"""Several changes at once."""

from __future__ import annotations

import math
from collections.abc import Callable

from bench.robustness.carmen_text import CarmenText
from bench.robustness.log_changes import (
    Apply,
    Rng,
    blocked,
    drifting,
    drop_every,
    longer,
    longer_ranges,
    lost_scans,
    missing,
    newer_odometry,
    noise,
    noise_share,
    noisy_odometry,
    odometry_steps,
    outliers,
    short_sighted,
    start,
)
from bench.robustness.scanner_changes import narrow


def both(*changes: Apply) -> Apply:
    """Return the change that makes changes one after the other."""

    def apply(log: CarmenText, rng: Rng) -> None:
        for change in changes:
            change(log, rng)

    return apply


def scaled(factor: float) -> Apply:
    """Return the change of all lengths by a factor: a building of the same plan."""
    return both(longer_ranges(factor - 1.0), odometry_steps(longer(factor - 1.0)))


def cheap_robot(log: CarmenText, rng: Rng) -> None:
    """Make the recording one of a robot with noisy wheels and a scanner that reaches 8 m."""
    noisy_odometry(0.1, math.radians(3.0))(log, rng)
    short_sighted(8.0)(log, rng)


def lossy_robot(log: CarmenText, rng: Rng) -> None:
    """Make the recording one of a robot with noisy wheels, from which scans were lost."""
    noisy_odometry(0.1, math.radians(3.0))(log, rng)
    lost_scans(0.05, 4.0)(log, rng)


def depth_camera(log: CarmenText, rng: Rng) -> None:
    """Make the recording one of a depth camera: a narrow view, 8 m, noise that grows."""
    short_sighted(8.0)(log, rng)
    noise_share(0.005)(log, rng)
    narrow(math.radians(60.0))(log, rng)


def combined(log: CarmenText, rng: Rng) -> None:
    """Make two to four changes at once, each by as much as a random number says."""
    draw = rng.uniform
    makers: list[Callable[[], Apply]] = [
        lambda: start(draw(0.0, 0.15) * float(log.times[-1] - log.times[0])),
        lambda: noise(draw(0.005, 0.02)),
        lambda: odometry_steps(longer(draw(-0.06, 0.06))),
        lambda: odometry_steps(drifting(math.radians(draw(-0.7, 0.7)))),
        lambda: newer_odometry(draw(-0.3, 0.3)),
        lambda: drop_every(int(rng.integers(2, 5))),
        lambda: missing(draw(0.02, 0.15)),
        lambda: blocked(draw(0.0, 0.85), 0.12),
        lambda: outliers(draw(0.005, 0.03)),
    ]
    count = int(rng.integers(2, 5))
    for index in sorted(rng.choice(len(makers), count, replace=False).tolist()):
        makers[index]()(log, rng)
