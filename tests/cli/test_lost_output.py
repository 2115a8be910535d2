# SPDX-License-Identifier: Apache-2.0
"""Commands whose output cannot be written: the reader left, the disk is full, it is closed."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from cartoloop.cli.lost_output import would_wait
from cartoloop.simulation import ring, simulate
from tests.limits import LIMIT_S
from tests.live.live_room import lines
from tests.map_output.small_result import FILES

NEEDS_SHELL = pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a full device")
pytestmark = NEEDS_SHELL

LOST = [">/dev/full 2>&1", "2>&1 | head -n 1", "2>&-", ">&- 2>&- <&-", "2>/dev/full"]


def shell(command, **options):
    """Run a command line, in which ``cartoloop`` is the program."""
    function = f'cartoloop() {{ "{sys.executable}" -m cartoloop "$@"; }}; set -o pipefail; '
    return subprocess.run(
        ["bash", "-c", function + command], capture_output=True, check=False, **options
    )


def say_much(redirections):
    """Write much to both streams of a process without its commands, and return its status."""
    code = (
        "import sys; from cartoloop.cli.lost_output import forget_lost_output; "
        "forget_lost_output(); file = open(sys.argv[1], 'w'); "
        "[print('much ' * 9999, file=s) for s in (sys.stdout, sys.stderr) for _ in range(9)]; "
        "file.write('done')"
    )
    return f'"{sys.executable}" -c "{code}" "$FILE" {redirections}'


@pytest.mark.parametrize("redirections", LOST)
def test_a_program_goes_on_without_its_output(tmp_path, redirections):
    done = shell(say_much(redirections), env=os.environ | {"FILE": str(tmp_path / "file")})

    assert done.returncode == 0
    assert (tmp_path / "file").read_text() == "done"


def test_a_full_pipe_is_noticed_before_it_is_waited_for():
    read, write = os.pipe()
    with os.fdopen(read, "rb"), os.fdopen(write, "w") as stream:
        assert not would_wait(stream)
        os.set_blocking(write, False)
        with contextlib.suppress(BlockingIOError):
            while os.write(write, bytes(4096)):
                pass
        assert would_wait(stream)


@pytest.mark.slow
@pytest.mark.parametrize("redirections", [">/dev/full 2>&1", "2>&1 | head -n 1", ">&- 2>&- <&-"])
def test_a_map_is_saved_without_its_output(tmp_path, redirections):
    simulate(ring(), duration=8.0).write_log(tmp_path / "ring.log")

    done = shell(f"cartoloop map '{tmp_path}/ring.log' -o '{tmp_path}/out' {redirections}")

    assert done.returncode == 0
    assert {path.name for path in (tmp_path / "out").iterdir()} == FILES


@pytest.mark.slow
@pytest.mark.parametrize("redirections", ["2>/dev/full", "2> >(head -n 1 >/dev/null)"])
def test_a_robot_gets_its_poses_without_messages(tmp_path, redirections):
    done = shell(
        f"cartoloop live - -o '{tmp_path}' --no-drop --poses - {redirections}",
        input=b"".join(lines()),
    )

    assert done.returncode == 0
    poses = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(poses) == 51
    assert {path.name for path in tmp_path.iterdir()} == FILES


@pytest.mark.slow
def test_a_robot_is_mapped_when_nobody_reads_its_messages(tmp_path):
    read, write = os.pipe()
    os.set_blocking(write, False)
    with contextlib.suppress(BlockingIOError):
        while os.write(write, bytes(4096)):
            pass
    os.set_blocking(write, True)
    with os.fdopen(read, "rb"), os.fdopen(write, "wb") as full:
        done = subprocess.run(
            [sys.executable, "-m", "cartoloop", "live", "-", "-o", tmp_path, "--poses", "-"],
            input=b"".join(lines()),
            stdout=subprocess.PIPE,
            stderr=full,
            timeout=LIMIT_S,
            check=False,
        )

    assert done.returncode == 0
    assert done.stdout
    assert {path.name for path in tmp_path.iterdir()} == FILES


@pytest.mark.slow
def test_a_robot_is_mapped_when_nobody_reads_its_poses(tmp_path):
    done = shell(
        f"cartoloop live - -o '{tmp_path}' --no-drop --poses - | head -n 1",
        input=b"".join(lines()),
    )

    assert done.returncode == 0
    assert b"the reader of the poses left" in done.stderr
    assert {path.name for path in tmp_path.iterdir()} == FILES


def test_what_only_prints_fails_where_it_cannot():
    done = shell("cartoloop config show > /dev/full")

    assert done.returncode == 1
    assert done.stderr.decode().startswith("cartoloop: standard output: cannot be written: No ")


def test_a_reader_that_has_seen_enough_is_no_failure():
    done = shell("cartoloop config show | head -n 1")

    assert (done.returncode, done.stderr) == (0, b"")
