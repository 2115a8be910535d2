# SPDX-License-Identifier: Apache-2.0
"""Error of a trajectory against relative poses that people verified: table II of the paper.

The benchmark is that of Kuemmerle et al., "On measuring the accuracy of SLAM algorithms" (2009):
no global frame, only relations between pairs of scans, so that one bend does not count for ever.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, fields
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import FloatArray
from cartoloop.errors import InputError
from cartoloop.evaluation.error_statistics import percentiles
from cartoloop.evaluation.text_table import read_table
from cartoloop.evaluation.trajectories import Trajectory
from cartoloop.sensor.pose import relative_all, wrap_angles

DEFAULT_TOLERANCE_S = 5e-3
"""Stamps of relations are those of scans up to rounding; scans are tens of milliseconds apart."""


@dataclass(frozen=True)
class Relations:
    """Verified relative poses.

    Attributes
    ----------
    stamps : float64 (m, 2) [s], names of the two scans.
    poses : float64 (m, 3), the pose of the second in the frame of the first [m, m, rad].
    """

    stamps: FloatArray
    poses: FloatArray


@dataclass(frozen=True)
class MeanStd:
    """Mean and (sample) standard deviation."""

    mean: float
    std: float


@dataclass(frozen=True)
class RelationsError:
    """One column of table II.

    Attributes
    ----------
    absolute_translational : |trans| [m].
    squared_translational : trans^2 [m^2].
    absolute_rotational_deg : |rot| [deg].
    squared_rotational_deg2 : rot^2 [deg^2].
    num_relations : relations that counted.
    num_missing : relations with a stamp that the trajectory does not have.
    missing_stamps : the distinct stamps it does not have, in order of time.
    absolute_translational_percentiles : |trans| [m] that 50, 75, 90, 95 and 99 % of the relations
        do not exceed, and the greatest; by name: ``p50`` to ``p99``, ``max``.
    absolute_rotational_deg_percentiles : the same of |rot| [deg].
    rows : int64 (n,), which of the relations counted, in their order.
    translations : float64 (n,), |trans| of each of those [m].
    rotations_deg : float64 (n,), |rot| of each of those [deg].
    """

    absolute_translational: MeanStd
    squared_translational: MeanStd
    absolute_rotational_deg: MeanStd
    squared_rotational_deg2: MeanStd
    num_relations: int
    num_missing: int
    missing_stamps: tuple[float, ...]
    absolute_translational_percentiles: dict[str, float]
    absolute_rotational_deg_percentiles: dict[str, float]
    rows: NDArray[np.int64] = field(repr=False, compare=False)
    translations: FloatArray = field(repr=False, compare=False)
    rotations_deg: FloatArray = field(repr=False, compare=False)

    def to_dict(self) -> dict[str, Any]:
        """Return plain dictionaries and numbers, as for JSON: all but the single errors."""
        values = {item.name: getattr(self, item.name) for item in fields(self) if item.compare}
        return {
            name: asdict(value) if isinstance(value, MeanStd) else value
            for name, value in values.items()
        }


def read_relations(path: str | PathLike[str]) -> Relations:
    """Return the relations in a file of lines ``stamp1 stamp2 x y z roll pitch yaw``.

    Raises
    ------
    InputError
        The file cannot be read, holds no relation, or a line is not eight finite numbers.
    """
    table, _ = read_table(path, "stamp1 stamp2 x y z roll pitch yaw")
    return Relations(stamps=table[:, :2], poses=table[:, [2, 3, 7]])


def evaluate_relations(
    trajectory: Trajectory, relations: Relations, tolerance: float = DEFAULT_TOLERANCE_S
) -> RelationsError:
    """Return the error of all relations whose two stamps are in the trajectory.

    Parameters
    ----------
    trajectory, relations : what to judge, and by what.
    tolerance : a stamp is in the trajectory if a pose is this near in time [s].

    Raises
    ------
    ConfigError
        `tolerance` is negative or no number.
    InputError
        No relation has both of its stamps in the trajectory.

    Notes
    -----
    The error of a relation is the estimated relative pose less the expected one:
    |t_estimated - t_expected|, and the angle between them.
    """
    rows = trajectory.find(relations.stamps.ravel(), tolerance).reshape(-1, 2)
    known = np.all(rows >= 0, axis=1)
    missing = np.unique(relations.stamps[rows < 0])
    if not np.any(known):
        raise InputError(
            f"none of the {len(rows)} relations has both stamps in the trajectory, to "
            f"{tolerance:g} s; first missing stamp {missing[0]:.6f}: of the same recording?"
        )
    first, second = trajectory.poses[rows[known, 0]], trajectory.poses[rows[known, 1]]
    estimated, expected = relative_all(first, second), relations.poses[known]
    translation = np.hypot(*(estimated[:, :2] - expected[:, :2]).T)
    rotation_deg = np.abs(np.degrees(wrap_angles(estimated[:, 2] - expected[:, 2])))
    return RelationsError(
        absolute_translational=_mean_std(translation),
        squared_translational=_mean_std(translation**2),
        absolute_rotational_deg=_mean_std(rotation_deg),
        squared_rotational_deg2=_mean_std(rotation_deg**2),
        num_relations=int(np.count_nonzero(known)),
        num_missing=int(np.count_nonzero(~known)),
        missing_stamps=tuple(float(stamp) for stamp in missing),
        absolute_translational_percentiles=percentiles(translation),
        absolute_rotational_deg_percentiles=percentiles(rotation_deg),
        rows=np.flatnonzero(known),
        translations=translation,
        rotations_deg=rotation_deg,
    )


def _mean_std(values: FloatArray) -> MeanStd:
    std = float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
    return MeanStd(mean=float(np.mean(values)), std=std)
