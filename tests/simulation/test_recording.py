# SPDX-License-Identifier: Apache-2.0
import gzip
import math
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from cartoloop.errors import ConfigError, OutputError
from cartoloop.readers import open_log
from cartoloop.sensor.events import LaserScan, Odometry
from cartoloop.sensor.pose import Pose, compose, relative
from cartoloop.simulation import LIDARS, Lidar, OdometryModel, make_world, simulate
from cartoloop.simulation.truth_files import relation_pairs
from tests.reference.naive_wall_ranges import naive_wall_ranges

RING = make_world("ring")
SMALL = replace(LIDARS["sick-180"], rate=2.0)


@pytest.fixture(scope="module")
def recording():
    return simulate(RING, SMALL, seed=3, duration=20.0)


def fields(line):
    """The numbers of a FLASER line: ranges, first pose, second pose, stamp."""
    tokens = line.split()
    count = int(tokens[1])
    numbers = [float(token) for token in tokens[2 : 2 + count + 6]]
    return numbers[:count], numbers[count : count + 3], numbers[count + 3 :], float(tokens[-3])


def lines_of(path):
    content = path.read_bytes()
    return (gzip.decompress(content) if path.suffix == ".gz" else content).decode().splitlines()


def test_a_recording_holds_a_row_for_each_scan(recording):
    assert recording.ranges.shape == (41, 180)
    assert recording.true_poses.shape == recording.odometry_poses.shape == (41, 3)
    assert np.diff(recording.stamps) == pytest.approx(np.full(40, 0.5), abs=1e-6)


def test_scans_are_taken_exactly_at_the_true_poses():
    exact = replace(SMALL, range_noise=0.0, dropout=0.0, range_quantum=0.0)
    recording = simulate(RING, exact, duration=10.0)
    expected = naive_wall_ranges(
        RING.walls, recording.true_poses, exact.geometry.angles, exact.range_max
    )
    expected[np.isinf(expected)] = exact.no_return
    assert recording.ranges == pytest.approx(expected, abs=1e-9)


def test_only_the_same_seed_gives_the_same_recording(recording):
    same, other = (simulate(RING, SMALL, seed=seed, duration=20.0) for seed in (3, 4))
    assert np.array_equal(recording.ranges, same.ranges)
    assert np.array_equal(recording.odometry_poses, same.odometry_poses)
    assert not np.array_equal(recording.ranges, other.ranges)


def test_another_odometry_leaves_the_scans_alone(recording):
    other = simulate(RING, SMALL, OdometryModel(drift_noise=0.1), seed=3, duration=20.0)
    assert np.array_equal(recording.ranges, other.ranges)
    assert not np.array_equal(recording.odometry_poses, other.odometry_poses)


def test_a_longer_recording_stands_at_the_end_of_the_route():
    still = replace(RING, route=RING.route[:1])
    recording = simulate(still, SMALL, duration=3.0)
    assert len(recording.stamps) == 7
    assert np.ptp(recording.true_poses, axis=0).tolist() == [0.0, 0.0, 0.0]


def test_a_negative_duration_is_refused():
    with pytest.raises(ConfigError, match="duration"):
        simulate(RING, SMALL, duration=-1.0)


@pytest.mark.parametrize("size", [1, 7, 40, 41, 1000])
def test_ranges_do_not_depend_on_the_block_size(recording, size):
    firsts, blocks = zip(*recording.range_blocks(size), strict=True)
    assert list(firsts) == list(range(0, 41, size))
    assert np.array_equal(np.vstack(blocks), recording.ranges)


def test_neither_a_log_nor_events_keep_ranges_in_memory(tmp_path):
    recording = simulate(RING, SMALL, duration=5.0)
    recording.write_carmen(tmp_path / "log.clf")
    assert sum(isinstance(event, LaserScan) for event in recording.events()) == 11
    assert "ranges" not in vars(recording)


