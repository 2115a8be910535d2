# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cartoloop.readers.ros.transforms import Pose3, TransformTree
from cartoloop.sensor.pose import Pose

angles = st.floats(-3.1, 3.1)
poses = st.builds(
    lambda x, y, z, r, p, w: Pose3.from_rpy((x, y, z), r, p, w),
    *[st.floats(-5, 5)] * 3,
    angles,
    st.floats(-1.5, 1.5),
    angles,
)


def same(a, b):
    np.testing.assert_allclose(a.rotation, b.rotation, atol=1e-9)
    np.testing.assert_allclose(a.translation, b.translation, atol=1e-9)


@given(poses, poses, poses)
def test_poses_compose_and_invert(a, b, c):
    same((a @ b) @ c, a @ (b @ c))
    same(a @ a.inverse(), Pose3.identity())


@given(poses)
def test_roll_pitch_and_yaw_make_the_rotation_again(pose):
    same(Pose3.from_rpy(tuple(pose.translation), *pose.rpy), pose)


def test_a_quaternion_turns_as_its_axis_and_angle_say():
    half = math.radians(45.0)
    q = (0.0, 0.0, 2.0 * math.sin(half), 2.0 * math.cos(half))  # of any length
    pose = Pose3.from_quaternion((1.0, 2.0, 3.0), q)
    np.testing.assert_allclose(pose.rotation @ [1, 0, 0], [0, 1, 0], atol=1e-12)
    assert pose.plane == pytest.approx(Pose(1.0, 2.0, math.pi / 2))


@pytest.mark.parametrize("q", [(0, 0, 0, 0), (math.nan, 0, 0, 1), (math.inf, 0, 0, 1)])
def test_a_quaternion_that_is_none_is_refused(q):
    with pytest.raises(ValueError, match="no pose"):
        Pose3.from_quaternion((0, 0, 0), q)


def test_looking_straight_down_keeps_the_rotation():
    pose = Pose3.from_rpy((0, 0, 0), 0.3, math.pi / 2, 1.0)
    same(Pose3.from_rpy((0, 0, 0), *pose.rpy), pose)


@given(poses, poses, poses)
def test_lookup_goes_up_and_down_the_tree(a, b, c):
    tree = TransformTree()
    tree.add("base", "arm", a, "tf_static")
    tree.add("arm", "laser", b, "tf_static")
    tree.add("base", "imu", c, "tf_static")
    pose, transforms = tree.lookup("imu", "laser")
    same(pose, c.inverse() @ a @ b)
    assert {t.child for t in transforms} == {"arm", "laser", "imu"}
    assert tree.lookup("base", "elsewhere") is None
    same(tree.lookup("laser", "laser")[0], Pose3.identity())


def test_the_first_parent_is_believed_and_loops_are_refused():
    tree = TransformTree()
    one = Pose3.identity()
    assert tree.add("base", "laser", one, "tf_static")
    assert tree.add("other", "laser", one, "tf") is None
    assert tree.add("laser", "base", one, "tf") is None
    assert tree.add("x", "x", one, "tf") is None
    assert tree.transforms["laser"].parent == "base"
    assert tree.conflicts == {"laser": {"other"}}
    assert tree.above("laser") == ["laser", "base"]


def test_how_far_a_transform_moves_is_kept():
    tree = TransformTree()
    for x in (0.0, 0.0, 0.3, 0.1):
        tree.add_sent("base", "laser", (x, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0), "tf")
    transform = tree.transforms["laser"]
    assert transform.count == 4
    assert transform.moved_m == pytest.approx(0.3)
    assert transform.moves
    assert transform.pose.translation[0] == 0.0
