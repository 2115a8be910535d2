# SPDX-License-Identifier: Apache-2.0
"""Files of the user: devices without end, pipes that nobody writes to, and pipes that work."""

from __future__ import annotations

import os
import subprocess
import sys
from threading import Thread

import pytest

from cartoloop import input_file
from cartoloop.config_file import load_config
from cartoloop.errors import ConfigError, InputError
from cartoloop.evaluation.text_table import read_table
from cartoloop.input_file import open_input, read_input, read_text_input
from cartoloop.live.growing_file import GrowingFile
from cartoloop.readers import open_log
from cartoloop.readers.ros.urdf import read_urdf

pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes have no names here")


@pytest.fixture
def pipe(tmp_path):
    path = tmp_path / "pipe"
    os.mkfifo(path)
    return path


@pytest.fixture
def impatient(monkeypatch):
    monkeypatch.setattr(input_file, "FIRST_BYTE_S", 0.01)
    monkeypatch.setattr(input_file, "SILENT_S", 0.02)


@pytest.mark.parametrize(
    ("read", "error"),
    [
        (load_config, ConfigError),
        (read_urdf, InputError),
        (lambda path: read_table(path, "x y"), InputError),
    ],
)
def test_a_device_without_end_is_refused(read, error):
    with pytest.raises(error, match=r"/dev/zero: is longer than \d+ MB; expected") as caught:
        read(input_file.Path("/dev/zero"))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("read", [load_config, read_urdf, open_log])
def test_a_pipe_that_nobody_writes_to_is_refused(pipe, impatient, read):
    with pytest.raises((ConfigError, InputError), match="nothing comes from it"):
        read(pipe)


def test_a_silent_writer_is_not_waited_for_for_ever(pipe, impatient):
    silent = os.open(pipe, os.O_RDWR)
    try:
        with pytest.raises(InputError, match="nothing comes from it"):
            read_input(pipe, 100, "text")
    finally:
        os.close(silent)


def test_a_pipe_is_read_to_its_end(pipe):
    writer = Thread(target=lambda: pipe.write_bytes(b"a\r\nb" * 50_000))
    writer.start()
    assert read_text_input(pipe, 1 << 20, "text") == "a\nb" * 50_000
    writer.join()


def test_process_substitution_gives_a_configuration():
    program = "import sys; from cartoloop.config_file import load_config; "
    program += "print(load_config(__import__('pathlib').Path(sys.argv[1])).origins)"
    reading, writing = os.pipe()
    os.write(writing, b"[local_slam.submaps]\nresolution = 0.1\n")
    os.close(writing)
    run = subprocess.run(
        [sys.executable, "-c", program, f"/dev/fd/{reading}"],
        pass_fds=[reading],
        capture_output=True,
        text=True,
        check=True,
    )
    os.close(reading)
    assert "local_slam.submaps.resolution" in run.stdout


@pytest.mark.skipif(not os.path.exists("/proc/self/status"), reason="no files of the system")  # noqa: PTH110
def test_files_of_the_system_are_read_though_they_have_no_size():
    with open_input("/proc/self/status") as file:
        assert file.read().startswith(b"Name:")


def test_a_pipe_cannot_be_followed(pipe):
    with pytest.raises(InputError, match="cartoloop live - <"):
        GrowingFile(pipe).open()
