# SPDX-License-Identifier: Apache-2.0
"""A ROS recording as a log: indexed when opened, then its events, merged by time."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

from cartoloop.errors import InputError
from cartoloop.readers.fingerprint import fingerprint
from cartoloop.readers.log import EventGenerator, LogBase, ProblemLog, short_name
from cartoloop.readers.read_options import ReadOptions
from cartoloop.readers.ros.choice import TopicChoice, choose_topics
from cartoloop.readers.ros.container import BagFinding, Container
from cartoloop.readers.ros.decoders import CloudDecoder, ImuDecoder, OdometryDecoder, ScanDecoder
from cartoloop.readers.ros.index import RecordingIndex, index_recording
from cartoloop.readers.ros.inventory import (
    Inventory,
    container_findings,
    describe,
    stream_findings,
    take_inventory,
)
from cartoloop.readers.ros.merging import MergedMessages
from cartoloop.readers.ros.opening import open_containers
from cartoloop.readers.ros.profiles import beam_findings, cloud_profile, scan_profile
from cartoloop.readers.ros.stream_times import common_times
from cartoloop.readers.ros.wire import DecodeError
from cartoloop.sensor.events import SensorEvent
from cartoloop.sensor.sensor_profile import SensorProfile
from cartoloop.sensor.time_repair import TimeReport

_SEVERITY = {"error": 0, "warning": 1, "note": 2}

Decode = Callable[[bytes, float, float], SensorEvent]


class BagLog(LogBase):
    """A ROS 1 bag or a ROS 2 recording; see `cartoloop.readers.log.Log` for what it offers.

    Parameters
    ----------
    path : a bag, a folder with metadata.yaml, a .db3 or .mcap file.
    options : facts that the user states.

    Attributes
    ----------
    inventory : its topics, frames, transforms, which are used and why, and its problems.
    profiles : the profile of each scanner that is used, by topic; the main scanner first.

    Raises
    ------
    InputError
        If it cannot be read, is no recording, holds no usable scan, or lacks a topic asked for.
    """

    def __init__(self, path: str | Path, options: ReadOptions | None = None) -> None:
        super().__init__()
        self._path = Path(path)
        self._options = options or ReadOptions()
        self.name = short_name(self._path) or str(self._path)
        self.fingerprint = fingerprint(self._path)
        self._container, index = _best_index(open_containers(self._path), self._options)
        self._choice = choose_topics(index, self._options, str(self._path))
        self._damage = self._container.damage
        self._streams = self._choice.streams
        self._times, time_findings = common_times(self._streams)
        self.time_report: TimeReport = self._times[0].report
        self._messages = MergedMessages(self._container, self._streams, self._times)
        self._decoders = self._make_decoders()
        self.profiles = self._profile_scanners()
        findings = [
            *container_findings(self._container),
            *self._choice.findings,
            *index.findings,
            *stream_findings(index),
            *time_findings,
            *self._beam_findings(),
        ]
        findings.sort(key=lambda finding: _SEVERITY[finding.severity])
        self.inventory: Inventory = take_inventory(index, self._choice, findings)
        for finding in findings:
            self._found.add(finding.severity, f"{self.name}: {finding.line}", finding.code)
        num_scanners = len(self._choice.scanners)
        self.num_scans = sum(len(stream.stamps) for stream in self._streams[:num_scanners])

    @property
    def description(self) -> str:
        """Its topics, and which are used and why: some lines for the user."""
        return describe(self.inventory, self.profile)

    @property
    def profile(self) -> SensorProfile:
        """Properties of the main scanner, estimated from its scans."""
        return next(iter(self.profiles.values()))

    @property
    def duration(self) -> float:
        """Repaired time from the first to the last event [s]."""
        ends = [(float(t.times[0]), float(t.times[-1])) for t in self._times if len(t.times)]
        return max(last for _, last in ends) - min(first for first, _ in ends) if ends else 0.0

    def _events(self, problems: ProblemLog) -> EventGenerator:
        """Yield the events in the order of their times; bad messages are skipped and counted.

        Raises
        ------
        InputError
            No scan at all can be used.
        """
        num_scans = 0
        is_scanner = [stream.role in ("scan", "cloud") for stream in self._streams]
        decoders = self._decoders
        for owner, (raw, stamp, time) in self._messages.in_order(problems):
            try:
                event = decoders[owner](raw, stamp, time)
            except DecodeError as error:
                place = f"{self.name}: {self._streams[owner].topic}: stamp {stamp:.6f}: {error}"
                problems.skip(str(error), place, is_scan=is_scanner[owner])
                continue
            num_scans += is_scanner[owner]
            yield event
        if self._container.damage and self._container.damage != self._damage:
            problems.add("error", f"{self.name}: {self._container.damage}; the rest is missing")
        if num_scans == 0:
            why = ", ".join(sorted(problems.skipped)) or "none can be read"
            raise InputError(
                f"{self._path}: no scan of {self._streams[0].topic} can be used ({why}); "
                "check how it was recorded"
            )

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
                decoders.append(odometry.decode_pose)
        if choice.imu is not None:
            decoders.append(ImuDecoder(choice.imu).decode)
        return decoders

    def _profile_scanners(self) -> dict[str, SensorProfile]:
        """Return each scanner's profile, estimated from the sample of its scans."""
        profiles = {}
        choice = self._choice
        for number, scanner in enumerate(choice.scanners):
            stream = scanner.stream
            if stream.role == "cloud":
                profile = cloud_profile(stream)
            else:
                profile = scan_profile(self._scan_decoders[number], stream, str(self._path))
            period = self._times[number].report.period
            profiles[stream.topic] = replace(
                profile,
                rate=1.0 / period if len(stream.stamps) > 1 and period > 0.0 else 0.0,
                has_odometry=choice.odometry is not None,
                has_imu=choice.imu is not None,
            )
            if stream.role == "scan":
                self._scan_decoders[number].use_profile(profiles[stream.topic])
        return profiles

    def _beam_findings(self) -> list[BagFinding]:
        scanners = zip(self._streams, self._scan_decoders, strict=False)
        return [finding for pair in scanners for finding in beam_findings(*pair)]


def inspect_recording(
    path: str | Path, options: ReadOptions | None = None
) -> tuple[Inventory, BagLog | None]:
    """Return the contents of a ROS recording, and its log if it can be mapped.

    Where it cannot be mapped, the first of the findings is an error of code ``unusable`` with
    the reason; no topic is chosen then.

    Raises
    ------
    InputError
        The recording cannot be read at all.
    """
    try:
        log = BagLog(path, options)
    except InputError as error:
        _, index = _best_index(open_containers(Path(path)), options or ReadOptions())
        findings = [
            BagFinding("error", "unusable", str(error)),
            *container_findings(index.container),
            *index.findings,
            *stream_findings(index),
        ]
        return take_inventory(index, TopicChoice(), findings), None
    return log.inventory, log


def _best_index(
    containers: Iterable[Container], options: ReadOptions
) -> tuple[Container, RecordingIndex]:
    """Return the reader that finds the most messages in a recording, and its index."""
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