@pytest.mark.parametrize("mount", [Pose(0.0, 0.0, 0.0), Pose(0.2, -0.1, 0.3)])
@pytest.mark.parametrize("name", ["backpack", "sick-180"])
def test_a_log_without_odometry_reads_back_as_scans_alone(tmp_path, name, mount):
    lidar = replace(LIDARS[name], tf_tracking_sensor=mount)
    recording = simulate(RING, lidar, seed=2, duration=4.0, with_odometry=False)
    recording.write_carmen(tmp_path / "log.clf")
    log = open_log(tmp_path / "log.clf")
    events = list(log)
    assert not log.profile.has_odometry
    assert all(isinstance(event, LaserScan) for event in events)
    assert [event.stamp for event in events] == recording.stamps.tolist()
    assert np.array_equal([event.ranges for event in events], recording.ranges)
    geometry = events[0].geometry
    assert geometry.angles == pytest.approx(lidar.geometry.angles, abs=1e-6)
    assert geometry.tf_tracking_sensor == pytest.approx(mount, abs=1e-6)


def test_worlds_have_a_scanner_and_odometry_by_default():
    flat = make_world("flat")
    carried = simulate(flat, duration=3.0)
    assert carried.lidar is LIDARS["lds"]
    assert {type(event) for event in carried.events()} == {LaserScan}
    wheeled = simulate(flat, LIDARS["sick"], with_odometry=True, duration=3.0)
    assert wheeled.ranges.shape == (16, 361)
    assert isinstance(next(wheeled.events()), Odometry)
    assert isinstance(next(wheeled.events(with_odometry=False)), LaserScan)


def test_tape_lines_are_written_in_the_frame_of_the_first_scan(tmp_path):
    recording = simulate(make_world("flat"), duration=1.0)
    recording.write_tape_lines(tmp_path / "flat.lines")
    rows = np.loadtxt(tmp_path / "flat.lines")
    assert rows.shape == (len(recording.tape_lines), 5)
    first = Pose(*recording.true_poses[0])
    for row, line in zip(rows, recording.tape_lines, strict=True):
        back = [compose(first, Pose(*row[end : end + 2], 0.0))[:2] for end in (0, 2)]
        assert np.ravel(back) == pytest.approx(line, abs=1e-5)
        assert row[4] == pytest.approx(math.dist(line[:2], line[2:]), abs=1e-5)


def test_a_world_without_tape_lines_has_none_to_write(recording, tmp_path):
    with pytest.raises(ConfigError, match=r"'ring'.*flat"):
        recording.write_tape_lines(tmp_path / "ring.lines")


def test_events_are_odometry_and_scan_in_turn(recording):
    events = list(recording.events())
    assert len(events) == 82
    assert isinstance(events[0], Odometry)
    assert isinstance(events[1], LaserScan)
    assert events[2].tf_odom_tracking == Pose(*recording.odometry_poses[1])
    assert events[3].stamp == events[3].time == recording.stamps[1]
    assert np.array_equal(events[3].ranges, recording.ranges[1])
    assert events[1].geometry == SMALL.geometry
    assert all(isinstance(event, LaserScan) for event in recording.events(with_odometry=False))


@pytest.mark.parametrize("name", ["log.clf", "log.clf.gz"])
def test_the_log_has_ranges_odometry_and_stamps_but_no_truth(recording, tmp_path, name):
    recording.write_carmen(tmp_path / name)
    lines = lines_of(tmp_path / name)
    assert [line.split()[0] for line in lines[:4]] == ["#", "#", "PARAM", "PARAM"]
    assert "PARAM robot_front_laser_max 30.000000" in lines
    scans = [fields(line) for line in lines[4:]]
    assert len(scans) == 41
    for scan, (ranges, laser, robot, stamp) in enumerate(scans):
        assert ranges == recording.ranges[scan].tolist()
        assert laser == robot == pytest.approx(recording.odometry_poses[scan], abs=1e-6)
        assert stamp == recording.stamps[scan]
    assert list(tmp_path.iterdir()) == [tmp_path / name]


