# SPDX-License-Identifier: Apache-2.0
"""Names chosen by others reach neither the terminal nor the log as control characters."""

from __future__ import annotations

import json
import os
import pty
import sqlite3
import subprocess
import sys
from contextlib import closing

import pytest

from cartoloop.cli.main import run
from cartoloop.errors import InputError
from cartoloop.live.messages import parse_message
from cartoloop.live.notices import Notices
from cartoloop.map_output.save import save
from cartoloop.plain_text import one_line, plain_lines, plain_values
from cartoloop.readers import open_log
from cartoloop.result import load_map
from tests.map_output.small_result import small_result
from tests.readers.ros.bag_files import FORMATS, START, BagMaker, ranges_of

HOSTILE = "a\x1b[31mb\nquality good\x07\x9b\u202e"
ESCAPES = set("\x1b\x07\x9b\u202e\r")


def test_control_characters_are_made_visible():
    assert one_line(HOSTILE) == "a\\x1b[31mb\\nquality good\\x07\\x9b\\u202e"
    assert plain_lines("a\tb\nc\x1b\r") == "a\tb\nc\\x1b\\r"
    assert one_line("Büro 3, 東京") == "Büro 3, 東京"
    assert plain_values({HOSTILE: [HOSTILE, 1.5, None]}) == {
        one_line(HOSTILE): [one_line(HOSTILE), 1.5, None]
    }


def test_errors_and_notices_are_one_plain_line():
    reported = []
    notices = Notices(reported.append)
    notices.say(HOSTILE)
    notices.skip("kind", HOSTILE)
    assert str(InputError(HOSTILE)) == one_line(HOSTILE)
    assert reported == [one_line(HOSTILE)] * 2


def test_the_name_of_a_live_sensor_is_plain():
    scan = {"type": "scan", "angle_min": 0, "angle_increment": 1, "ranges": [1], "sensor": HOSTILE}
    assert parse_message(json.dumps(scan)).geometry.sensor == one_line(HOSTILE)


@pytest.mark.parametrize("form", FORMATS)
def test_topics_and_frames_of_a_bag_are_plain(tmp_path, form):
    name = "/scan\x1b[2J\nx"
    bag = BagMaker(form)
    for i in range(10):
        bag.add(name, bag.make.scan(START + 0.1 * i, ranges_of(i), frame=HOSTILE), 0.1 * i)
    path = bag.write(tmp_path)
    log = open_log(path)
    shown = log.description + "".join(problem.message for problem in log.problems)
    assert not ESCAPES & set(shown)
    assert "\nx" not in shown
    assert [one_line(name)] == list(log.profiles)


def test_names_in_a_map_file_are_plain(tmp_path):
    save(small_result(), tmp_path)
    with closing(sqlite3.connect(tmp_path / "map.cartoloop")) as database:
        report = json.loads(
            database.execute("SELECT value FROM about WHERE key = 'report'").fetchone()[0]
        )
        report["input"]["name"], report["skipped"] = HOSTILE, {HOSTILE: 1}
        database.execute("UPDATE about SET value = ? WHERE key = 'report'", (json.dumps(report),))
        database.commit()
    report = load_map(tmp_path).report
    assert report.input.name == one_line(HOSTILE)
    assert list(report.skipped) == [one_line(HOSTILE)]


@pytest.mark.parametrize("command", ["doctor", "quality"])
def test_a_path_that_is_too_long_is_reported(command, capsys):
    assert run([command, "9" * 5000]) == 1
    said = capsys.readouterr().err
    assert said.startswith("cartoloop: 999")
    assert said.endswith("999: File name too long; check the path\n")
    assert len(said) < 300


@pytest.mark.parametrize("on_terminal", [False, True])
@pytest.mark.parametrize("command", ["doctor", "map", "explain", "config"])
def test_file_names_reach_the_terminal_as_plain_text(tmp_path, command, on_terminal):
    path = tmp_path / "x\x1b]0;title\x07\x9b.log"
    path.write_bytes(b"FLASER 3 1 1 1 0 0 0 0 0 0 1 h 1\n" * 5)
    arguments = {
        "map": ["map", str(path), "-o", str(tmp_path / "o\x1b[1m" / "p")],
        "config": ["config", "check", str(path)],
        "explain": ["explain", str(path), "--closure", "1"],
    }.get(command, [command, str(path)])
    program = [sys.executable, "-m", "cartoloop", *arguments]
    if on_terminal:
        controlling, terminal = pty.openpty()
        with subprocess.Popen(program, stdout=terminal, stderr=terminal) as process:
            os.close(terminal)
            shown = b""
            while True:
                try:
                    shown += os.read(controlling, 1000)
                except OSError:
                    break
            process.wait()
        os.close(controlling)
    else:
        run = subprocess.run(program, capture_output=True, check=False)
        shown = run.stdout + run.stderr
    text = shown.decode()
    assert "\\x1b]0;" in text
    assert "\x1b]0;" not in text
    assert "\x9b" not in text
    assert "\x1b[1m/p" not in text
