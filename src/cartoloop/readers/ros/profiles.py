# SPDX-License-Identifier: Apache-2.0
"""Profiles of the scanners, estimated from the sample of the first pass."""

from __future__ import annotations

import math

import numpy as np

from cartoloop.errors import InputError
from cartoloop.readers.ros.cloud import RawCloud
from cartoloop.readers.ros.container import BagFinding
from cartoloop.readers.ros.decoders import ScanDecoder
from cartoloop.readers.ros.index import TopicStream
from cartoloop.readers.ros.raw_messages import RawScan
from cartoloop.readers.ros.wire import DecodeError
from cartoloop.sensor.events import LaserScan
from cartoloop.sensor.sensor_profile import SensorProfile, profile_sensor

_MISFIT_BEAMS = 1.5
"""Angle steps by which angle_max may differ: some drivers count one beam more or less."""


def scan_profile(decoder: ScanDecoder, stream: TopicStream, name: str) -> SensorProfile:
    """Return the profile of a laser scanner.

    Parameters
    ----------
    decoder : of the stream's messages, without a profile yet.
    name : of the recording, for messages.

    Raises
    ------
    InputError
        None of its scans can be used.
    """
    scans: list[LaserScan] = []
    reasons = set(stream.undecodable)
    for number, message in enumerate(stream.samples):
        try:
            if isinstance(message, RawScan):
                scans.append(decoder.event(message, float(number), float(number)))
        except DecodeError as error:
            reasons.add(str(error))
    if not scans:
        why = ", ".join(sorted(reasons)) or "none can be read"
        raise InputError(
            f"{name}: no scan of {stream.topic} can be used ({why}); check how it was recorded"
        )
    return profile_sensor(scans)


def cloud_profile(stream: TopicStream) -> SensorProfile:
    """Return the profile of a scanner that sends point clouds."""
    clouds = [s.points for s in stream.samples if isinstance(s, RawCloud) and len(s.points)]
    if not clouds:
        clouds = [np.ones((1, 3))]
    bearings = [np.unique(np.round(np.degrees(np.arctan2(p[:, 1], p[:, 0])))) for p in clouds]
    seen = math.radians(float(np.median([min(len(b), 360) for b in bearings])))
    num_points = int(np.median([len(points) for points in clouds]))
    return SensorProfile(
        num_beams=num_points,
        field_of_view=seen,
        angular_resolution=seen / max(num_points - 1, 1),
        range_min=min(float(np.linalg.norm(points, axis=1).min()) for points in clouds),
        range_max=math.inf,
        no_return=None,
        share_no_return=0.0,
        range_quantum=0.0,
        range_noise=0.0,
        rate=0.0,
        num_scans=len(clouds),
    )


def beam_findings(stream: TopicStream, decoder: ScanDecoder) -> list[BagFinding]:
    """Return contradictions in the numbers that a scanner sends about its beams."""
    message = next((s for s in stream.samples if isinstance(s, RawScan)), None)
    if message is None or len(message.ranges) < 2:
        return []
    first, last, step, increment, _, low, high = message.beam_numbers
    count = len(message.ranges)
    doubts = []
    if not abs(first + (count - 1) * step - last) <= _MISFIT_BEAMS * abs(step):
        doubts.append((
            "angle_max",
            f"{count} beams from {first:.4f} rad, one each {step:.5f} rad, do not end at "
            f"angle_max {last:.4f} rad",
            "the step is used" if math.isfinite(step) and step else "angle_max is used",
        ))  # fmt: skip
    if increment > 0.0 and decoder.time_increment(increment, count) == 0.0:
        doubts.append((
            "time_increment",
            f"{count} beams, one each {increment:.3g} s, take longer than the time between scans",
            "all beams of a scan are taken to be measured at once",
        ))  # fmt: skip
    if not (math.isfinite(high) and high > max(low, 0.0)):
        doubts.append((
            "range_limits",
            f"range_min {low:g} m and range_max {high:g} m are not valid",
            "the limits are estimated from the ranges",
        ))  # fmt: skip
    return [
        BagFinding("note", code, f"{stream.topic}: {message}", remedy, stream.topic)
        for code, message, remedy in doubts
    ]
