# SPDX-License-Identifier: Apache-2.0
"""Whole recordings, sound and damaged, are examined, whatever a file holds."""

import ast
import gzip
import json
import random
import re
from pathlib import Path

import numpy as np
import pytest

from cartoloop.doctor import examine
from cartoloop.doctor.calibration import choose_part
from cartoloop.doctor.document import document
from cartoloop.doctor.odometry import OdometryWatch
from cartoloop.doctor.text import render
from cartoloop.readers import ReadOptions
from cartoloop.sensor.events import Odometry
from cartoloop.sensor.pose import Pose
from cartoloop.simulation import ring, simulate
from tests.readers.ros.bag_files import FORMATS, START, BagMaker, drive, ranges_of

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "src/cartoloop"


@pytest.fixture(scope="module")
def good_log(tmp_path_factory):
    path = tmp_path_factory.mktemp("good") / "good.log"
    simulate(ring(), seed=2, duration=40.0).write_carmen(path)
    return path


def codes(examination):
    return {finding.code for finding in examination.findings}


def the(examination, code):
    return next(finding for finding in examination.findings if finding.code == code)


def changed(path, tmp_path, change):
    """Write the lines of a log, changed."""
    out = tmp_path / "changed.log"
    lines = path.read_text().splitlines()
    out.write_text("\n".join(change(lines)) + "\n")
    return out


def test_a_sound_log_has_no_findings(good_log):
    examination = examine(good_log)

    assert examination.can_be_mapped
    assert examination.findings == ()
    assert next((s.name, s.count, s.used) for s in examination.contents.streams) == (
        "FLASER",
        201,
        True,
    )
    assert examination.duration == pytest.approx(40.0)
    scanner = examination.scanners[0]
    assert scanner.watch.count == 201
    assert scanner.profile.num_beams == 361
    assert {c.what for c in examination.choices} >= {"scanner", "odometry", "ranges used", "times"}
    assert "findings: none" in render(examination)


def test_odometry_later_than_the_scans_is_measured(tmp_path):
    drive_ = simulate(ring(), seed=2, duration=80.0)
    path = tmp_path / "late.log"
    with path.open("w") as file:
        for event in drive_.events():
            if isinstance(event, Odometry):
                # What stands in the log at 10.0 s is where the robot was at 10.4 s.
                index = min(round((event.time - drive_.stamps[0]) * 5) + 2, 400)
                x, y, theta = drive_.odometry_poses[index]
                line = f"{x} {y} {theta} {x} {y} {theta} {event.stamp:.6f} host 0"
            else:
                ranges = " ".join(f"{r:.3f}" for r in event.ranges)
                print(f"FLASER {len(event.ranges)} {ranges} {line}", file=file)

    finding = the(examine(path), "odometry_offset")

    assert finding.severity == "warning"
    assert re.search(r"0\.(39|40|41) s newer", finding.message)


def test_a_scanner_upside_down_shows_in_the_turns(tmp_path):
    path = tmp_path / "upright.log"
    simulate(ring(), seed=2, duration=250.0).write_carmen(path)

    def reverse(lines):
        for line in lines:
            words = line.split()
            if words[0] == "FLASER":
                end = 2 + int(words[1])
                words[2:end] = words[2:end][::-1]
            yield " ".join(words)

    examination = examine(changed(path, tmp_path, reverse))

    assert the(examination, "odometry_mirrored").severity == "warning"
    assert "upside_down" in the(examination, "odometry_mirrored").remedy
    assert "odometry_mirrored" not in codes(examine(path))


def test_faults_of_a_log_are_found_with_place_and_count(good_log, tmp_path):
    def spoil(lines):
        scans = [k for k, line in enumerate(lines) if line.startswith("FLASER")]
        lines[scans[50]] = lines[scans[50]][:400]
        tokens = lines[scans[80]].split()
        tokens[-3] = str(float(tokens[-3]) - 0.5)
        lines[scans[80]] = " ".join(tokens)
        return [*lines, "SYNC here", "hello"]

    examination = examine(changed(good_log, tmp_path, spoil))

    assert examination.can_be_mapped
    assert codes(examination) >= {"skipped", "stamps_out_of_order"}
    skipped = {
        f.message.split(":")[1].split(",")[0] for f in examination.findings if f.code == "skipped"
    }
    assert skipped == {" range count mismatch or line cut off", " unknown line"}
    assert "changed.log:" in the(examination, "skipped").message
    assert the(examination, "stamps_out_of_order").count == 1
    other = [s for s in examination.contents.streams if s.role == "other"]
    assert [(s.name, s.count, s.used) for s in other] == [("SYNC", 1, False)]


