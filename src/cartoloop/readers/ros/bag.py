# SPDX-License-Identifier: Apache-2.0
"""A ROS recording as a log: looked through once when opened, then its events, merged by time."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from cartoloop.errors import InputError
from cartoloop.readers.log import Problem, Problems
from cartoloop.readers.options import ReadOptions
from cartoloop.readers.ros import messages as ros
from cartoloop.readers.ros.choice import choose_topics
from cartoloop.readers.ros.cloud import CloudMessage
from cartoloop.readers.ros.container import Container
from cartoloop.readers.ros.decoders import CloudDecoder, ImuDecoder, OdometryDecoder, ScanDecoder
from cartoloop.readers.ros.index import RecordingIndex, Stream, index_recording, new_poses
from cartoloop.readers.ros.inventory import Inventory
from cartoloop.readers.ros.opening import open_containers
from cartoloop.readers.ros.summaries import container_findings, describe, take_inventory
from cartoloop.readers.ros.times import common_times, merged_order
from cartoloop.readers.ros.wire import DecodeError
from cartoloop.sensor.events import LaserScan, SensorEvent
from cartoloop.sensor.sensor_profile import SensorProfile, profile_sensor
from cartoloop.sensor.time_repair import TimeReport

MAX_WAITING = 50_000
"""How many messages are held back at most to bring them into the order of time."""

MAX_WAITING_BYTES = 256 << 20

_PRIORITY = {"imu": 0, "odometry": 1, "scan": 2, "cloud": 2}
_SEVERITY = {"error": 0, "warning": 1, "note": 2}

Decode = Callable[[bytes, float, float], SensorEvent]
Message = tuple[bytes, float, float]


class BagLog:
    """A ROS 1 bag or a ROS 2 recording; see `cartoloop.readers.log.Log` for what it offers.

    Parameters
    ----------
    path : a bag, a folder with metadata.yaml, a .db3 or .mcap file.
    options : what the user says about it.

    Attributes
    ----------
    inventory : its topics, frames, transforms, what is used and why, and what is wrong.
    profiles : the profile of each scanner that is used, by topic; the main scanner first.

    Raises
    ------
    InputError
        If it cannot be read, is no recording, holds no usable scan, or not what is asked for.
    """

    def __init__(self, path: str | Path, options: ReadOptions | None = None) -> None:
        self._path = Path(path)
        self._options = options or ReadOptions()
        self.name = self._path.name or str(self._path)
        self._container, index = _best_index(open_containers(self._path), self._options)
        self._choice = choose_topics(index, self._options, str(self._path))
        self._streams = self._choice.streams
        self._times, time_findings = common_times(self._streams)
        self.time_report: TimeReport = self._times[0].report
        priorities = [_PRIORITY[stream.role] for stream in self._streams]
        self._order = merged_order(self._times, priorities)
        self._decoders = self._make_decoders()
        self.profiles = self._profile_scanners(str(self._path))
        findings = [
            *container_findings(self._container),
            *self._choice.findings,
            *index.findings,
            *time_findings,
        ]
        findings.sort(key=lambda finding: _SEVERITY[finding.severity])
        self.inventory: Inventory = take_inventory(index, self._choice, findings)
        self._found = Problems()
        for finding in findings:
            self._found.add(finding.severity, f"{self.name}: {finding.line}", finding.code)
        self._current = self._found
        num_scanners = len(self._choice.scanners)
        self.num_scans = sum(len(stream.stamps) for stream in self._streams[:num_scanners])

    @property
    def description(self) -> str:
        """What is in it, and what is used of it and why: some lines for the user."""
        return describe(self.inventory, self.profile)

    @property
    def profile(self) -> SensorProfile:
        """What the recording says of its main scanner."""
        return next(iter(self.profiles.values()))

    @property
    def duration(self) -> float:
        """Repaired time from the first to the last event [s]."""
        first = min(float(times.times[0]) for times in self._times)
        return max(float(times.times[-1]) for times in self._times) - first

    @property
    def skipped(self) -> dict[str, int]:
        """How many messages were skipped, by reason; grows while iterating."""
        return self._current.skipped

    @property
    def problems(self) -> list[Problem]:
        """The first problems found, each one line with its place; grows while iterating."""
        return self._current.kept

    @property
    def num_problems(self) -> int:
        """How many problems were found, including those not kept in `problems`."""
        return self._current.count

    def __iter__(self) -> Iterator[SensorEvent]:
        """Yield the events in the order of their times; bad messages are skipped and counted.

        Raises
        ------
        InputError
            No scan at all can be used.
        """
        current = self._current = self._found.copy()
        num_scans = 0
        is_scanner = [stream.role in ("scan", "cloud") for stream in self._streams]
        decoders = self._decoders
        for owner, (raw, stamp, time) in self._in_order(current):
            try:
                event = decoders[owner](raw, stamp, time)
            except DecodeError as error:
                topic = self._streams[owner].topic
                current.skip(str(error), f"{self.name}: {topic}: stamp {stamp:.6f}: {error}")
                continue
            num_scans += is_scanner[owner]
            yield event
        if num_scans == 0:
            why = ", ".join(sorted(current.skipped)) or "none can be read"
            raise InputError(
                f"{self._path}: no scan of {self._streams[0].topic} can be used ({why}); "
                "check how it was recorded"
            )

    def _in_order(self, current: Problems) -> Iterator[tuple[int, Message]]:
        """Yield whose turn it is and the message, in the order that the stamps gave.

        A message waits until those before it have been read. Where too many wait, those that are
        missing are given up, and skipped when they come.
        """
        waiting: list[deque[Message]] = [deque() for _ in self._streams]
        given_up = [0] * len(self._streams)
        num_waiting = num_bytes = 0
        order = self._order.tolist()
        place = 0
        for owner, message in self._messages():
            if given_up[owner]:
                given_up[owner] -= 1
                current.skip("recorded too late to be put in order")
                continue
            waiting[owner].append(message)
            num_waiting += 1
            num_bytes += len(message[0])
            full = num_waiting > MAX_WAITING or num_bytes > MAX_WAITING_BYTES
            while place < len(order):
                queue = waiting[order[place]]
                if not queue:
                    if not full or num_waiting == 0:
                        break
                    given_up[order[place]] += 1
                    place += 1
                    continue
                first = queue.popleft()
                num_waiting -= 1
                num_bytes -= len(first[0])
                yield order[place], first
                place += 1
        # The recording may break off earlier than in the first pass.
        for owner in order[place:]:
            if waiting[owner]:
                yield owner, waiting[owner].popleft()

    def _messages(self) -> Iterator[tuple[int, Message]]:
        """Yield owner, bytes, stamp and time of the messages that are used, as recorded."""
        owner_of = {
            key: owner
            for owner, stream in enumerate(self._streams)
            if stream.edge is None
            for key in stream.keys
        }
        stamps, times = self._stamps_and_times()
        counts = [0] * len(self._streams)
        edge_owner = next((o for o, s in enumerate(self._streams) if s.edge is not None), None)
        edge_keys = set() if edge_owner is None else set(self._streams[edge_owner].keys)
        poses = _EdgePoses(self._streams[edge_owner]) if edge_owner is not None else None
        for key, _, raw in self._container.messages(owner_of.keys() | edge_keys):
            owner = owner_of.get(key)
            if owner is None:
                if poses is None or edge_owner is None:
                    continue
                for pose in poses.encoded(raw):
                    number = counts[edge_owner]
                    counts[edge_owner] += 1
                    yield edge_owner, (pose, stamps[edge_owner][number], times[edge_owner][number])
                continue
            number = counts[owner]
            if number >= len(times[owner]):
                continue
            counts[owner] += 1
            yield owner, (raw, stamps[owner][number], times[owner][number])

    def _stamps_and_times(self) -> tuple[list[list[float]], list[list[float]]]:
        times = [stream.times.tolist() for stream in self._times]
        stamps = [np.where(np.isnan(s.stamps), s.times, s.stamps).tolist() for s in self._times]
        return stamps, times

    def _make_decoders(self) -> list[Decode]:
        choice = self._choice
        decoders: list[Decode] = []
        self._scan_decoders: list[ScanDecoder] = []
        for scanner in choice.scanners:
            if scanner.stream.role == "cloud":
                decoders.append(CloudDecoder(scanner).decode)
            else:
                self._scan_decoders.append(ScanDecoder(scanner, self._options))
                decoders.append(self._scan_decoders[-1].decode)
        if choice.odometry is not None:
            odometry = OdometryDecoder(choice.odometry)
            if choice.odometry.stream.edge is None:
                decoders.append(odometry.decode)
            else:
                decoders.append(lambda raw, stamp, time: odometry.event(_floats(raw), stamp, time))
        if choice.imu is not None:
            decoders.append(ImuDecoder(choice.imu).decode)
        return decoders

    def _profile_scanners(self, name: str) -> dict[str, SensorProfile]:
        """Read each scanner's profile off the sample of its scans."""
        profiles = {}
        has = {
            "has_odometry": self._choice.odometry is not None,
            "has_imu": self._choice.imu is not None,
        }
        for number, scanner in enumerate(self._choice.scanners):
            stream = scanner.stream
            if stream.role == "cloud":
                profile = _cloud_profile(stream)
            else:
                profile = self._profile_of(self._scan_decoders[number], stream, name)
            period = self._times[number].report.period
            rate = 1.0 / period if len(stream.stamps) > 1 and period > 0.0 else 0.0
            profiles[stream.topic] = replace(profile, rate=rate, **has)
            if stream.role == "scan":
                self._scan_decoders[number].use_profile(profiles[stream.topic])
        return profiles

    def _profile_of(self, decoder: ScanDecoder, stream: Stream, name: str) -> SensorProfile:
        scans: list[LaserScan] = []
        for number, message in enumerate(stream.samples):
            try:
                if isinstance(message, ros.ScanMessage):
                    scans.append(decoder.event(message, float(number), float(number)))
            except DecodeError as error:
                stream.undecodable[str(error)] += 1
        if not scans:
            why = ", ".join(sorted(stream.undecodable)) or "none can be read"
            raise InputError(
                f"{name}: no scan of {stream.topic} can be used ({why}); check how it was recorded"
            )
        return profile_sensor(scans)


