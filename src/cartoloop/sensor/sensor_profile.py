# SPDX-License-Identifier: Apache-2.0
"""The profile of a scanner: beams, range limits, no-return value, rate and noise."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.sensor.events import LaserScan, ScanGeometry
from cartoloop.sensor.no_return import find_no_return, median

RANGE_MIN_LIMITS = (0.05, 0.3)
"""Limits of the smallest range [m]: below the first, scanners send error codes."""

ABSURD_RANGE = 1e6
"""Longer ranges mean infinity [m]."""

_QUANTA = (0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001)
"""Usual steps of ranges [m]."""

_QUANTUM_TOLERANCE, _QUANTUM_SHARE = 1e-3, 0.95
"""Deviation from a multiple of the step [steps], and share of the ranges within it."""

_MIN_STILL_TRIPLES, _MAX_STILL_CHANGE = 5, 0.005
"""Least number of triples of scans at rest for a measurement of the noise, and median change of a
range at rest [m]."""

_SIGMA_PER_MAD, _OUTLIER_SIGMAS = 1.4826, 3.0
"""Standard deviation of a normal distribution over the median of absolute values; and from how many
of them on a value is an outlier."""


@dataclass(frozen=True, slots=True)
class SensorProfile:
    """Properties of a scanner that are estimated from a recording.

    Attributes
    ----------
    num_beams : beams of a scan (the most frequent count).
    field_of_view : from the first beam to the last [rad].
    angular_resolution : from one beam to the next [rad].
    range_min : shorter ranges are no measurements [m].
    range_max : ranges from here on are no measurements [m]; inf if not found.
    no_return : the value sent for a beam without a return [m] (inf and 0 occur), or None if none
        was found.
    share_no_return : share of the beams without a return.
    range_quantum : step of the ranges [m], 0 if they are continuous.
    range_noise : standard deviation of a range [m]; see `estimate_range_noise`.
    rate : scans a second, from the median time between scans [Hz]; 0 if not known.
    num_scans : number of scans used.
    has_odometry, has_imu : whether the recording holds such events.
    """

    num_beams: int
    field_of_view: float
    angular_resolution: float
    range_min: float
    range_max: float
    no_return: float | None
    share_no_return: float
    range_quantum: float
    range_noise: float
    rate: float
    num_scans: int
    has_odometry: bool = False
    has_imu: bool = False

    def apply(self, geometry: ScanGeometry) -> ScanGeometry:
        """Return the geometry with this profile's range limits, unless its own are tighter."""
        return replace(
            geometry,
            range_min=max(self.range_min, geometry.range_min),
            range_max=min(self.range_max, geometry.range_max),
            no_return_is_free=True,
        )

    def describe(self) -> str:
        """Return a few lines for the user."""
        fov, step = math.degrees(self.field_of_view), math.degrees(self.angular_resolution)
        end = f"{self.range_max:.2f} m" if math.isfinite(self.range_max) else "no end seen"
        if self.no_return is None:
            missing = "none seen"
        else:
            unit = " m" if math.isfinite(self.no_return) else ""
            share = float(f"{100.0 * self.share_no_return:.2g}")
            missing = f"{self.no_return:.6g}{unit} ({share:g}% of beams)"
        quantum = f"{self.range_quantum:g} m" if self.range_quantum else "continuous"
        also = [n for n, has in (("odometry", self.has_odometry), ("IMU", self.has_imu)) if has]
        return "\n".join(
            (
                f"beams      {self.num_beams} over {fov:.4g} deg, one each {step:.3g} deg",
                f"ranges     {self.range_min:.2f} m to {end}, no return: {missing}",
                f"precision  step {quantum}, noise {1000.0 * self.range_noise:.2g} mm",
                f"rate       {self.rate:.3g} Hz",
                f"also has   {' and '.join(also) or 'neither odometry nor IMU'}",
            )
        )


