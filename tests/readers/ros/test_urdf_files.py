# SPDX-License-Identifier: Apache-2.0
import math

import pytest

from cartoloop.errors import InputError
from cartoloop.readers.ros.urdf import parse_urdf, read_urdf

ROBOT = b"""<?xml version="1.0"?>
<robot name="r">
  <link name="base_link"/><link name="laser"/><link name="wheel"/>
  <joint name="a" type="fixed"><parent link="base_link"/><child link="laser"/>
    <origin xyz="0.1 -0.2 0.3" rpy="3.141592653589793 0 1.5"/></joint>
  <joint name="b" type="continuous"><parent link="base_link"/><child link="wheel"/></joint>
  <joint name="c" type="fixed"><parent link="laser"/><child link="glass"/></joint>
</robot>"""


def test_fixed_joints_are_read_and_others_left_out(tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_bytes(ROBOT)
    joints = read_urdf(path)
    assert [(j.parent, j.child) for j in joints] == [("base_link", "laser"), ("laser", "glass")]
    assert joints[0].pose.translation.tolist() == [0.1, -0.2, 0.3]
    assert abs(joints[0].pose.rpy[0]) == pytest.approx(math.pi)
    assert joints[0].pose.rpy[2] == pytest.approx(1.5)
    assert joints[1].pose.rotation.tolist() == [[1, 0, 0], [0, 1, 0], [0, 0, 1]]


@pytest.mark.parametrize(
    ("text", "what"),
    [
        (b"<robot", "is no URDF"),
        (b"<sdf/>", "no <robot>"),
        (b'<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/passwd">]><robot>&a;</robot>', "entities"),
        ('<!DOCTYPE r [<!ENTITY a "b">]><robot>&a;</robot>'.encode("utf-16"), "is no URDF"),
        (b'<robot xmlns:xacro="x"><xacro:include filename="a"/></robot>', "expand it first"),
        (ROBOT.replace(b"0.1 -0.2 0.3", b"0.1 zero 0.3"), "three numbers"),
        (ROBOT.replace(b"0.1 -0.2 0.3", b"0.1 nan 0.3"), "finite"),
        (ROBOT.replace(b'<child link="laser"/>', b""), "no parent or child"),
    ],
)
def test_faults_are_reported_in_one_line(text, what):
    with pytest.raises(InputError, match=what) as caught:
        parse_urdf(text, "robot.urdf")
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_reported(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        read_urdf(tmp_path / "robot.urdf")
