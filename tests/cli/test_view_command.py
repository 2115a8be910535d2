# SPDX-License-Identifier: Apache-2.0
"""``cartoloop view``, and ``map`` and ``locate`` with ``--view``: served until Ctrl-C."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from contextlib import contextmanager

import pytest

from cartoloop.cli.main import run
from cartoloop.simulation import ring, simulate
from tests.limits import LIMIT_S
from tests.localisation.rooms import ROOM, START, carmen_text, drive, write_image
from tests.viewer.page_twin import join, look

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("view") / "ring.log.gz"
    simulate(ring(), seed=1, duration=20.0).write_carmen(path)
    return path


@contextmanager
def command(*arguments):
    """Run a command that serves; yield it and the URL that it prints, and end it."""
    process = subprocess.Popen(
        [sys.executable, "-u", "-m", "cartoloop", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        url = None
        while url is None:
            line = process.stdout.readline()
            assert line, process.stderr.read()
            url = re.search(r"http://\S+", line)
        yield process, url[0]
    finally:
        process.kill()
        process.communicate()


def test_a_growing_map_is_served_until_ctrl_c(log, tmp_path):
    with command("map", log, "-o", tmp_path / "out", "--view", "--speed", "50") as (process, url):
        with join(url) as connection:
            page = look(connection)
            assert page.hello["mode"] == "recording"
            assert page.hello["name"] == log.name
            look(connection, page, lambda page: page.readings["state"] == "finished")
            assert page.playback["speed"] == 50.0
            assert page.readings["scans"] == page.readings["scans_total"] > 90
        shown = ""
        while "Ctrl-C ends" not in shown:
            shown = process.stdout.readline()
            assert shown
        assert url in shown
        with join(url) as connection:
            assert look(connection).readings["state"] == "finished"
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=LIMIT_S)
        assert process.returncode == 0
    assert (tmp_path / "out/map.png").exists()


def test_a_view_changes_nothing_in_the_map(log, tmp_path):
    assert run(["map", str(log), "-o", str(tmp_path / "a")]) == 0
    with (
        command("map", log, "-o", tmp_path / "b", "--view") as (process, url),
        join(url) as connection,
    ):
        look(connection, None, lambda page: page.json and page.readings["state"] == "finished")
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=LIMIT_S)
    for path in (tmp_path / "a").iterdir():
        if path.name != "report.json":
            assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes(), path.name


def test_a_finished_map_is_served_until_ctrl_c(log, tmp_path):
    assert run(["map", str(log), "-o", str(tmp_path / "out")]) == 0

    with command("view", tmp_path / "out") as (process, url):
        with join(url) as connection:
            page = look(connection)
        assert (page.hello["mode"], page.hello["name"]) == ("finished", log.name)
        process.send_signal(signal.SIGTERM)
        _, errors = process.communicate(timeout=LIMIT_S)
        assert process.returncode == 0
        assert errors == ""


def test_ctrl_c_while_paused_stops_and_saves(log, tmp_path):
    with command("map", log, "-o", tmp_path / "out", "--view", "--speed", "1") as (process, url):
        with join(url) as connection:
            page = look(connection)
            look(connection, page, lambda page: page.readings["scans"] > 3)
            connection.send('{"type": "pause"}')
            look(connection, page, lambda page: page.readings["state"] == "paused")
            process.send_signal(signal.SIGINT)
            _, errors = process.communicate(timeout=LIMIT_S)
        assert process.returncode == 130
        assert "the map of these is in" in errors
        assert "Traceback" not in errors
    assert (tmp_path / "out/map.png").exists()


@pytest.fixture
def room(tmp_path):
    return write_image(tmp_path, ROOM)


@pytest.fixture
def drive_log(tmp_path):
    path = tmp_path / "drive.log"
    path.write_text(carmen_text(ROOM, drive(START, 60, step=0.04, turn=0.03)))
    return path


def test_a_localisation_is_served_until_ctrl_c(room, drive_log, tmp_path):
    poses = tmp_path / "poses.jsonl"
    with command("locate", room, drive_log, "--view", "--speed", "20", "--poses", poses) as (
        process,
        url,
    ):
        with join(url) as connection:
            page = look(connection)
            assert (page.hello["mode"], page.hello["name"]) == ("locating", drive_log.name)
            look(connection, page, lambda page: page.readings["state"] == "finished")
            assert page.readings["text"] == "ended: located"
            assert page.readings["scans"] == page.readings["scans_total"] == 61
            assert page.playback["speed"] == 20.0
        shown = ""
        while "Ctrl-C ends" not in shown:
            shown = process.stdout.readline()
            assert shown
        assert url in shown
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=LIMIT_S)
        assert process.returncode == 0
    assert len(poses.read_text().splitlines()) == 61


def test_ctrl_c_ends_a_localisation_that_is_paused(room, drive_log):
    with command("locate", room, drive_log, "--view", "--speed", "1") as (process, url):
        with join(url) as connection:
            page = look(connection)
            look(connection, page, lambda page: page.readings["scans"] > 3)
            connection.send('{"type": "pause"}')
            look(connection, page, lambda page: page.readings["state"] == "paused")
            process.send_signal(signal.SIGINT)
            said, errors = process.communicate(timeout=LIMIT_S)
        assert process.returncode == 130  # scans are left
        assert "located" in said
        assert "Traceback" not in errors


def test_a_view_changes_no_answer(room, drive_log, tmp_path):
    arguments = ["locate", str(room), str(drive_log), "--poses"]
    assert run([*arguments, str(tmp_path / "a")]) == 0
    with command(*arguments, tmp_path / "b", "--view") as (process, url), join(url) as connection:
        look(connection, None, lambda page: page.json and page.readings["state"] == "finished")
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=LIMIT_S)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_a_pace_is_for_recordings(room, capsys):
    assert run(["locate", str(room), "tcp://127.0.0.1:0", "--view", "--speed", "2"]) == 2

    assert "is for recordings" in capsys.readouterr().err


@pytest.mark.parametrize(
    "option", [("--view-host", "0.0.0.0"), ("--view-port", "9000"), ("--speed", "2")]
)
def test_options_of_the_view_are_refused_without_it(log, tmp_path, option, capsys):
    assert run(["map", str(log), "-o", str(tmp_path), *option]) == 2

    assert "has no effect without --view" in capsys.readouterr().err


def test_a_folder_without_a_map_is_reported(tmp_path, capsys):
    assert run(["view", str(tmp_path)]) == 1

    assert "is not there; give a folder that 'cartoloop map' wrote" in capsys.readouterr().err
