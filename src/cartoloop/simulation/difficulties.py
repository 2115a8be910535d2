# SPDX-License-Identifier: Apache-2.0
"""What makes a simulated recording difficult, whatever the world: sparse scans, people, faults."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from cartoloop.errors import ConfigError
from cartoloop.simulation.odometry_faults import OdometryFault


class Stream(IntEnum):
    """Streams of random numbers of a recording, so that no difficulty changes another."""

    GLASS = 101
    GLASS_BEAMS = 102
    PEOPLE = 103
    ODOMETRY_FAULTS = 104
    PAUSE = 105


@dataclass(frozen=True, slots=True)
class Difficulties:
    """What makes a recording difficult; by default nothing does.

    Attributes
    ----------
    scan_spacing : path length from one scan to the next [m]; 0: all scans of the scanner. Scans
        are also kept where the robot has turned.
    pause : time during which nothing is recorded, while the robot turns [s].
    missing_returns : share of the beams, drawn at random, without a return.
    glass : share of the walls that are glass.
    people : who walk near the robot.
    odometry_faults : of the odometry, in addition to its noise.
    odometry_delay : the odometry pose with a stamp is of so much earlier [s].
    """

    scan_spacing: float = 0.0
    pause: float = 0.0
    missing_returns: float = 0.0
    glass: float = 0.0
    people: int = 0
    odometry_faults: tuple[OdometryFault, ...] = ()
    odometry_delay: float = 0.0

    def __post_init__(self) -> None:
        for name, share in (("missing returns", self.missing_returns), ("glass", self.glass)):
            if not 0.0 <= share <= 1.0:
                raise ConfigError(f"simulated {name}: a share of {share:g}; give 0 to 1")
        for name, value in (("scan spacing", self.scan_spacing), ("pause", self.pause)):
            if not 0.0 <= value < np.inf:
                raise ConfigError(
                    f"simulated {name} of {value:g}: it must be finite and not negative"
                )
        if not np.isfinite(self.odometry_delay):
            raise ConfigError("simulated odometry delay: give a finite number of seconds")
        if self.people < 0:
            raise ConfigError(f"simulated people: {self.people}; give 0 or more")

    @property
    def change_what_is_seen(self) -> bool:
        """Whether beams meet more than solid walls."""
        return self.glass > 0.0 or self.people > 0


NO_DIFFICULTIES = Difficulties()


def random_stream(seed: int, stream: Stream, number: int = 0) -> np.random.Generator:
    """Return the source of random numbers of one difficulty of a recording."""
    return np.random.default_rng((seed, stream, number))
