# SPDX-License-Identifier: Apache-2.0
"""Formats of other packages are found; passes over one log are independent."""

import re
import shutil
import tomllib
from itertools import islice, pairwise
from pathlib import Path

import numpy as np
import pytest

from cartoloop.cli.main import run
from cartoloop.errors import InputError
from cartoloop.readers import LineFormat, LineLog, Reading, open_log, open_logs, read
from cartoloop.readers.formats import GROUP, format_names, text_formats
from cartoloop.readers.scan_sample import ScanSample
from cartoloop.sensor.events import LaserScan, Odometry, ScanGeometry

ROOT = Path(__file__).parents[2]


def declared_in_documents():
    """Return the entry points in the example of docs/readers.md."""
    text = (ROOT / "docs/readers.md").read_text()
    example = re.search(r"```toml\n(.*?)```", text, re.DOTALL)[1]
    return tomllib.loads(example)["project"]["entry-points"]


def install(folder, monkeypatch, group, formats):
    """Let a folder look like an installed package with entry points."""
    metadata = folder / "my_robot-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: my-robot\nVersion: 1.0\n")
    lines = [f"[{group}]", *(f"{name} = {value}" for name, value in formats.items())]
    (metadata / "entry_points.txt").write_text("\n".join(lines))
    monkeypatch.syspath_prepend(folder)


@pytest.fixture
def own_log(tmp_path):
    path = tmp_path / "my.log"
    ranges = " ".join(str(200 + k) for k in range(120))
    path.write_text("".join(f"SCAN {200 * k} | {10 * k} 0 0 | {ranges}\n" for k in range(20)))
    return path


def test_lines_with_more_beams_than_a_sweep_are_skipped(tmp_path):
    def parse(line):
        return Reading(ranges=np.full(int(line), 2.0))

    geometry = ScanGeometry(-1.0, 0.05, 40, 0.1, 9.0)
    form = LineFormat("counts", lambda head: True, lambda head: geometry, lambda head: parse)
    path = tmp_path / "counts.log"
    path.write_text("40\n41\n4000\n40\n")
    log = LineLog(path, form)

    assert [len(event.ranges) for event in log if isinstance(event, LaserScan)] == [40, 41, 40]
    assert log.skipped == {"more beams than a sweep has": 1}
    assert log.problems[-1].message.startswith("counts.log:3: 4000 beams, 0.05 rad apart")


def test_a_documented_format_of_a_package_is_read(tmp_path, monkeypatch, own_log, capsys):
    with pytest.raises(InputError, match="not in a known format"):
        open_log(own_log)
    ((group, formats),) = declared_in_documents().items()
    shutil.copy(ROOT / "examples/own_reader.py", tmp_path)
    install(tmp_path, monkeypatch, group, formats)

    log = open_log(own_log)

    assert isinstance(log, LineLog)
    assert (log.format_name, log.num_scans) == ("my format", 20)
    assert run(["map", str(own_log), "-o", str(tmp_path / "out")]) == 0
    assert (tmp_path / "out" / "map.pgm").exists()
    assert "20 scans" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("value", "message"),
    [("no_such_module:X", "cannot be loaded: No module"), ("json:dumps", "not a LineFormat")],
)
def test_a_faulty_format_of_a_package_is_named(tmp_path, monkeypatch, own_log, value, message):
    install(tmp_path, monkeypatch, GROUP, {"broken": value})

    with pytest.raises(InputError, match=f"log format 'broken' .*{message}.*uninstall"):
        open_log(own_log)


def test_messages_and_help_name_every_format(tmp_path, capsys):
    path = tmp_path / "prose.txt"
    path.write_text("Dear diary\n")
    with pytest.raises(InputError) as error:
        open_log(path)
    run(["map", "--help"])
    shown = " ".join(re.sub(r"[│╭╮╰╯]", " ", capsys.readouterr().out).split())

    assert all(name in str(error.value) for name in format_names())
    assert all(name in shown for name in format_names())
    assert {line_format.name for line_format in text_formats()} <= set(format_names())


def carmen_line(number, count=180):
    ranges = " ".join(["1.5"] * count)
    return f"FLASER {count} {ranges} {number} 0 0 {number} 0 0 {0.2 * number:.1f} host 0.0"


@pytest.fixture
def faulty_path(tmp_path):
    """Return a log with eight sound scans, a damaged line and a line without a use."""
    lines = [carmen_line(k) for k in range(8)]
    path = tmp_path / "run.clf"
    path.write_text("\n".join([*lines[:4], lines[4][:99], "SYNC x", *lines[4:]]) + "\n")
    return path


def test_two_passes_over_a_log_do_not_mix(faulty_path):
    log = open_log(faulty_path)
    first, second = iter(log), iter(log)

    paired = [(a, b) for a, b in zip(first, second, strict=True)]

    assert all(type(a) is type(b) and a.stamp == b.stamp for a, b in paired)
    assert len(paired) == 16
    expected = {"range count mismatch or line cut off": 1, "SYNC (not used)": 1}
    assert first.skipped == second.skipped == expected
    assert first.problems == second.problems
    assert first.num_problems == 1


def test_a_finished_pass_keeps_its_problems(faulty_path):
    log = open_log(faulty_path)
    finished = iter(log)
    list(finished)
    begun = iter(log)
    next(begun)

    assert sum(finished.skipped.values()) == 2
    assert begun.skipped == {} == log.skipped


def test_passes_over_a_chain_do_not_mix(faulty_path):
    second = faulty_path.with_name(f"second-{faulty_path.name}")
    second.write_bytes(faulty_path.read_bytes())
    chain = open_logs([faulty_path, second])
    half, whole = iter(chain), iter(chain)
    list(islice(half, 16))
    num_events = len(list(whole))

    assert num_events == 32
    assert sum(half.skipped.values()) == 2
    assert sum(whole.skipped.values()) == 4
    assert whole.num_problems == 2


def test_read_returns_a_pass_with_its_log(faulty_path):
    events = read(faulty_path)

    assert isinstance(next(events), Odometry)
    assert sum(isinstance(event, LaserScan) for event in events) == events.log.num_scans == 8
    assert events.log.profile.num_beams == 180
    assert len(events.problems) == 1


def test_a_sample_is_spread_in_groups_of_three():
    sample = ScanSample()
    for number in range(10_000):
        sample.offer(number, number)
    sample.drop(0)

    numbers = [number for number, _ in sample.scans]
    starts = numbers[2::3]
    assert 3 * 192 <= len(numbers) + 1 < 6 * 192
    assert numbers[:2] == [1, 2]
    assert all(numbers[2 + 3 * k : 5 + 3 * k] == [s, s + 1, s + 2] for k, s in enumerate(starts))
    assert len({b - a for a, b in pairwise(starts)}) == 1


def test_a_closed_pass_yields_nothing_more(faulty_path):
    events = read(faulty_path)
    next(events)
    events.close()

    assert list(events) == []