def test_a_log_cut_off_can_be_mapped_and_has_an_error(good_log, tmp_path):
    packed = gzip.compress(good_log.read_bytes(), mtime=0)
    path = tmp_path / "cut.log.gz"
    path.write_bytes(packed[: len(packed) // 2])

    examination = examine(path)

    assert examination.can_be_mapped
    assert examination.findings[0].severity == "error"
    assert examination.findings[0].code == "damaged"
    assert examination.findings[0].remedy


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (b"hello\n", "is not in a known format"),
        (bytes(range(256)), "is binary"),
        (b"\x1f\x8bgarbage", "gzip stream is damaged"),
        (b"ODOM 0 0 0 0 0 0 1 h 1\n", "holds no laser scans"),
        (b"Laser 3 1 x 2\n", "is not a number"),
        (b"time,r0,r1\n0,1,2\n", "angle_min is missing"),
    ],
)
def test_what_cannot_be_mapped_is_an_error_with_a_remedy(tmp_path, content, message):
    path = tmp_path / "given"
    path.write_bytes(content)

    examination = examine(path)

    assert not examination.can_be_mapped
    finding = examination.findings[0]
    assert finding.severity == "error"
    assert message in finding.message
    assert "it cannot be mapped" in render(examination)


def test_folders_and_missing_files_are_reported(tmp_path):
    for path in (tmp_path, tmp_path / "nowhere"):
        examination = examine(path)
        assert not examination.can_be_mapped
        assert examination.findings[0].remedy


def test_scans_that_see_nothing_cannot_be_mapped(good_log, tmp_path):
    def blind(lines):
        head = ["FLASER", "361", *["81.91"] * 361]
        return [
            " ".join([*head, *line.split()[363:]]) if line.startswith("FLASER") else line
            for line in lines
        ]

    examination = examine(changed(good_log, tmp_path, blind))

    assert not examination.can_be_mapped
    assert the(examination, "no_returns").severity == "error"


@pytest.mark.parametrize("form", FORMATS)
def test_a_sound_bag(tmp_path, form):
    examination = examine(drive(form).write(tmp_path))

    assert examination.can_be_mapped
    assert examination.findings == ()
    assert {s.name for s in examination.contents.streams if s.used} == {"/scan", "/odom", "/imu"}
    assert examination.contents.base_frame == "base_link"
    assert examination.imu.mean_size == pytest.approx(9.8, abs=0.01)
    assert examination.odometry.path_length == pytest.approx(0.59)
    frames = {t.child: t.parent for t in examination.contents.transforms}
    assert frames == {"laser": "base_link", "imu": "base_link"}


def test_faults_of_a_bag_are_found(tmp_path):
    bag = BagMaker()
    make = bag.make
    for k in range(30):
        t = 0.1 * k
        step = 0.0 if k in (10, 11) else 0.05 * k
        late = 0.7 if k == 20 else 0.0
        bag.add("/scan", make.scan(START + t, ranges_of(step), time_increment=1e-3), t + late)
        bag.add("/scan_filtered", make.scan(START + t + 0.03, ranges_of(step)), t + 0.03)
        bag.add("/imu", make.imu(START + t, (0.0, 0.0, 0.1), (0.0, 0.0, 0.0)), t)
        sent = make.transforms(START + t, ("map", "odom", (0.01 * k, 0.0, 0.0), (0.0, 0.0, 0.0)))
        bag.add("/tf", sent, t)

    examination = examine(bag.write(tmp_path))

    assert examination.can_be_mapped
    assert codes(examination) >= {
        "missing_transform",
        "shared_frame",
        "other_slam",
        "repeated_scans",
        "recorded_late",
        "no_odometry",
    }
    assert the(examination, "recorded_late").where == "/scan"
    assert the(examination, "repeated_scans").count == 1


