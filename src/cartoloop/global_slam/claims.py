# SPDX-License-Identifier: Apache-2.0
"""What matches of composite scans claim about where one part of a map lies in another."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, overload

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.config import WideSearchConfig
from cartoloop.global_slam.hypotheses import Candidate
from cartoloop.kernels.pose_agreement import lie_alike
from cartoloop.sensor.pose import Pose, compose, compose_all, inverse, wrap_angles

SAME_PLACE = 3.0
"""Claims within this many times ``place_distance`` are about the same place: parts are bent."""


class Claim(NamedTuple):
    """A hypothesis about two parts: where a composite scan is in both.

    Attributes
    ----------
    candidate : the match.
    tf_one_scan, tf_other_scan : shape (3,), pose in either part; one of them is claimed.
    evidence : by which the score exceeds the best one in another place.
    """

    candidate: Candidate
    tf_one_scan: FloatArray
    tf_other_scan: FloatArray
    evidence: float

    @property
    def tf_one_other(self) -> Pose:
        """Where the claim places the frame of the other part in that of the one."""
        return compose(
            Pose(*self.tf_one_scan.tolist()), inverse(Pose(*self.tf_other_scan.tolist()))
        )


class Claims(Sequence[Claim]):
    """Many claims about two parts, as columns. Read only.

    Attributes
    ----------
    candidates : n matches.
    tf_one_scan, tf_other_scan : float64, shape (n, 3), poses in either part.
    evidence : float64, shape (n,).
    """

    __slots__ = ("candidates", "evidence", "tf_one_scan", "tf_other_scan")

    def __init__(
        self,
        candidates: Sequence[Candidate],
        tf_one_scan: FloatArray,
        tf_other_scan: FloatArray,
        evidence: FloatArray,
    ) -> None:
        self.candidates = candidates
        self.tf_one_scan = tf_one_scan
        self.tf_other_scan = tf_other_scan
        self.evidence = evidence

    @staticmethod
    def of(claims: Sequence[Claim]) -> Claims:
        """Return claims as columns."""
        if isinstance(claims, Claims):
            return claims
        return Claims(
            [claim.candidate for claim in claims],
            np.array([claim.tf_one_scan for claim in claims]).reshape(-1, 3),
            np.array([claim.tf_other_scan for claim in claims]).reshape(-1, 3),
            np.array([claim.evidence for claim in claims], dtype=np.float64),
        )

    def take(self, rows: IntArray) -> Claims:
        """Return some of the claims, by index."""
        return Claims(
            [self.candidates[row] for row in rows.tolist()],
            self.tf_one_scan[rows],
            self.tf_other_scan[rows],
            self.evidence[rows],
        )

    def are_at(self, tf_one_other: Pose, wide: WideSearchConfig) -> BoolArray:
        """Return which claims place their scans, within what drifts, where a placement does."""
        off = compose_all(np.array(tf_one_other), self.tf_other_scan) - self.tf_one_scan
        is_there: BoolArray = (
            np.hypot(off[:, 0], off[:, 1]) <= SAME_PLACE * wide.place_distance
        ) & (np.abs(wrap_angles(off[:, 2])) <= math.radians(wide.place_angle_deg))
        return is_there

    def agreement(self, wide: WideSearchConfig) -> BoolArray:
        """Return which claims agree with each other, (n, n)."""
        return lie_alike(
            self.tf_one_scan,
            self.tf_other_scan,
            wide.max_disagreement,
            wide.max_disagreement_growth,
            math.radians(wide.max_turn_deg),
            math.radians(wide.max_turn_growth_deg),
        )

    def __len__(self) -> int:
        return len(self.candidates)

    @overload
    def __getitem__(self, row: int) -> Claim: ...
    @overload
    def __getitem__(self, row: slice) -> Claims: ...
    def __getitem__(self, row: int | slice) -> Claim | Claims:
        if isinstance(row, slice):
            return self.take(np.arange(len(self))[row])
        return Claim(
            self.candidates[row],
            self.tf_one_scan[row],
            self.tf_other_scan[row],
            float(self.evidence[row]),
        )
