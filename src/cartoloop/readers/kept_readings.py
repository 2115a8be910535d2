# SPDX-License-Identifier: Apache-2.0
"""What the lines of a text hold, kept while they are indexed, so that no later pass parses them."""

from __future__ import annotations

from cartoloop.readers.line_format import LineError, Reading

KEPT_BYTES = 48 << 20
"""Memory that readings may take in all [bytes]: half an hour of scans of 180 beams, ten each
second. Longer recordings are parsed in each pass."""

_READING_BYTES = 400
"""What a reading takes without its ranges [bytes]."""


class KeptReadings:
    """The readings of the first lines: all lines or none, since a parser may remember earlier ones.

    Parameters
    ----------
    max_bytes : memory that they may take.

    Attributes
    ----------
    is_whole : whether none had to be dropped.
    """

    def __init__(self, max_bytes: int = KEPT_BYTES) -> None:
        self.is_whole = True
        self._readings: list[Reading | LineError | None] = []
        self._num_left = max_bytes

    def add(self, reading: Reading | LineError | None) -> None:
        """Add what the next line holds, or why it cannot be used."""
        if not self.is_whole:
            return
        if isinstance(reading, LineError):
            reading = LineError(reading.reason, reading.detail)  # without its traceback
        elif reading is not None and reading.ranges is not None:
            self._num_left -= reading.ranges.nbytes
        self._num_left -= _READING_BYTES
        self._readings.append(reading)
        if self._num_left < 0:
            self.is_whole = False
            self._readings.clear()

    def of_line(self, line: int) -> Reading | None:
        """Return what a line holds; the ranges are a copy.

        Raises
        ------
        LineError
            It cannot be used.
        """
        reading = self._readings[line]
        if isinstance(reading, LineError):
            raise LineError(reading.reason, reading.detail)
        if reading is None or reading.ranges is None:
            return reading
        return reading._replace(ranges=reading.ranges.copy())
