# SPDX-License-Identifier: Apache-2.0
"""ROS 2 messages, as their bytes arrive, into messages of a live source."""

from __future__ import annotations

from time import monotonic

from cartoloop.live.messages import (
    CloudMessage,
    ImuMessage,
    MessageError,
    OdometryMessage,
    ScanMessage,
    SensorMessage,
)
from cartoloop.live.notices import Notices
from cartoloop.readers.options import ReadOptions
from cartoloop.readers.ros import messages as ros
from cartoloop.readers.ros.choice import BASE_FRAMES
from cartoloop.readers.ros.chosen import ImuChoice, OdometryChoice, ScannerChoice
from cartoloop.readers.ros.decoders import CloudDecoder, ImuDecoder, OdometryDecoder, ScanDecoder
from cartoloop.readers.ros.index import Stream
from cartoloop.readers.ros.inventory import Role
from cartoloop.readers.ros.transforms import Pose3, TransformTree
from cartoloop.readers.ros.wire import NANO, DecodeError, frame_name, read_header

TRANSFORM_WAIT_S = 1.0
"""So long a sensor's messages are left out until it is told where it sits [s]; later, it is taken
to sit at the robot's centre."""

_ROLES: dict[str, Role] = {
    ros.LASER_SCAN: "scan",
    ros.POINT_CLOUD: "cloud",
    ros.IMU: "imu",
    ros.ODOMETRY: "odometry",
}

Decoder = ScanDecoder | CloudDecoder | OdometryDecoder | ImuDecoder


class RosParser:
    """Decodes messages, and keeps the transforms that tell where the sensors sit.

    Parameters
    ----------
    notices : is told of sensors of which that is not known.
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
            raise MessageError("transform of no use", f"/tf_static: {error}") from None

    def parse(self, topic: str, msgtype: str, raw: bytes) -> SensorMessage | None:
        """Return what a message of a topic says; None as long as nobody knows where it was seen.

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
                return None
            stamp = header.stamp / NANO
            return _message(decoder, raw, stamp)
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
                    f"{topic}: /tf_static does not tell where {frame or 'its frame'} sits on the "
                    "robot; taken to be at its centre, or give --laser-pose X,Y,YAW"
                )
        stream = Stream(topic, msgtype, _ROLES[msgtype], is_ros1=False)
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
        """Return a frame's pose in the robot's, None if that is not told."""
        bases = [base for base in BASE_FRAMES if base in self._tree.frames]
        for base in [*bases, self._odometry_child]:
            if base and (found := self._tree.lookup(base, frame)) is not None:
                return found[0]
            if base == frame:
                return Pose3.identity()
        return None


def _message(decoder: Decoder, raw: bytes, stamp: float) -> SensorMessage:
    """Return a decoded message; raises `DecodeError`."""
    match decoder:
        case ScanDecoder():
            scan = decoder.decode(raw, stamp, stamp)
            return ScanMessage(stamp, scan.ranges, scan.geometry)
        case CloudDecoder():
            cloud = decoder.decode(raw, stamp, stamp)
            return CloudMessage(stamp, cloud.points, cloud.times, cloud.geometry)
        case OdometryDecoder():
            return OdometryMessage(stamp, decoder.decode(raw, stamp, stamp).tf_odom_tracking)
        case _:
            imu = decoder.decode(raw, stamp, stamp)
            return ImuMessage(stamp, imu.linear_acceleration, imu.angular_velocity)