def profile_sensor(
    scans: Iterable[LaserScan], *, has_odometry: bool = False, has_imu: bool = False
) -> SensorProfile:
    """Return the profile of the scanner of some scans.

    Parameters
    ----------
    scans : some scans of one scanner in the order of time, best a few hundred in groups of three
        successive ones, spread over the recording; one is enough. Scans with other beam counts
        than the most frequent are ignored.
    has_odometry, has_imu : copied into the profile.

    Raises
    ------
    ValueError
        If there are no scans.
    """
    chosen = _most_frequent_geometry(list(scans))
    geometry = chosen[0].geometry
    ranges = np.array([scan.ranges for scan in chosen])
    ranges = np.where(np.abs(ranges) > ABSURD_RANGE, np.copysign(np.inf, ranges), ranges)
    no_return = find_no_return(ranges, geometry.angle_increment)
    range_max = min(no_return.range_max, geometry.range_max)
    measured = ranges[np.isfinite(ranges) & (ranges >= RANGE_MIN_LIMITS[0]) & (ranges < range_max)]
    nearest = float(measured.min()) if len(measured) else RANGE_MIN_LIMITS[1]
    quantum = find_range_quantum(measured)
    times = np.array([scan.time for scan in chosen])
    period = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    return SensorProfile(
        num_beams=geometry.num_beams,
        field_of_view=abs(geometry.angle_increment) * (geometry.num_beams - 1),
        angular_resolution=abs(geometry.angle_increment),
        # A sample does not contain the shortest range of the recording.
        range_min=float(np.clip(0.5 * nearest, *RANGE_MIN_LIMITS)),
        range_max=range_max,
        no_return=no_return.value,
        share_no_return=no_return.share,
        range_quantum=quantum,
        range_noise=estimate_range_noise(ranges, range_max, quantum),
        rate=1.0 / period if period > 0.0 else 0.0,
        num_scans=len(chosen),
        has_odometry=has_odometry,
        has_imu=has_imu,
    )


def _most_frequent_geometry(scans: Sequence[LaserScan]) -> list[LaserScan]:
    if not scans:
        raise ValueError("a sensor profile needs at least one scan")
    counts: dict[int, int] = {}
    for scan in scans:
        counts[len(scan.ranges)] = counts.get(len(scan.ranges), 0) + 1
    num_beams = max(counts, key=lambda beams: counts[beams])
    return [scan for scan in scans if len(scan.ranges) == num_beams]


def find_range_quantum(measured: FloatArray) -> float:
    """Return the largest usual step [m] that divides nearly all ranges, 0 if none does.

    Parameters
    ----------
    measured : float64, shape (n,), finite ranges [m].
    """
    if len(measured) == 0:
        return 0.0
    for quantum in _QUANTA:
        steps = measured / quantum
        if np.mean(np.abs(steps - np.round(steps)) < _QUANTUM_TOLERANCE) > _QUANTUM_SHARE:
            return quantum
    return 0.0


def estimate_range_noise(ranges: FloatArray, range_max: float, quantum: float) -> float:
    """Return an estimate of the standard deviation of a range [m].

    Where the robot stands still, a second difference in time, r(k-1) - 2 r(k) + r(k+1), contains
    only noise, of 6 times its variance. Without enough such scans, differences along the beams are
    used, which are small on smooth walls. Outliers are removed by the median of the absolute
    values. The noise of quantized ranges is at least that of the quantization, step / sqrt(12).

    Parameters
    ----------
    ranges : float64, shape (num_scans, num_beams); in groups of three successive scans.
    range_max : ranges from here on are no measurements [m].
    quantum : step of the ranges [m], or 0.
    """
    valid = np.where((ranges > RANGE_MIN_LIMITS[0]) & (ranges < range_max), ranges, np.nan)
    floor = quantum / math.sqrt(12.0)
    triples = len(valid) // 3
    if triples >= _MIN_STILL_TRIPLES:
        grouped = valid[: 3 * triples].reshape(triples, 3, -1)
        change = np.abs(grouped[:, 2] - grouped[:, 0])
        moved = np.array([_median_of_finite(row) for row in change])
        still = grouped[moved <= max(quantum, _MAX_STILL_CHANGE)]
        if len(still) >= _MIN_STILL_TRIPLES:
            second = still[:, 0] - 2.0 * still[:, 1] + still[:, 2]
            return max(floor, _robust_spread(second, quantum) / math.sqrt(6.0))
    second = valid[:, :-2] - 2.0 * valid[:, 1:-1] + valid[:, 2:]
    return max(floor, _robust_spread(second, quantum) / math.sqrt(6.0))


def _median_of_finite(values: FloatArray) -> float:
    finite = values[np.isfinite(values)]
    return median(finite) if len(finite) else math.inf


def _robust_spread(values: FloatArray, quantum: float) -> float:
    """Return the standard deviation of the values without their outliers; 0 if there are none."""
    finite = values[np.isfinite(values)]
    if len(finite) == 0:
        return 0.0
    spread = _SIGMA_PER_MAD * float(np.median(np.abs(finite)))
    # The median of quantized values is quantized: refine it by the spread of the inliers.
    near = finite[np.abs(finite) <= _OUTLIER_SIGMAS * max(spread, quantum)]
    return float(np.sqrt(np.mean(near**2))) if len(near) else spread
