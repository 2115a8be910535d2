# SPDX-License-Identifier: Apache-2.0
"""``cartoloop view`` and ``cartoloop map --view``: served until Ctrl-C."""

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


@pytest.mark.parametrize(
    "option", [("--view-host", "0.0.0.0"), ("--view-port", "9000"), ("--speed", "2")]
)
def test_options_of_the_view_are_refused_without_it(log, tmp_path, option, capsys):
    assert run(["map", str(log), "-o", str(tmp_path), *option]) == 2

    assert "has no effect without --view" in capsys.readouterr().err


def test_a_folder_without_a_map_is_reported(tmp_path, capsys):
    assert run(["view", str(tmp_path)]) == 1

    assert "is not there; give a folder that 'cartoloop map' wrote" in capsys.readouterr().err
