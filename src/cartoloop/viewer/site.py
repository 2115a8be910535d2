# SPDX-License-Identifier: Apache-2.0
"""What is served besides the map: the packaged page, and the address where a browser finds it.

It imports no web framework, so that a page can be served before there is one.
"""

from __future__ import annotations

import mimetypes
import secrets
import socket
from contextlib import suppress
from importlib.resources import files
from importlib.resources.abc import Traversable
from ipaddress import ip_address
from typing import NamedTuple

from cartoloop.errors import ServeError

DEFAULT_HOST, DEFAULT_PORT = "127.0.0.1", 8765

SEND_BUFFER_BYTES = 2**18
"""Size of the send buffer of a connection: little, or a slow page gets old updates [bytes]."""

HEADERS = {
    "Cache-Control": "no-cache",
    "Content-Security-Policy": "default-src 'self'; img-src 'self' blob: data:; "
    "base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
"""Sent with everything that is served."""

_TYPES = {".js": "text/javascript", ".mjs": "text/javascript", ".css": "text/css"}

_PORTS_TRIED = 20
"""Number of consecutive ports to try."""

_ANY_HOST = ("0.0.0.0", "::")
_ELSEWHERE = "192.0.2.1"  # reserved for documentation: no host has it


class Listening(NamedTuple):
    """A place where pages are served.

    Attributes
    ----------
    socket : that listens.
    token : secret that pages must send; "" admits all programs on this machine.
    """

    socket: socket.socket
    token: str

    @property
    def port(self) -> int:
        """Where it listens."""
        return int(self.socket.getsockname()[1])


def listen(host: str, port: int) -> Listening:
    """Return a place at the first port that is free; only this machine needs no token.

    Raises
    ------
    ServeError
        Nothing can be served there.
    """
    token = "" if is_loopback(host) else secrets.token_urlsafe(16)
    return Listening(_listening_socket(host, port), token)


def url_of(host: str, place: Listening) -> str:
    """Return what a browser on this machine, or another one if the host allows it, must open."""
    name = _own_address() if host in _ANY_HOST else host
    if ":" in name:
        name = f"[{name}]"
    return f"http://{name}:{place.port}/" + (f"?token={place.token}" if place.token else "")


def static_files() -> dict[str, tuple[bytes, str]]:
    """Return content and type of all that is served, by its path; read once, from the package."""
    found: dict[str, tuple[bytes, str]] = {}

    def collect(folder: Traversable, prefix: str) -> None:
        for entry in folder.iterdir():
            name = f"{prefix}{entry.name}"
            if entry.is_dir():
                collect(entry, f"{name}/")
            else:
                suffix = name[name.rfind(".") :]
                guess = _TYPES.get(suffix) or mimetypes.guess_type(name)[0]
                found[name] = entry.read_bytes(), guess or "application/octet-stream"

    collect(files("cartoloop.viewer") / "static", "")
    return found


def is_loopback(host: str) -> bool:
    """Return whether a name or an address is that of this machine (loopback)."""
    if host == "localhost":
        return True
    with suppress(ValueError):
        return ip_address(host).is_loopback
    return False


def _listening_socket(host: str, port: int) -> socket.socket:
    """Return a listening socket at the first port that is free."""
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    except (OSError, OverflowError) as error:
        raise ServeError(
            f"--view-host {host}: there is no such host ({error}); give an address of this machine"
        ) from error
    last: OSError | None = None
    for number in range(port, min(port + _PORTS_TRIED, 2**16) if port else 1):
        listening = socket.socket(family, socket.SOCK_STREAM)
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        # inherited by connections: what the system holds for a slow page is old when it arrives
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        try:
            listening.bind((address[0], number))
            listening.listen()
            return listening
        except OSError as error:
            listening.close()
            last = error
    reason = last.strerror if last else "no such port"
    raise ServeError(
        f"the viewer cannot be served on {host}, ports {port} and following: {reason}; choose "
        "another with --view-port"
    )


def _own_address() -> str:
    """Return the address by which others reach this machine, its name if it has none."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe, suppress(OSError):
        probe.connect((_ELSEWHERE, 9))  # sends nothing: the system only chooses a route
        return str(probe.getsockname()[0])
    return socket.gethostname()
