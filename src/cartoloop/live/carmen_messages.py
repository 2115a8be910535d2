# SPDX-License-Identifier: Apache-2.0
"""Lines of a CARMEN log, while it is being written, into messages.

The lines are parsed as those of a finished log. The choices that need the whole log are made
on-line instead: the first line of a scanner determines which lines of it are used and, if it
states one, its mounting pose; of a parameter the latest value counts.
"""

from __future__ import annotations

import math
from dataclasses import replace

from cartoloop.live.messages import LiveMessage, MessageError
from cartoloop.readers.carmen import CARMEN, REAR_TAGS, mounting
from cartoloop.readers.line_format import LineError, Reading
from cartoloop.sensor.events import LaserScan, Odometry
from cartoloop.sensor.pose import Pose


class CarmenStream:
    """Turns lines into messages one by one."""

    def __init__(self) -> None:
        self._parse = CARMEN.parser(())
        self._settings: dict[str, float] = {}
        self._tags: dict[bool, str] = {}  # by whether it is the rear scanner
        self._mountings: dict[str, Pose] = {}

    def parse(self, line: bytes) -> list[LiveMessage]:
        """Return the messages in a line: odometry, a scan, both or neither.

        Raises
        ------
        MessageError
            The line is damaged, or is not of a CARMEN log.
        """
        try:
            reading = self._parse(line)
        except LineError as error:
            if not error.detail:
                return []
            raise MessageError(error.reason, error.detail) from None
        if reading is None:
            return []
        if reading.setting is not None:
            name, value = reading.setting
            self._settings[name] = value
        messages: list[LiveMessage] = []
        if reading.ranges is not None and reading.geometry is not None:
            tag = reading.geometry.sensor
            # FLASER and ROBOTLASER1 lines may be of the same scanner: the first to come is used.
            if self._tags.setdefault(tag in REAR_TAGS, tag) != tag:
                return []
            geometry = replace(
                reading.geometry,
                tf_tracking_sensor=self._mounting(tag, reading),
                sensor="rear" if tag in REAR_TAGS else "",
            )
            messages.append(LaserScan(reading.stamp, math.nan, reading.ranges, geometry))
        if reading.tf_odom_tracking is not None:
            messages.insert(0, Odometry(reading.stamp, math.nan, reading.tf_odom_tracking))
        return messages

    def _mounting(self, tag: str, reading: Reading) -> Pose:
        """Return the mounting pose of a scanner by its first scan, else by the parameters."""
        if tag not in self._mountings:
            if reading.tf_tracking_sensor is None:
                return mounting(tag, self._settings)
            self._mountings[tag] = reading.tf_tracking_sensor
        return self._mountings[tag]
