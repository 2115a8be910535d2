# SPDX-License-Identifier: Apache-2.0
import math

import pytest

from cartoloop.local_slam.moving_gain import ALL_BY_REST, Explained
from cartoloop.local_slam.odometry_rest import BEFORE_S, NUM_GAINS, OdometryRest, is_at_rest
from cartoloop.local_slam.odometry_window import Evidence
from cartoloop.sensor.pose import IDENTITY, Pose


def after_driving(speeds, period=0.2):
    rest = OdometryRest()
    for number, speed in enumerate(speeds):
        step = Pose(speed * period, 0.5 * speed * period, 0.01)
        rest.move(number * period, (number + 1) * period, step)
    return rest, len(speeds) * period


def test_the_speed_before_a_rest_is_that_of_its_last_second():
    rest, now = after_driving([5.0] * 10 + [0.4] * round(BEFORE_S / 0.2 + 1))
    rest.begin(now, now + 0.2)
    assert rest.since == pytest.approx(now + 0.2)
    assert rest.velocity_before == pytest.approx((0.4, 0.2))


def test_odometry_may_have_stopped_within_its_last_step():
    rest, now = after_driving([0.4] * 5)
    rest.begin(now, now + 0.2)
    assert rest.driven_until == pytest.approx(now - 0.2)


def test_the_last_step_may_be_of_another_scanner():
    rest, now = after_driving([0.4] * 5)
    rest.move(now - 0.1, now + 0.1, Pose(0.04, 0.0, 0.0))
    rest.begin(now, now + 0.2)
    assert rest.driven_until == pytest.approx(now - 0.1)


def test_steps_before_a_gap_do_not_reach_a_rest():
    rest, now = after_driving([0.4] * 5)
    rest.begin(now + 3.0, now + 3.2)
    assert rest.driven_until == pytest.approx(now + 3.0)


def test_a_rest_lasts_from_its_first_scan_to_the_next_motion():
    rest, now = after_driving([0.4] * 5)
    rest.begin(now, now + 0.2)
    rest.begin(now + 0.2, now + 0.4)
    assert rest.since == pytest.approx(now + 0.2)
    rest.move(now + 0.4, now + 0.6, Pose(0.1, 0.0, 0.0))
    assert rest.since == math.inf


def test_a_robot_that_never_drove_has_no_speed():
    rest = OdometryRest()
    rest.begin(0.8, 1.0)
    assert rest.velocity_before == (0.0, 0.0)


def test_gains_are_averaged_over_the_latest_scans_of_a_rest():
    rest, now = after_driving([0.4] * 5)
    rest.begin(now - 0.2, now)
    assert rest.mean_gain(0.3) == pytest.approx(0.3)
    assert rest.mean_gain(0.1) == pytest.approx(0.2)
    assert [rest.mean_gain(0.0) for _ in range(NUM_GAINS)][-1] == 0.0
    rest.move(now, now + 0.2, Pose(0.1, 0.0, 0.0))
    rest.begin(now + 0.2, now + 0.4)
    assert rest.mean_gain(0.2) == pytest.approx(0.2)


def evidence(better, changed=0.0):
    """What a scan shows, if the motion before explains this share more of it than rest does."""
    explained = Explained(0.9, 0.9 + better, 0.9 + max(better, 0.0))
    return Evidence(True, 0.0, lambda _: 0.0, lambda: 0.0, lambda _: changed, lambda *_: explained)


def rest_through(rest, now, better, scans=8, changed=0.0):
    """Return whether odometry that rests is found to miss a motion, scan by scan, until it ends."""
    found = []
    for k in range(scans):
        begin, end = now + 0.2 * k, now + 0.2 * (k + 1)
        found.append(rest.misses_motion(begin, end, IDENTITY, evidence(better, changed)))
    rest.move(end, end + 0.2, Pose(0.08, 0.0, 0.0))
    return found


def driving():
    return after_driving([0.4] * 10)


def test_along_bare_walls_the_motion_before_must_explain_more():
    assert not any(rest_through(*driving(), 0.0))
    assert not any(rest_through(*driving(), -0.05))
    found = rest_through(*driving(), 0.03)
    assert found == [False] * found.index(True) + [True] * (8 - found.index(True))


def test_scans_that_show_nothing_are_no_proof_of_rest():
    rest, now = driving()
    unknown = evidence(0.0)._replace(explained=lambda *_: ALL_BY_REST)
    for k in range(10):
        shown = evidence(0.05) if k % 2 else unknown
        is_missed = rest.misses_motion(now + 0.2 * k, now + 0.2 * (k + 1), IDENTITY, shown)
    assert is_missed
    rest.move(now + 2.0, now + 2.2, Pose(0.08, 0.0, 0.0))
    assert (rest.num_missed, rest.num_rests) == (1, 0)


def test_a_robot_that_was_slow_may_have_stopped():
    assert not any(rest_through(*after_driving([0.05] * 10), 0.03))


@pytest.mark.parametrize(
    ("missed", "real", "is_missed"), [(3, 3, True), (2, 0, False), (3, 4, False)]
)
def test_rests_that_scans_show_decide_where_they_show_nothing(missed, real, is_missed):
    rest, now = driving()
    for better in [0.05] * missed + [-0.05] * real:
        rest_through(rest, now, better)
        now += 2.0
    assert (rest.num_missed, rest.num_rests) == (missed, real)
    assert any(rest_through(rest, now, 0.0)) == is_missed
    assert not any(rest_through(rest, now + 2.0, -0.05))


def test_noise_of_the_heading_is_no_motion():
    assert is_at_rest(Pose(0.0, 0.0, 0.003))
    assert not is_at_rest(Pose(0.001, 0.0, 0.0))
    assert not is_at_rest(Pose(0.0, 0.0, 0.02))
