# SPDX-License-Identifier: Apache-2.0
"""Bad recordings from end to end: the good part is mapped, the rest reported with its place."""

from __future__ import annotations

import gzip
import json
import os
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from cartoloop.cli.main import run
from cartoloop.global_slam import constraint_search, global_slam
from cartoloop.journal.frames import FILE_NAME as JOURNAL
from cartoloop.simulation import ring, simulate
from tests.map_output.small_result import FILES

pytestmark = pytest.mark.slow

NUM_SCANS = 120
NUM_BEAMS = 361


@pytest.fixture(scope="module")
def lines(tmp_path_factory):
    """The lines of a good log."""
    path = tmp_path_factory.mktemp("good") / "good.log"
    simulate(ring(), seed=2, duration=0.2 * (NUM_SCANS - 1)).write_carmen(path)
    return path.read_text().splitlines()


@pytest.fixture
def mapped(tmp_path, capsys):
    """Write a recording, map it, and return what came out."""

    def map_it(content, name="bad.log", *options):
        path, out = tmp_path / name, tmp_path / "out"
        text = "\n".join(content) + "\n" if isinstance(content, list) else content
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return Mapped(run(["map", str(path), "-o", str(out), *options]), out, capsys.readouterr())

    return map_it


class Mapped:
    def __init__(self, status, out, captured):
        self.status = status
        self.out = out
        self.error = captured.err
        assert "Traceback" not in self.error
        self.last_line = self.error.splitlines()[-1] if self.error else ""

    def assert_complete(self, *, is_resumable=False):
        files = FILES | {JOURNAL} if is_resumable else FILES
        assert {path.name for path in self.out.iterdir()} == files

    @property
    def report(self):
        return json.loads((self.out / "report.json").read_text())

    @property
    def trajectory(self):
        return np.loadtxt(self.out / "trajectory.tum", ndmin=2)

    @property
    def num_walls(self):
        """How many cells of the map are occupied."""
        return int(np.count_nonzero(np.asarray(Image.open(self.out / "map.pgm")) == 0))


def scan_places(lines):
    return [place for place, line in enumerate(lines) if line.startswith("FLASER")]


def with_ranges(line, change):
    """A scan's line with its ranges changed by a function."""
    tokens = line.split()
    tokens[2 : 2 + NUM_BEAMS] = change(tokens[2 : 2 + NUM_BEAMS])
    return " ".join(tokens)


def with_stamp(line, change):
    tokens = line.split()
    for place in (-3, -1):
        tokens[place] = f"{change(float(tokens[place])):.6f}"
    return " ".join(tokens)


def test_a_good_recording_needs_no_words(lines, mapped):
    result = mapped(lines)

    assert result.status == 0
    result.assert_complete()
    assert len(result.trajectory) == NUM_SCANS
    assert result.num_walls > 300
    assert result.report["skipped"] == {}
    assert "warning" not in result.error


