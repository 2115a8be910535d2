# SPDX-License-Identifier: Apache-2.0
"""The quick first pass over a CARMEN log: what each line is, its stamp, and a sample of scans."""

from __future__ import annotations

import math
from array import array
from dataclasses import dataclass, field
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from cartoloop.readers.carmen_lines import (
    IGNORED_TAGS,
    SCAN_TAGS,
    LineError,
    odom_stamp_index,
    parse_stamp,
    read_scan_line,
)
from cartoloop.readers.source import Source

FloatArray = NDArray[np.float64]
KindArray = NDArray[np.uint8]

# What a line is. Scans follow: FIRST_SCAN + index in SCAN_TAGS.
SILENT, ODOM, BROKEN, IGNORED, UNKNOWN, CUT, FIRST_SCAN = range(7)

# Scanners by the tags that carry their scans, those with an odometry pose first. A log often holds
# the same scan twice, once with a pose and once raw.
FRONT_TAGS = (b"ROBOTLASER1", b"FLASER", b"RAWLASER1")
REAR_TAGS = (b"ROBOTLASER2", b"RLASER", b"RAWLASER2")

_GROUP = 3  # successive scans, for the estimate of noise
_MAX_SAMPLE = 192  # groups

Scan = TypeVar("Scan")


class ScanSample(Generic[Scan]):
    """Some of the scans' lines, in groups of three, spread evenly over all that were offered."""

    def __init__(self) -> None:
        self.lines: list[tuple[int, Scan]] = []
        self._num_offered = 0
        self._stride = 1

    def offer(self, number: int, line: Scan) -> None:
        """Take the line number and the line (or what is in it) if its turn has come."""
        group = self._num_offered // _GROUP
        self._num_offered += 1
        if group % self._stride:
            return
        self.lines.append((number, line))
        if len(self.lines) >= 2 * _GROUP * _MAX_SAMPLE:
            groups = range(0, len(self.lines), 2 * _GROUP)
            self.lines = [pair for g in groups for pair in self.lines[g : g + _GROUP]]
            self._stride *= 2


@dataclass(slots=True)
class LogIndex:
    """What the first pass found, line by line.

    Attributes
    ----------
    kinds : uint8, shape (num_lines,), one of the constants above.
    stamps : float64, shape (num_lines,); NaN where a line has none [s].
    params : numeric PARAM values by name; the first of a name counts.
    samples : some scan lines of each tag.
    """

    kinds: KindArray
    stamps: FloatArray
    params: dict[str, float] = field(default_factory=dict)
    samples: dict[bytes, ScanSample[bytes]] = field(default_factory=dict)

    def count(self, tag: bytes) -> int:
        """Return how many scan lines there are of a tag."""
        return int((self.kinds == scan_kind(tag)).sum())

    def used_tags(self) -> list[bytes]:
        """Return the tags whose scans are used, one a scanner, the main scanner first."""
        used = []
        for tags in (FRONT_TAGS, REAR_TAGS):
            with_pose = max(tags[:2], key=self.count)
            tag = with_pose if self.count(with_pose) else tags[2]
            if self.count(tag):
                used.append(tag)
        return used


def scan_kind(tag: bytes) -> int:
    """Return the kind of the lines of a tag in `SCAN_TAGS`."""
    return FIRST_SCAN + SCAN_TAGS.index(tag)


def index_log(source: Source) -> LogIndex:
    """Return what each line of the log is."""
    kinds, stamps = bytearray(), array("d")
    samples: dict[bytes, ScanSample[bytes]] = {tag: ScanSample() for tag in SCAN_TAGS}
    kind_of_tag = {tag: scan_kind(tag) for tag in SCAN_TAGS}
    params: dict[str, float] = {}
    for number, line in enumerate(source.lines()):
        words = line.split(None, 1)
        tag = words[0] if words else b"#"
        kind, stamp = kind_of_tag.get(tag, SILENT), math.nan
        try:
            if kind >= FIRST_SCAN:
                scan = read_scan_line(line)
                stamp = parse_stamp(scan.tail, scan.stamp)
                samples[tag].offer(number, line)
            elif tag == b"ODOM":
                kind, tokens = ODOM, line.split()
                stamp = parse_stamp(tokens, odom_stamp_index(len(tokens)))
            elif tag == b"PARAM":
                _note_param(line.split(), params)
            elif not tag.startswith(b"#"):
                kind = IGNORED if tag in IGNORED_TAGS else UNKNOWN
        except LineError:
            kind = BROKEN
        kinds.append(kind)
        stamps.append(stamp)
    index = LogIndex(np.frombuffer(kinds, np.uint8), np.array(stamps), params, samples)
    _mark_cut_line(index, source)
    return index


def _mark_cut_line(index: LogIndex, source: Source) -> None:
    """Mark a last line that lost its stamp where all others have one: its numbers are cut too."""
    if not source.ends_mid_line or len(index.kinds) < 2:
        return
    data = (index.kinds == ODOM) | (index.kinds >= FIRST_SCAN)
    has_stamp = bool(np.isfinite(index.stamps[-1]))
    if data[-1] and not has_stamp and np.isfinite(index.stamps[:-1][data[:-1]]).any():
        index.kinds = index.kinds.copy()
        index.kinds[-1] = CUT
        for sample in index.samples.values():
            sample.lines = [pair for pair in sample.lines if pair[0] != len(index.kinds) - 1]


def _note_param(tokens: list[bytes], params: dict[str, float]) -> None:
    """Keep the parameter if its value is a finite number; others say nothing about scanners."""
    if len(tokens) < 3:
        return
    try:
        value = float(tokens[2])
    except ValueError:
        return
    if math.isfinite(value):
        params.setdefault(tokens[1].decode("ascii", "replace"), value)