def test_a_bag_without_scans_has_its_topics_listed(tmp_path):
    bag = BagMaker()
    for k in range(5):
        bag.add("/imu", bag.make.imu(START + k, (0.0, 0.0, 9.8), (0.0, 0.0, 0.0)), float(k))

    examination = examine(bag.write(tmp_path))

    assert not examination.can_be_mapped
    assert "holds no laser scans" in examination.findings[0].message
    assert [(s.name, s.count) for s in examination.contents.streams] == [("/imu", 5)]


def test_the_place_given_on_the_command_line_is_heeded(tmp_path):
    path = drive(transforms=False).write(tmp_path)
    assert "missing_transform" in codes(examine(path))
    given = examine(path, ReadOptions(laser_pose=Pose(0.2, 0.0, 0.0), imu_topic="none"))
    assert "missing_transform" not in codes(given)


def test_the_part_tried_is_where_the_robot_turns():
    watch = OdometryWatch()
    for k in range(100):
        turn = 0.1 * min(max(k - 60, 0), 10)
        watch.add(Odometry(0.1 * k, 0.1 * k, Pose(0.1 * k, 0.0, turn)))
    times = 0.1 * np.arange(100)
    first = choose_part(times, watch, size=20)
    assert 50 <= first <= 60
    assert choose_part(times, watch, size=200) == 0


def spoiled(data, rng):
    """Return a recording cut off, or with bytes changed, doubled or zeroed."""
    data = bytearray(data)
    kind = rng.choice(["cut", "flip", "zero", "double", "head", "pack"])
    at = rng.randrange(len(data))
    if kind == "cut":
        del data[at:]
    elif kind == "flip":
        for _ in range(rng.choice([1, 20])):
            data[rng.randrange(len(data))] = rng.randrange(256)
    elif kind == "zero":
        data[at : at + 500] = bytes(min(500, len(data) - at))
    elif kind == "double":
        data = data[:at] + data[at // 2 :]
    elif kind == "head":
        del data[: rng.randrange(200)]
    else:
        data = gzip.compress(bytes(data), mtime=0)[: rng.randrange(20, 2000)] + rng.randbytes(9)
    return bytes(data)


@pytest.mark.parametrize("seed", range(24))
def test_damage_never_brings_the_doctor_down(tmp_path, seed):
    rng = random.Random(seed)
    form = ("log", "bag", "db3", "mcap")[seed % 4]
    if form == "log":
        path = tmp_path / "a.log"
        simulate(ring(), seed=1, duration=4.0).write_carmen(path)
    else:
        path = drive(form, 10).write(tmp_path)
        path = path if form == "bag" else next(p for p in path.iterdir() if p.suffix[1:] == form)
    path.write_bytes(spoiled(path.read_bytes(), rng))

    examination = examine(path)

    json.dumps(document([examination]), allow_nan=False)
    assert examination.can_be_mapped or examination.findings[0].severity == "error"
    assert render(examination).splitlines()[-1].startswith("it can")


def keys_of(value):
    if isinstance(value, dict):
        yield from value
        for inner in value.values():
            yield from keys_of(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from keys_of(inner)


def test_every_key_of_the_json_is_explained(tmp_path, good_log):
    examinations = [examine(good_log), examine(drive().write(tmp_path))]
    explained = set(re.findall(r"`(\w+)`", (ROOT / "docs/doctor.md").read_text()))

    assert set(keys_of(document(examinations))) <= explained


def strings_in(node):
    return {n.value for n in ast.walk(node) if isinstance(n, ast.Constant)}


def test_every_code_is_explained():
    """The codes are the second argument of each Finding and BagFinding."""
    explained = set(re.findall(r"`(\w+)`", (ROOT / "docs/doctor.md").read_text()))
    found, kinds = set(), ("Finding", "BagFinding")
    for path in [*(SOURCE / "doctor").glob("*.py"), *(SOURCE / "readers").rglob("*.py")]:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") in kinds:
                code = node.args[1] if len(node.args) > 1 else ast.Pass()
                found |= (
                    strings_in(code.body) | strings_in(code.orelse)
                    if isinstance(code, ast.IfExp)
                    else strings_in(code)
                )

    assert len(found) > 30
    assert found - explained == set()