def test_truncated_gzip_is_mapped_up_to_the_cut_and_fails(lines, mapped):
    whole = gzip.compress("\n".join(lines).encode(), mtime=0)

    result = mapped(whole[: len(whole) // 2], "cut.log.gz")

    assert result.status == 1
    result.assert_complete()
    assert 0.2 * NUM_SCANS < len(result.trajectory) < 0.8 * NUM_SCANS
    assert "cut.log.gz:" in result.last_line
    assert "gzip stream is cut off" in result.last_line
    assert str(result.out) in result.last_line


def test_a_line_cut_in_the_middle_costs_one_scan(lines, mapped):
    place = scan_places(lines)[60]
    lines = [*lines]
    lines[place] = lines[place][: len(lines[place]) // 2]

    result = mapped(lines)

    assert result.status == 0
    result.assert_complete()
    assert len(result.trajectory) == NUM_SCANS - 1
    assert f"bad.log:{place + 1}: 361 ranges are announced" in result.error
    assert sum(result.report["skipped"].values()) == 1


def test_a_range_count_that_does_not_match_costs_one_scan(lines, mapped):
    place = scan_places(lines)[60]
    lines = [*lines]
    lines[place] = lines[place].replace("FLASER 361", "FLASER 360")

    result = mapped(lines)

    assert result.status == 0
    assert len(result.trajectory) == NUM_SCANS - 1
    assert f"bad.log:{place + 1}: 360 ranges are announced" in result.error
    assert sum(result.report["skipped"].values()) == 1


def test_nan_infinite_and_negative_ranges_are_no_returns(lines, mapped):
    def spoil(ranges):
        return ["nan", "inf", "-inf", "-2.5", *ranges[4:180], "1e400", "-0.0", *ranges[182:]]

    good = mapped(lines)
    expected, num_walls = good.trajectory, good.num_walls

    spoilt = [with_ranges(x, spoil) if x.startswith("FLASER") else x for x in lines]
    result = mapped(spoilt, "bad.log", "--overwrite")

    assert result.status == 0
    result.assert_complete()
    assert len(result.trajectory) == NUM_SCANS
    assert np.abs(result.trajectory[:, 1:3] - expected[:, 1:3]).max() < 0.1
    assert result.num_walls == pytest.approx(num_walls, rel=0.1)


def test_zero_scans_are_reported_in_a_line(mapped):
    result = mapped([f"ODOM {0.1 * k:.2f} 0 0 0.5 0 0 {100 + k} host {100 + k}" for k in range(9)])

    assert result.status == 1
    assert result.error.count("\n") == 1
    assert "bad.log" in result.error
    assert "holds no laser scans" in result.error
    assert not result.out.exists()


def test_one_scan_makes_a_map(lines, mapped):
    result = mapped([lines[scan_places(lines)[0]]])

    assert result.status == 0
    result.assert_complete()
    assert result.trajectory.shape == (1, 8)
    assert result.num_walls > 5
    assert result.report["nodes"] == 1
    assert result.report["input"]["duration_s"] == 0.0


def test_a_recording_without_returns_is_an_error(lines, mapped):
    def nothing(ranges):
        return ["81.91"] * len(ranges)

    result = mapped([with_ranges(x, nothing) if x.startswith("FLASER") else x for x in lines])

    assert result.status == 1
    result.assert_complete()
    assert len(result.trajectory) == NUM_SCANS
    assert np.isfinite(result.trajectory).all()
    assert result.num_walls == 0
    assert result.report["skipped"] == {"too few returns to match: pose as predicted": NUM_SCANS}
    assert "bad.log: no scan has enough returns to be mapped" in result.error


def test_a_file_name_that_is_no_text_is_mapped(lines, mapped):
    try:
        result = mapped(lines, os.fsdecode(b"b\xfcro.log"))
    except OSError:
        pytest.skip("this file system has no such names")

    assert result.status == 0
    result.assert_complete()
    assert result.report["input"]["name"] == "b\N{REPLACEMENT CHARACTER}ro.log"


@pytest.mark.skipif(sys.platform == "win32", reason="names are text there")
def test_a_file_name_that_the_terminal_cannot_show_is_escaped():
    command = subprocess.run(
        [sys.executable, "-m", "cartoloop", "doctor", b"b\xfcro.log"],
        env=os.environ | {"PYTHONIOENCODING": "utf-8:strict"},
        capture_output=True,
        check=False,
    )

    assert command.returncode == 1
    assert b"ro.log" in command.stdout
    assert command.stderr == b""


def test_a_gap_of_ten_hours_is_reported_and_bridged(lines, mapped):
    middle = scan_places(lines)[60] + 1
    later = [with_stamp(line, lambda stamp: stamp + 36_000.0) for line in lines[middle:]]

    result = mapped([*lines[:middle], *later])

    assert result.status == 0
    result.assert_complete()
    assert len(result.trajectory) == NUM_SCANS
    assert f"bad.log:{middle + 1}: nothing was recorded for 36000" in result.error
    steps = np.hypot(*np.diff(result.trajectory[:, 1:3], axis=0).T)
    assert steps.max() < 0.5
    assert result.report["input"]["duration_s"] > 36_000.0


def test_a_robot_that_never_moves_stays_where_it_is(lines, mapped):
    first = lines[scan_places(lines)[0]].split()
    head, tail = first[: 2 + NUM_BEAMS + 6], first[2 + NUM_BEAMS + 6 :]
    still = [
        " ".join((*head, *with_stamp(" ".join(tail), lambda stamp, k=k: stamp + 0.2 * k).split()))
        for k in range(NUM_SCANS)
    ]

    result = mapped(still)

    assert result.status == 0
    result.assert_complete()
    assert len(result.trajectory) == NUM_SCANS
    assert np.abs(result.trajectory[:, 1:3]).max() < 0.01
    assert result.num_walls > 50


@pytest.mark.parametrize(
    ("name", "content"), [("notes.txt", b"no log at all\n" * 9), ("noise.bin", bytes(range(256)))]
)
def test_a_file_that_is_no_log_is_reported_in_a_line(mapped, name, content):
    result = mapped(content, name)

    assert result.status == 1
    assert result.error.count("\n") == 1
    assert result.error.startswith("cartoloop: ")
    assert name in result.error
    assert not result.out.exists()


def test_a_file_in_place_of_the_folder_is_an_error_first(lines, mapped, tmp_path):
    (tmp_path / "out").write_text("something precious")

    result = mapped(lines)

    assert result.status == 1
    assert result.last_line.startswith(f"cartoloop: {tmp_path / 'out'}: cannot write there")
    assert "mapping" not in result.error
    assert (tmp_path / "out").read_text() == "something precious"


SOON = ("--set", "global_slam.optimize_every_n_nodes=10")
SHORT = ("--set", "local_slam.submaps.num_range_data=5")
ALL = ("--set", "global_slam.constraint_search.every_nth_well_constrained_node=1")


def test_a_crash_of_a_background_search_does_not_lose_the_map(lines, mapped, monkeypatch):
    def crash(*arguments):
        raise RuntimeError("the search\nfell over")

    monkeypatch.setattr(constraint_search, "search", crash)

    result = mapped(lines, "good.log", *SOON, *SHORT, *ALL)

    assert result.status == 1
    result.assert_complete(is_resumable=True)
    assert 20 < len(result.trajectory) < NUM_SCANS
    assert result.num_walls > 300
    assert "unexpected RuntimeError: the search fell over" in result.last_line
    assert f"the map until the failure is in {result.out}" in result.error


def test_a_crash_of_the_last_pass_does_not_lose_the_map(lines, mapped, monkeypatch):
    def crash(*arguments, **options):
        raise ZeroDivisionError("no overlap")

    monkeypatch.setattr(global_slam.refinement, "overlapping_nodes", crash)

    result = mapped(lines, "good.log", *SHORT)

    assert result.status == 1
    result.assert_complete(is_resumable=True)
    assert len(result.trajectory) == NUM_SCANS
    assert "unexpected ZeroDivisionError: no overlap" in result.last_line
