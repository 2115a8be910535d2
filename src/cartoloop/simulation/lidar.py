# SPDX-License-Identifier: Apache-2.0
"""A simulated laser scanner: exact ranges to the walls, then the errors of a real scanner."""

from __future__ import annotations

import math
from copy import deepcopy
from dataclasses import dataclass
from difflib import get_close_matches

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.errors import ConfigError
from cartoloop.sensor.events import ScanGeometry
from cartoloop.sensor.pose import IDENTITY, Pose, compose_all


@dataclass(frozen=True, slots=True)
class Lidar:
    """A planar scanner; all beams of a scan are measured at once, at its stamp.

    Attributes
    ----------
    num_beams : ranges in a scan, counter-clockwise.
    angle_min : angle of beam 0 [rad], sensor frame.
    angle_increment : angle from one beam to the next [rad].
    rate : scans a second [Hz].
    range_min : nearer walls are reported as 0 [m].
    range_max : walls from here on are not seen [m].
    range_noise : standard deviation of a range, as far as it is the same at all ranges [m].
    range_noise_share : further standard deviation as a share of the range: 0.01 adds 1%.
    range_noise_growth : further share for each metre of range [1/m], as scanners have that
        triangulate: their error grows with the square of the range.
    dropout : probability that a beam does not come back.
    range_quantum : ranges are multiples of this [m]; 0 for any range.
    no_return : the range reported when nothing comes back [m], at least the maximum or 0.
    tf_tracking_sensor : pose of the scanner on the robot.
    """

    num_beams: int = 361
    angle_min: float = math.radians(-90.0)
    angle_increment: float = math.radians(0.5)
    rate: float = 5.0
    range_min: float = 0.1
    range_max: float = 30.0
    range_noise: float = 0.01
    range_noise_share: float = 0.0
    range_noise_growth: float = 0.0
    dropout: float = 0.002
    range_quantum: float = 0.001
    no_return: float = 81.91
    tf_tracking_sensor: Pose = IDENTITY

    def __post_init__(self) -> None:
        if self.num_beams < 1 or not 0.0 < self.angle_increment * self.num_beams < math.tau + 1e-9:
            raise ConfigError(
                f"simulated scanner of {self.num_beams} beams every {self.angle_increment:g} rad: "
                "give at least one beam, counter-clockwise, all within one turn"
            )
        if not (self.rate > 0.0 and 0.0 <= self.range_min < self.range_max) or (
            0.0 != self.no_return < self.range_max
        ):
            raise ConfigError(
                "simulated scanner: rate must be positive and range_min < range_max <= no_return, "
                "or no_return 0"
            )
        noise = (self.range_noise, self.range_noise_share, self.range_noise_growth)
        are_valid = all(0.0 <= value < math.inf for value in (*noise, self.range_quantum))
        if not are_valid or not 0.0 <= self.dropout <= 1.0:
            raise ConfigError(
                "simulated scanner: noise and quantum must be 0 or more, dropout within [0, 1]"
            )

    @property
    def field_of_view(self) -> float:
        """The angle from the first beam to the last [rad]."""
        return self.angle_increment * (self.num_beams - 1)

    @property
    def geometry(self) -> ScanGeometry:
        """The geometry that a reader reports of this scanner's scans."""
        return ScanGeometry(
            angle_min=self.angle_min,
            angle_increment=self.angle_increment,
            num_beams=self.num_beams,
            range_min=self.range_min,
            range_max=self.range_max,
            no_return_is_free=True,
            tf_tracking_sensor=self.tf_tracking_sensor,
        )


# The classes of scanner of the recordings that people map: name -> scanner.
LIDARS: dict[str, Lidar] = {
    "sick": Lidar(),
    "sick-180": Lidar(num_beams=180, angle_increment=math.radians(1.0)),
    "wide": Lidar(
        num_beams=1081,
        angle_min=math.radians(-135.0),
        angle_increment=math.radians(0.25),
        rate=10.0,
        range_min=0.06,
        range_noise=0.015,
        no_return=60.0,
    ),
    "backpack": Lidar(
        num_beams=1079,
        angle_min=math.radians(-134.75),
        angle_increment=math.radians(0.25),
        rate=10.0,
        range_min=0.06,
        range_noise=0.015,
        no_return=60.0,
    ),
    # The class of the paper's section VI-B, a vacuum cleaner's: noise of 1% near and 3% at 6 m.
    "lds": Lidar(
        num_beams=360,
        angle_min=math.radians(-180.0),
        angle_increment=math.radians(1.0),
        rate=2.0,
        range_min=0.15,
        range_max=6.0,
        range_noise=0.0,
        range_noise_share=0.01,
        range_noise_growth=0.02 / 6.0,
        dropout=0.01,
        no_return=0.0,
    ),
}


