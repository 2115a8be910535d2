# SPDX-License-Identifier: Apache-2.0
"""Many errors in few numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from cartoloop.arrays import FloatArray

PERCENTILES = (50, 75, 90, 95, 99)
"""Per cent of the errors that :func:`percentiles` gives the bounds of."""


@dataclass(frozen=True)
class ErrorStatistics:
    """What errors are like, in the unit of the errors.

    Attributes
    ----------
    rmse : root of the mean square.
    mean, median : of the errors.
    std : standard deviation of the errors as they are, not as a sample of more: divided by n.
    min, max : least and greatest.
    p50, p90, p99 : percentiles of the errors, interpolated linearly.
    """

    rmse: float
    mean: float
    median: float
    std: float
    min: float
    max: float
    p50: float
    p90: float
    p99: float

    @classmethod
    def of(cls, errors: FloatArray) -> ErrorStatistics:
        """Return the statistics of errors, shape (n,), n > 0."""
        p50, p90, p99 = (float(bound) for bound in np.percentile(errors, (50, 90, 99)))
        return cls(
            rmse=float(np.sqrt(np.mean(errors**2))),
            mean=float(np.mean(errors)),
            median=float(np.median(errors)),
            std=float(np.std(errors)),
            min=float(np.min(errors)),
            max=float(np.max(errors)),
            p50=p50,
            p90=p90,
            p99=p99,
        )

    def to_dict(self) -> dict[str, float]:
        """Return the numbers by name, as for JSON."""
        return asdict(self)


def percentiles(errors: FloatArray, levels: Sequence[int] = PERCENTILES) -> dict[str, float]:
    """Return the bound of each per cent of the errors by name, such as ``p95``, and their ``max``.

    Parameters
    ----------
    errors : float64 (n,), n > 0.
    levels : per cents; between two errors the bound is linear.
    """
    bounds = np.percentile(errors, levels)
    named = {f"p{level}": float(bound) for level, bound in zip(levels, bounds, strict=True)}
    return {**named, "max": float(np.max(errors))}
