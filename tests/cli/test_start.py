# SPDX-License-Identifier: Apache-2.0
"""The first moments of the program."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

LOADING = """
import os, signal, sys
from importlib.abc import MetaPathFinder

class Interrupting(MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name == "cartoloop.cli.main":
            os.kill(os.getpid(), signal.SIGINT)
            for _ in range(1000):  # a signal is handled between two instructions
                pass

sys.meta_path.insert(0, Interrupting())
signal.signal(signal.SIGINT, signal.{handler})
sys.argv = ["cartoloop", "--version"]
from cartoloop.cli.start import main
main()
"""

AT_THE_END = """
import sys
sys.argv = ["cartoloop", "--version"]
from cartoloop.cli import main, start
def interrupted():
    raise KeyboardInterrupt
main.main = interrupted
start.main()
"""


def ended(code):
    return subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[2] / "src")},
    )


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such signals")
def test_an_interrupt_while_modules_load_ends_it_in_silence():
    done = ended(LOADING.format(handler="default_int_handler"))
    assert done.returncode == -signal.SIGINT
    assert (done.stdout, done.stderr) == ("", "")


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such signals")
def test_an_interrupt_that_is_ignored_stays_so():
    done = ended(LOADING.format(handler="SIG_IGN"))
    assert done.returncode == 0
    assert done.stdout.startswith("cartoloop ")


def test_an_interrupt_outside_of_any_command_ends_it_in_silence():
    done = ended(AT_THE_END)
    assert done.returncode == 130
    assert done.stderr == ""
