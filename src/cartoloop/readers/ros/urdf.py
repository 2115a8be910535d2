# SPDX-License-Identifier: Apache-2.0
"""Fixed joints of a robot description (URDF): the mounting poses of its sensors."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from cartoloop.errors import InputError
from cartoloop.input_file import read_input
from cartoloop.plain_text import one_line
from cartoloop.readers.ros.transforms import Pose3

_MAX_BYTES = 16 << 20
"""Larger files are no robot descriptions [bytes]: meshes are files of their own."""


class FixedJoint(NamedTuple):
    """The pose of the link `child` in the link `parent`."""

    parent: str
    child: str
    pose: Pose3


def read_urdf(path: Path) -> list[FixedJoint]:
    """Return the fixed joints of a URDF file.

    Raises
    ------
    InputError
        The file cannot be read or is not a URDF file.
    """
    return parse_urdf(read_input(path, _MAX_BYTES, "a robot's description"), str(path))


def parse_urdf(text: bytes, name: str) -> list[FixedJoint]:
    """Return the fixed joints of a robot's description; `name` identifies it in messages.

    Raises
    ------
    InputError
        It is not a URDF file.
    """
    # No URDF file has a document type; XML entities are a known attack on parsers. Nor is it in
    # an encoding with zeros, in which a document type would not be seen.
    if b"\x00" in text:
        raise InputError(f"{name}: is no URDF (it is binary); give the robot's description")
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
        raise InputError(f"{name}: declares XML entities, which are not read; remove them")
    if b"<xacro:" in text:
        raise InputError(f"{name}: is a xacro file; expand it first: xacro FILE > robot.urdf")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise InputError(f"{name}: is no URDF ({error}); give the robot's description") from None
    if root.tag != "robot":
        raise InputError(f"{name}: is no URDF (it holds no <robot>); give the robot's description")
    return [_joint(joint, name) for joint in root.findall("joint") if joint.get("type") == "fixed"]


def _joint(joint: ElementTree.Element, name: str) -> FixedJoint:
    parent, child, origin = joint.find("parent"), joint.find("child"), joint.find("origin")
    above = one_line(parent.get("link", "")) if parent is not None else ""
    below = one_line(child.get("link", "")) if child is not None else ""
    what = f"{name}: joint {joint.get('name', '?')!r}"
    if not (above and below):
        raise InputError(f"{what} names no parent or child link; correct it")
    xyz, rpy = "0 0 0", "0 0 0"
    if origin is not None:
        xyz, rpy = origin.get("xyz", xyz), origin.get("rpy", rpy)
    return FixedJoint(above, below, Pose3.from_rpy(_three(xyz, what), *_three(rpy, what)))


def _three(text: str, what: str) -> tuple[float, float, float]:
    try:
        x, y, z = (float(word) for word in text.split())
    except ValueError:
        raise InputError(f"{what}: {text!r} are not three numbers; correct it") from None
    if not all(abs(value) < 1e6 for value in (x, y, z)):
        raise InputError(f"{what}: {text!r} are not three finite numbers; correct it")
    return x, y, z
