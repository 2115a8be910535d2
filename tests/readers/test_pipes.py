# SPDX-License-Identifier: Apache-2.0
"""Recordings that come through a pipe: all of them is read, whatever their format."""

from __future__ import annotations

import gzip
import os
import signal
import subprocess
import sys
from threading import Thread

import pytest

import cartoloop
from cartoloop.errors import InputError
from cartoloop.readers.spool import regular_file
from cartoloop.sensor.events import LaserScan
from cartoloop.simulation import carry, ring, simulate
from tests.limits import LIMIT_S, wait_until

NUM_SCANS = 40


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """The contents of a log, of the log compressed, and of a bag."""
    folder = tmp_path_factory.mktemp("recordings")
    simulate(ring(), duration=0.2 * (NUM_SCANS - 1)).write_log(folder / "ring.log")
    carry(ring(), duration=0.2 * (NUM_SCANS - 1)).write_log(folder / "ring.bag")
    text = (folder / "ring.log").read_bytes()
    return {"log": text, "gz": gzip.compress(text), "bag": (folder / "ring.bag").read_bytes()}


@pytest.fixture
def pipe(tmp_path):
    """Return a named pipe through which some content comes."""
    writers = []

    def make(content):
        path = tmp_path / "a pipe"
        os.mkfifo(path)
        writers.append(Thread(target=path.write_bytes, args=(content,), daemon=True))
        writers[-1].start()
        return path

    yield make
    for writer in writers:
        writer.join(10.0)


@pytest.mark.parametrize("kind", ["log", "gz", "bag"])
def test_all_scans_come_through_a_pipe(recordings, pipe, kind):
    log = cartoloop.open_log(pipe(recordings[kind]))

    assert log.name == "a pipe"
    for _ in range(2):
        assert sum(isinstance(event, LaserScan) for event in log) == NUM_SCANS


@pytest.mark.parametrize("name", ["-", "/dev/stdin"])
def test_standard_input_is_examined_whole(recordings, name):
    done = subprocess.run(
        [sys.executable, "-m", "cartoloop", "doctor", name],
        input=recordings["log"],
        capture_output=True,
        check=False,
    )

    assert f"{NUM_SCANS} scans" in done.stdout.decode()
    assert done.stdout.startswith(b"standard input")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_a_copy_is_removed_when_the_program_is_ended(tmp_path, number):
    process = subprocess.Popen(
        [sys.executable, "-m", "cartoloop", "doctor", "-"],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=os.environ | {"TMPDIR": str(tmp_path)},
    )
    wait_until(lambda: list(tmp_path.glob("cartoloop-*/standard input")))
    process.send_signal(number)

    assert process.wait(LIMIT_S) > 0
    process.stdin.close()
    assert list(tmp_path.iterdir()) == []


def test_a_pipe_that_brings_nothing_is_an_error(pipe):
    with pytest.raises(InputError, match="a pipe: nothing came"):
        regular_file(pipe(b""))


def test_a_device_is_refused():
    with pytest.raises(InputError, match="/dev/zero: is a device, not a recording"):
        regular_file("/dev/zero")


def test_files_and_folders_are_read_where_they_are(tmp_path):
    (tmp_path / "a.log").write_text("a log")

    for path in (tmp_path, tmp_path / "a.log", tmp_path / "nothing"):
        assert regular_file(path) == path