class _EdgePoses:
    """The poses of one frame in another out of ``/tf`` messages, as in the first pass."""

    def __init__(self, stream: Stream) -> None:
        self._is_ros1 = stream.is_ros1
        self._edge = stream.edge or ("", "")
        self._last_stamp = -1

    def encoded(self, raw: bytes) -> list[bytes]:
        """Return the poses of a message, each as seven float64."""
        try:
            sent = ros.decode_transforms(raw, self._is_ros1)
        except DecodeError:
            return []  # counted in the first pass
        found = list(new_poses(sent, self._edge, self._last_stamp))
        if found:
            self._last_stamp = found[-1].stamp
        return [np.array(pose.values).tobytes() for pose in found]


def _floats(raw: bytes) -> tuple[float, ...]:
    return tuple(np.frombuffer(raw, dtype=np.float64).tolist())


def _best_index(
    containers: list[Container], options: ReadOptions
) -> tuple[Container, RecordingIndex]:
    """Return the reader that gets the most out of a recording, and what it found."""
    best: RecordingIndex | None = None
    for container in containers:
        index = index_recording(container, options)
        if best is None or index.num_messages > best.num_messages:
            best = index
        if not container.damage:
            break
    if best is None:
        raise InputError("no recording is given")
    return best.container, best


def _cloud_profile(stream: Stream) -> SensorProfile:
    """Return the profile of a scanner of points in space, of which less needs to be known."""
    clouds = [s.points for s in stream.samples if isinstance(s, CloudMessage) and len(s.points)]
    counts = [len(points) for points in clouds]
    bearings = [np.unique(np.round(np.degrees(np.arctan2(p[:, 1], p[:, 0])))) for p in clouds]
    seen = math.radians(float(np.median([min(len(b), 360) for b in bearings]))) if clouds else 0.0
    num_points = int(np.median(counts)) if counts else 0
    ranges = np.concatenate([np.linalg.norm(p, axis=1) for p in clouds]) if clouds else np.ones(1)
    return SensorProfile(
        num_beams=num_points,
        field_of_view=seen,
        angular_resolution=seen / max(num_points - 1, 1),
        range_min=float(ranges.min()),
        range_max=math.inf,
        no_return=None,
        share_no_return=0.0,
        range_quantum=0.0,
        range_noise=0.0,
        rate=0.0,
        num_scans=len(clouds),
    )
