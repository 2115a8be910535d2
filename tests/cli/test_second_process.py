# SPDX-License-Identifier: Apache-2.0
"""A second process compiles ahead where it helps; the first can do without."""

from __future__ import annotations

import atexit
import logging
import sys
import threading

import pytest

from cartoloop import compile_ahead
from cartoloop.cli import second_process
from cartoloop.cli.second_process import start_second_process


@pytest.fixture
def at_exit(monkeypatch):
    """What is to be done when this process ends, and is done when the test does."""
    registered = []
    monkeypatch.setattr(compile_ahead, "is_done", lambda: False)
    monkeypatch.setattr(second_process, "_num_processors", lambda: 2)
    monkeypatch.setattr(atexit, "register", lambda *task: registered.append(task))
    yield registered
    for task, *arguments in registered:
        task(*arguments)
    assert not any(thread.name == "compile-ahead" for thread in threading.enumerate())


@pytest.fixture
def stand_in(tmp_path, monkeypatch):
    """Return a function that has a program run in place of Python."""

    def set_program(text):
        program = tmp_path / "program"
        program.write_text(f"#!/bin/sh\n{text}\n")
        program.chmod(0o755)
        monkeypatch.setattr(sys, "executable", str(program))

    if sys.platform == "win32":
        pytest.skip("needs a shell")
    return set_program


def test_it_is_ended_when_this_process_ends(at_exit, stand_in, monkeypatch):
    stand_in("exec sleep 1000 < /dev/null")  # does not look at its input
    monkeypatch.setattr(second_process, "_END_S", 0.1)
    assert start_second_process()
    [(end, process, waiter)] = at_exit
    assert process.poll() is None
    end(process, waiter)
    assert process.returncode < 0


def test_it_ends_by_itself_when_its_input_does(at_exit, stand_in):
    stand_in("exec cat")
    assert start_second_process()
    [(end, process, waiter)] = at_exit
    end(process, waiter)
    assert process.returncode == 0


def test_what_it_fails_of_is_noted_and_harms_nobody(at_exit, stand_in, caplog):
    caplog.set_level(logging.DEBUG, logger="cartoloop")
    stand_in("echo no such module >&2; exit 1")
    assert start_second_process()
    [(_, _, waiter)] = at_exit
    waiter.join(10.0)
    assert "no such module" in caplog.text


def test_a_program_that_is_not_there_is_noted_and_harms_nobody(at_exit, monkeypatch, caplog):
    caplog.set_level(logging.DEBUG, logger="cartoloop")
    monkeypatch.setattr(sys, "executable", "/no/such/python")
    assert not start_second_process()
    assert "not compiled ahead" in caplog.text


def test_there_is_none_where_it_would_not_help(at_exit, monkeypatch):
    monkeypatch.setattr(second_process, "_num_processors", lambda: 1)
    assert not start_second_process()
    monkeypatch.setattr(second_process, "_num_processors", lambda: 2)
    monkeypatch.setattr(compile_ahead, "is_done", lambda: True)
    assert not start_second_process()
    assert not at_exit
