# SPDX-License-Identifier: Apache-2.0
"""From SOURCE on the command line to the live source."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

from cartoloop.errors import InputError
from cartoloop.live.growing_file import GrowingFile
from cartoloop.live.sockets import TcpSource, WebSocketSource, is_loopback
from cartoloop.live.source import Source
from cartoloop.live.standard_input import StandardInput

KNOWN = "-, tcp://127.0.0.1:PORT, ws://127.0.0.1:PORT, ros2: or a file that is being written"


@dataclass(frozen=True, slots=True)
class SourceOptions:
    """Options of a source.

    Attributes
    ----------
    host : address of this machine to listen at; None: the one in SOURCE, which must be loopback.
    scan_topics, odom_topic, imu_topic : of ROS 2; by default they are found by their type.
    """

    host: str | None = None
    scan_topics: Sequence[str] = ()
    odom_topic: str | None = None
    imu_topic: str | None = None


def make_source(text: str, options: SourceOptions) -> Source:
    """Return the source of an address, not yet open.

    Raises
    ------
    InputError
        There is no such kind, or other machines could reach it without the user's consent.
    """
    if text == "-":
        return StandardInput()
    scheme = text.partition(":")[0].lower()
    if scheme in ("tcp", "ws") and "://" in text:
        host, port = _host_and_port(text, options.host)
        return TcpSource(host, port) if scheme == "tcp" else WebSocketSource(host, port)
    if scheme == "ros2" and ":" in text:
        from cartoloop.live.ros2 import Ros2Source

        return Ros2Source(_domain(text), options.scan_topics, options.odom_topic, options.imu_topic)
    if "://" in text:
        raise InputError(f"{text}: no such source; known are {KNOWN}")
    return GrowingFile(Path(text))


def _host_and_port(text: str, host: str | None) -> tuple[str, int]:
    try:
        parts = urlsplit(text)
        port = parts.port
    except ValueError as error:
        raise InputError(f"{text}: {error}; give tcp://127.0.0.1:PORT or ws://...") from None
    if port is None:
        raise InputError(f"{text}: names no port; give, say, {parts.scheme}://127.0.0.1:7000")
    if host is not None:
        return host, port
    named = parts.hostname or "127.0.0.1"
    if not is_loopback(named):
        raise InputError(
            f"{text}: other machines could send to this address; if "
            f"that is wanted, allow it with --source-host {named}"
        )
    return named, port


def _domain(text: str) -> int | None:
    """Return the domain in ros2:N, None if there is none."""
    number = text.partition(":")[2].strip("/")
    if not number:
        return None
    if not number.isdecimal() or int(number) > 232:
        raise InputError(f"{text}: {number!r} is no domain of ROS 2; give ros2: or ros2:0 to 232")
    return int(number)
