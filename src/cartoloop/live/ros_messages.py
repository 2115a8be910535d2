# SPDX-License-Identifier: Apache-2.0
"""The bytes of ROS 2 messages into messages of a live source."""

from __future__ import annotations

import math
from time import monotonic

from cartoloop.live.messages import MessageError
from cartoloop.live.notices import Notices
from cartoloop.readers.read_options import ReadOptions
from cartoloop.readers.ros import raw_messages as ros
from cartoloop.readers.ros.choice import BASE_FRAMES, ScannerChoice
from cartoloop.readers.ros.decoders import CloudDecoder, ImuDecoder, OdometryDecoder, ScanDecoder
from cartoloop.readers.ros.imu_choice import ImuChoice
from cartoloop.readers.ros.index import Role, TopicStream
from cartoloop.readers.ros.odometry_choice import OdometryChoice
from cartoloop.readers.ros.transforms import Pose3, TransformTree
from cartoloop.readers.ros.wire import NANO, DecodeError, frame_name, read_header
from cartoloop.sensor.events import SensorEvent

TRANSFORM_WAIT_S = 1.0
"""A sensor's messages are left out this long while its mounting pose is not known [s]; afterwards
it is assumed to be at the robot's centre. /tf_static arrives within some 0.1 s of joining."""

_ROLES: dict[str, Role] = {
    ros.LASER_SCAN: "scan",
    ros.POINT_CLOUD: "cloud",
    ros.IMU: "imu",
    ros.ODOMETRY: "odometry",
}

Decoder = ScanDecoder | CloudDecoder | OdometryDecoder | ImuDecoder


class RosParser:
    """Decodes messages, and keeps the transforms with the mounting poses of the sensors.

    Parameters
    ----------
    notices : receives a line for each sensor whose mounting pose is not known, and counts the
        messages that are left out until then.
    """

    def __init__(self, notices: Notices) -> None:
        self._notices = notices
        self._tree = TransformTree()
        self._odometry_child = ""
        self._decoders: dict[tuple[str, str], Decoder] = {}
        self._since: dict[tuple[str, str], float] = {}

    def add_transforms(self, raw: bytes) -> None:
        """Take in a tf2_msgs/TFMessage of fixed transforms.

        Raises
        ------
        MessageError
            It cannot be used.
        """
        try:
            for transform in ros.decode_transforms(raw, is_ros1=False):
                self._tree.add_sent(
                    transform.parent, transform.child, transform.values, "tf_static"
                )
        except (DecodeError, ValueError) as error:
            raise MessageError("unusable transform", f"/tf_static: {error}") from None

    def parse(self, topic: str, msgtype: str, raw: bytes) -> SensorEvent | None:
        """Return the event in a message of a topic; None while the sensor's pose is awaited.

        Raises
        ------
        MessageError
            It cannot be used.
        """
        try:
            header = read_header(raw, is_ros1=False)
            frame = frame_name(header.frame)
            if msgtype == ros.ODOMETRY:
                frame = ros.decode_odometry(raw, is_ros1=False).child or frame
                self._odometry_child = frame
            decoder = self._decoder(topic, msgtype, frame)
            if decoder is None:
                self._notices.skip(
                    "message skipped: pose of its sensor not known yet",
                    f"{topic}: messages are skipped until /tf_static gives its pose on the robot",
                )
                return None
            return decoder.decode(raw, header.stamp / NANO, math.nan)
        except DecodeError as error:
            raise MessageError(str(error), f"{topic}: {error}") from None

    def _decoder(self, topic: str, msgtype: str, frame: str) -> Decoder | None:
        key = topic, frame
        if (decoder := self._decoders.get(key)) is not None:
            return decoder
        pose = self._pose_of(frame)
        if pose is None:
            if msgtype == ros.ODOMETRY:
                pose = Pose3.identity()
            elif (now := monotonic()) - self._since.setdefault(key, now) < TRANSFORM_WAIT_S:
                return None
            else:
                pose = Pose3.identity()
                self._notices.say(
                    f"{topic}: /tf_static has no pose of {frame or 'its frame'} on the robot; it "
                    "is assumed to be at the robot's centre, or give --laser-pose X,Y,YAW"
                )
        stream = TopicStream(topic, msgtype, _ROLES[msgtype], is_ros1=False)
        match msgtype:
            case ros.LASER_SCAN:
                decoder = ScanDecoder(ScannerChoice(stream, pose), ReadOptions())
            case ros.POINT_CLOUD:
                decoder = CloudDecoder(ScannerChoice(stream, pose))
            case ros.ODOMETRY:
                decoder = OdometryDecoder(OdometryChoice(stream, pose.inverse()))
            case _:
                decoder = ImuDecoder(ImuChoice(stream, pose, 1.0))
        self._decoders[key] = decoder
        return decoder

    def _pose_of(self, frame: str) -> Pose3 | None:
        """Return a frame's pose in the robot's frame, None if it is not known."""
        bases = [base for base in BASE_FRAMES if base in self._tree.frames]
        for base in [*bases, self._odometry_child]:
            if base and (found := self._tree.lookup(base, frame)) is not None:
                return found[0]
            if base == frame:
                return Pose3.identity()
        return None
