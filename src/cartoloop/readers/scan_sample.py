# SPDX-License-Identifier: Apache-2.0
"""A sample of a recording's scans, from which the scanner's profile is estimated."""

from __future__ import annotations

from typing import Generic, TypeVar

_GROUP = 3
"""Scans in a group: the noise of the ranges is estimated from three successive scans."""

_MAX_GROUPS = 192
"""Groups kept at least, once that many were offered: bounds memory and time of the estimate."""

Scan = TypeVar("Scan")


class ScanSample(Generic[Scan]):
    """Groups of three successive scans, spread evenly over all that were offered.

    Attributes
    ----------
    scans : line index and scan, in the order of the file.
    """

    def __init__(self) -> None:
        self.scans: list[tuple[int, Scan]] = []
        self._num_offered = 0
        self._stride = 1

    def offer(self, number: int, scan: Scan) -> None:
        """Keep a scan, of line index `number`, if its group is part of the sample."""
        group = self._num_offered // _GROUP
        self._num_offered += 1
        if group % self._stride:
            return
        self.scans.append((number, scan))
        if len(self.scans) >= 2 * _GROUP * _MAX_GROUPS:
            groups = range(0, len(self.scans), 2 * _GROUP)
            self.scans = [pair for g in groups for pair in self.scans[g : g + _GROUP]]
            self._stride *= 2

    def drop(self, number: int) -> None:
        """Remove the scan of a line, if it is in the sample."""
        self.scans = [pair for pair in self.scans if pair[0] != number]
