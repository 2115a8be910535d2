# SPDX-License-Identifier: Apache-2.0
"""Topics of ROS 2 over DDS, without a ROS installation; needs the extra ``dds``."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from functools import partial
from threading import Event
from typing import Any, TypeAlias

from cartoloop.errors import InputError
from cartoloop.live.messages import MessageError
from cartoloop.live.notices import Notices
from cartoloop.live.ros_messages import RosParser
from cartoloop.live.source import POLL_S, Put
from cartoloop.readers.read_options import NO_TOPIC
from cartoloop.readers.ros import raw_messages as ros

MAX_TOPICS = 32
"""Topics that are read; a robot has a few scanners."""

DEPTH = 16
"""Messages of a topic that may wait until they are read: those of 0.3 s at 50 Hz."""

LOOPBACK_ONLY = (
    "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name='lo'/></Interfaces>"
    "</General></Domain></CycloneDDS>"
)

_ROS_PREFIX = "rt/"

Entity: TypeAlias = Any
"""An object of the library, which is not typed."""


class RawMessage(bytes):
    """The bytes of a message; the library sets attributes on it."""


class _AsBytes:
    """A message type that the library does not decode."""

    @staticmethod
    def deserialize(data: bytes) -> RawMessage:
        """Return the bytes."""
        return RawMessage(data)

    @staticmethod
    def deserialize_key(data: bytes) -> RawMessage:
        """Return the bytes."""
        return RawMessage(data)


class Ros2Source:
    """Scans, clouds, odometry and IMU readings of the topics of one domain.

    Parameters
    ----------
    domain : number of the domain; None: that of ROS_DOMAIN_ID, or 0.
    scan_topics : scanners to use; all by default.
    odom_topic, imu_topic : by default the first that appears; ``none`` to map without.
    """

    def __init__(
        self,
        domain: int | None = None,
        scan_topics: Sequence[str] = (),
        odom_topic: str | None = None,
        imu_topic: str | None = None,
    ) -> None:
        given = os.environ.get("ROS_DOMAIN_ID", "0")
        self._domain = domain if domain is not None else int(given) if given.isdecimal() else 0
        self._scans = [topic.strip("/") for topic in scan_topics]
        self._one = {ros.ODOMETRY: odom_topic, ros.IMU: imu_topic}
        self._readers: list[tuple[str, str, Entity]] = []
        self._topics: set[str] = set()
        self._participant: Entity = None
        self.name = f"ros2:{self._domain}"

    def open(self) -> str:
        """Join the domain.

        Raises
        ------
        InputError
            The extra ``dds`` is not installed, or there is no network to join.
        """
        try:
            from cyclonedds.core import DDSException
            from cyclonedds.domain import DomainParticipant
        except ImportError as error:
            raise InputError(
                f"{self.name}: ROS 2 topics need CycloneDDS, which is not installed ({error}); "
                "pip install 'cartoloop[dds]'"
            ) from error
        if os.environ.get("ROS_LOCALHOST_ONLY") == "1":
            os.environ.setdefault("CYCLONEDDS_URI", LOOPBACK_ONLY)
        try:
            self._participant = DomainParticipant(self._domain)
        except DDSException as error:
            raise InputError(
                f"{self.name}: the domain cannot be joined ({error}); check the network, "
                "ROS_DOMAIN_ID and CYCLONEDDS_URI"
            ) from error
        return f"waiting for topics of ROS 2 in domain {self._domain}"

    def run(self, put: Put, notices: Notices, stop: Event) -> None:
        """Pass on messages until `stop` is set."""
        from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
        from cyclonedds.core import Policy, Qos, WaitSet
        from cyclonedds.util import duration

        parser = RosParser(notices)
        waiting = WaitSet(self._participant)
        fixed = Qos(
            Policy.Reliability.Reliable(duration(seconds=1)),
            Policy.Durability.TransientLocal,
            Policy.History.KeepLast(100),
        )
        from cartoloop.live.dds_types import TFMessage

        transforms = self._reader("tf_static", TFMessage, fixed, waiting)
        announced = BuiltinDataReader(self._participant, BuiltinTopicDcpsPublication)
        while not stop.is_set():
            for publication in announced.take(100):
                self._consider(publication.topic_name, publication.type_name, waiting, notices)
            waiting.wait(duration(milliseconds=round(1e3 * POLL_S)))
            for raw in _messages(transforms, 100):
                _survive(partial(parser.add_transforms, raw), notices)
            for topic, msgtype, reader in self._readers:
                for raw in sensor_messages(topic, reader, notices):
                    _survive(partial(_hand_on, parser, topic, msgtype, raw, put), notices)

    def _consider(self, name: str, type_name: str, waiting: Entity, notices: Notices) -> None:
        """Subscribe to an announced topic, if it is wanted."""
        from cyclonedds.core import Policy, Qos

        from cartoloop.live.dds_types import SENSOR_TYPES

        types = {found.__idl_typename__.replace(".", "::"): found for found in SENSOR_TYPES}
        found = types.get(type_name)
        if found is None or not name.startswith(_ROS_PREFIX) or name in self._topics:
            return
        topic, msgtype = name.removeprefix(_ROS_PREFIX), type_name.replace("::dds_", "")
        msgtype = msgtype.removesuffix("_").replace("::", "/")
        if not self._is_wanted(topic, msgtype):
            return
        if len(self._topics) >= MAX_TOPICS:
            notices.note("topic left out", f"/{topic}: {MAX_TOPICS} topics are read already")
            return
        self._topics.add(name)
        # Best effort is compatible with all publishers, and late scans are of no use.
        sensor = Qos(
            Policy.Reliability.BestEffort,
            Policy.Durability.Volatile,
            Policy.History.KeepLast(DEPTH),
        )
        self._readers.append((f"/{topic}", msgtype, self._reader(topic, found, sensor, waiting)))
        notices.say(f"/{topic} ({msgtype.rpartition('/')[2]})")

    def _is_wanted(self, topic: str, msgtype: str) -> bool:
        if msgtype in self._one:
            named = self._one[msgtype]
            if named is not None:
                return named != NO_TOPIC and named.strip("/") == topic
            return all(other != msgtype for _, other, _ in self._readers)
        return not self._scans or topic in self._scans

    def _reader(self, topic: str, datatype: Entity, qos: Entity, waiting: Entity) -> Entity:
        from cyclonedds.core import InstanceState, ReadCondition, SampleState, ViewState
        from cyclonedds.sub import DataReader
        from cyclonedds.topic import Topic

        described = Topic(self._participant, _ROS_PREFIX + topic, datatype, qos=qos)
        described.data_type = _AsBytes
        reader = DataReader(self._participant, described, qos=qos)
        unread = SampleState.NotRead | ViewState.Any | InstanceState.Any
        waiting.attach(ReadCondition(reader, unread))
        return reader


def sensor_messages(topic: str, reader: Entity, notices: Notices) -> list[bytes]:
    """Return the messages received, and report if that are all that a reader keeps."""
    messages = _messages(reader, DEPTH)
    if len(messages) == DEPTH:
        notices.note(
            "messages of ROS 2 came faster than they were read",
            f"{topic}: messages came faster than they were read; some may be lost",
        )
    return messages


def _messages(reader: Entity, most: int) -> list[bytes]:
    """Return the messages received; notices that a publisher left are of another type."""
    return [sample for sample in reader.take(most) if isinstance(sample, RawMessage)]


def _hand_on(parser: RosParser, topic: str, msgtype: str, raw: bytes, put: Put) -> None:
    if (message := parser.parse(topic, msgtype, raw)) is not None:
        put(message)


def _survive(task: Callable[[], None], notices: Notices) -> None:
    """Run a task with a message, and report it if the message cannot be used."""
    try:
        task()
    except MessageError as error:
        notices.skip(f"message skipped: {error.reason}", f"message skipped: {error}")