def test_a_scanner_of_other_angles_states_them(tmp_path):
    mount = Pose(0.2, -0.1, 0.3)
    lidar = replace(LIDARS["wide"], tf_tracking_sensor=mount)
    recording = simulate(RING, lidar, duration=0.5)
    recording.write_carmen(tmp_path / "log.clf")
    tokens = lines_of(tmp_path / "log.clf")[-1].split()
    assert tokens[0] == "ROBOTLASER1"
    start, field_of_view, increment, range_max = map(float, tokens[2:6])
    assert math.degrees(start) == pytest.approx(-135.0)
    assert math.degrees(field_of_view) == pytest.approx(270.0)
    assert math.degrees(increment) == pytest.approx(0.25)
    assert range_max == 30.0
    count = int(tokens[8])
    assert count == 1081
    assert int(tokens[9 + count]) == 0
    laser, robot = (
        Pose(*map(float, tokens[first : first + 3])) for first in (10 + count, 13 + count)
    )
    assert robot == pytest.approx(recording.odometry_poses[-1], abs=1e-6)
    assert laser == pytest.approx(compose(robot, mount), abs=2e-6)
    assert len(tokens) == 16 + count + 5 + 3


def test_the_number_of_range_decimals_is_a_choice(recording, tmp_path):
    recording.write_carmen(tmp_path / "log.clf", range_decimals=2)
    assert len(lines_of(tmp_path / "log.clf")[-1].split()[2].split(".")[1]) == 2


def test_the_same_recording_gives_the_same_bytes(recording, tmp_path):
    for name in ("one.log.gz", "two.log.gz"):
        recording.write_carmen(tmp_path / name)
    assert (tmp_path / "one.log.gz").read_bytes() == (tmp_path / "two.log.gz").read_bytes()


def test_the_truth_is_a_tum_trajectory(recording, tmp_path):
    recording.write_truth(tmp_path / "truth.tum")
    rows = np.loadtxt(tmp_path / "truth.tum")
    assert np.array_equal(rows[:, 0], recording.stamps)
    assert rows[:, 1:3] == pytest.approx(recording.true_poses[:, :2], abs=1e-8)
    assert not rows[:, 3:6].any()
    headings = 2 * np.arctan2(rows[:, 6], rows[:, 7])
    assert np.cos(headings - recording.true_poses[:, 2]) == pytest.approx(np.ones(41))


def test_relations_are_true_and_join_neighbours_and_loops(tmp_path):
    recording = simulate(RING, replace(SMALL, num_beams=2))
    recording.write_relations(tmp_path / "ring.relations", num_relations=60)
    rows = np.loadtxt(tmp_path / "ring.relations")
    assert rows.shape == (60, 8)
    scan_of = {stamp: scan for scan, stamp in enumerate(recording.stamps.tolist())}
    gaps = []
    for stamp_1, stamp_2, x, y, *_, theta in rows.tolist():
        one, two = scan_of[stamp_1], scan_of[stamp_2]
        truth = relative(Pose(*recording.true_poses[one]), Pose(*recording.true_poses[two]))
        assert (x, y, theta) == pytest.approx(truth, abs=1e-8)
        gaps.append(stamp_2 - stamp_1)
    assert min(gaps) > 0.0
    assert sum(gap > 60.0 for gap in gaps) == 30


def test_a_robot_that_stands_has_no_relations():
    assert relation_pairs(np.zeros((9, 3)), 10).shape == (0, 2)


def test_an_unwritable_path_is_an_error_and_leaves_no_file(recording, tmp_path):
    with pytest.raises(OutputError, match=r"nowhere.*No such file"):
        recording.write_truth(tmp_path / "nowhere" / "truth.tum")
    (tmp_path / "folder.log").mkdir()
    with pytest.raises(OutputError, match=r"folder\.log"):
        recording.write_carmen(tmp_path / "folder.log")
    assert list(tmp_path.iterdir()) == [tmp_path / "folder.log"]


def test_importing_the_simulation_loads_no_compiler():
    code = "import sys, cartoloop.simulation as s; s.drive; print('numba' in sys.modules)"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert shown.stdout.strip() == "False"


def test_the_default_scanner_sees_the_office():
    recording = simulate(make_world("office"), duration=4.0)
    returned = recording.ranges < Lidar().range_max
    assert recording.ranges.shape == (21, 361)
    assert returned.mean() > 0.95