def make_lidar(name: str) -> Lidar:
    """Return the scanner of a name.

    Raises
    ------
    ConfigError
        When there is no scanner of that name.
    """
    if name not in LIDARS:
        nearest = get_close_matches(name, LIDARS, n=1, cutoff=0.0)[0]
        raise ConfigError(
            f"no simulated scanner {name!r}: choose from {', '.join(LIDARS)} (nearest: {nearest})"
        )
    return LIDARS[name]


def true_ranges(walls: FloatArray, robot_poses: FloatArray, lidar: Lidar) -> FloatArray:
    """Return the exact distance to the nearest wall along each beam.

    Parameters
    ----------
    walls : float64, shape (num_walls, 4), segments x1, y1, x2, y2 [m], map frame.
    robot_poses : float64, shape (n, 3), the robot's x [m], y [m], theta [rad], map frame.
    lidar : the scanner.

    Returns
    -------
    float64, shape (n, num_beams) [m]; inf where nothing is nearer than the maximum range.
    """
    from cartoloop.kernels.wall_ranges import wall_ranges

    sensor_poses = compose_all(robot_poses, np.array(lidar.tf_tracking_sensor))
    ranges = np.empty((len(robot_poses), lidar.num_beams))
    wall_ranges(
        np.ascontiguousarray(walls, dtype=np.float64),
        np.ascontiguousarray(sensor_poses),
        lidar.angle_min,
        lidar.angle_increment,
        lidar.range_max,
        ranges,
    )
    return ranges


def walls_within(walls: FloatArray, places: FloatArray, reach: float) -> FloatArray:
    """Return the walls that may be nearer than `reach` [m] to any of the given places.

    Parameters
    ----------
    walls : float64, shape (num_walls, 4), segments x1, y1, x2, y2 [m].
    places : float64, shape (n, 2 or more), their first columns x, y [m].
    """
    (x_min, y_min), (x_max, y_max) = places[:, :2].min(axis=0), places[:, :2].max(axis=0)
    near = (
        (np.maximum(walls[:, 0], walls[:, 2]) >= x_min - reach)
        & (np.minimum(walls[:, 0], walls[:, 2]) <= x_max + reach)
        & (np.maximum(walls[:, 1], walls[:, 3]) >= y_min - reach)
        & (np.minimum(walls[:, 1], walls[:, 3]) <= y_max + reach)
    )
    found: FloatArray = walls[near]
    return found


class RangeNoise:
    """Turns exact ranges into measured ones: noise, dropouts, limits, quantization.

    A recording's noise does not depend on how many scans are taken at a time: all deviations are
    drawn from one source before all dropouts, so the source of dropouts is a copy that skips the
    deviations.

    Parameters
    ----------
    lidar : the scanner.
    rng : the source of noise.
    num_ranges : total number of ranges of the recording.
    """

    def __init__(self, lidar: Lidar, rng: np.random.Generator, num_ranges: int) -> None:
        self._lidar = lidar
        self._deviations = rng
        self._dropouts = deepcopy(rng)
        skipped = np.empty(1 << 16)
        for left in range(num_ranges, 0, -len(skipped)):
            self._dropouts.standard_normal(out=skipped[:left])

    def apply(self, ranges: FloatArray) -> FloatArray:
        """Return the next ranges as measured.

        Parameters
        ----------
        ranges : float64, shape (n, num_beams) [m], exact, inf where no wall is in range.
        """
        lidar = self._lidar
        deviation: float | FloatArray = lidar.range_noise
        if lidar.range_noise_share or lidar.range_noise_growth:
            seen = np.where(np.isfinite(ranges), ranges, 0.0)
            share = lidar.range_noise_share + lidar.range_noise_growth * seen
            deviation = lidar.range_noise + share * seen
        measured = ranges + deviation * self._deviations.standard_normal(ranges.shape)
        lost = self._dropouts.random(ranges.shape) < lidar.dropout
        if lidar.range_quantum > 0.0:
            # Divided by whole steps a metre, a range is the same number that is read from text.
            steps = 1.0 / lidar.range_quantum
            measured = np.rint(measured * steps) / steps
        measured[measured < lidar.range_min] = 0.0
        measured[lost | (measured >= lidar.range_max)] = lidar.no_return
        return measured
