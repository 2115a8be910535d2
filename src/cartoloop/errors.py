# SPDX-License-Identifier: Apache-2.0
"""The errors that users see.

CartoloopError
├── InputError          the recording (or a file given) cannot be used: what, where, what to do
├── ConfigError         an unknown or impossible parameter
├── UsageError          the Python interface was called as it cannot be: arguments, or their order
├── OutputError         the result cannot be written
├── ServeError          the viewer cannot be served
└── Interrupted         the user stopped the run; what was mapped is kept

Every message is one line: what is wrong, where (file, line, topic, time stamp), what to do.
"""

from __future__ import annotations

from cartoloop.plain_text import one_line


class CartoloopError(Exception):
    """Base of all errors that are meant for the user: one line, no traceback.

    Names in the message may hold any characters: those that a terminal obeys are made visible.
    """

    def __init__(self, message: str = "") -> None:
        super().__init__(one_line(message))


class InputError(CartoloopError):
    """A recording or another input file cannot be used."""


class ConfigError(CartoloopError):
    """A parameter is unknown, or its value impossible."""


class UsageError(CartoloopError):
    """The Python interface was called with impossible arguments, or too late."""


class OutputError(CartoloopError):
    """A result cannot be written."""


class ServeError(CartoloopError):
    """The viewer cannot be served at the given address."""


class Interrupted(CartoloopError):  # noqa: N818 - it is not a fault
    """The user stopped the run; what was mapped until then is kept."""
