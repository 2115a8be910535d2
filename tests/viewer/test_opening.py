# SPDX-License-Identifier: Apache-2.0
"""The saved picture of a map is served while the map is read; then the view takes over."""

from __future__ import annotations

import socket
from contextlib import closing, suppress
from http.client import HTTPConnection
from threading import Thread

import pytest

from cartoloop.viewer.opening import PICTURE_PATH, Opening
from cartoloop.viewer.site import listen, static_files, url_of
from cartoloop.viewer.view import serve_result
from tests.limits import LIMIT_S
from tests.viewer.page_twin import join, look
from tests.viewer.real_page import opened

PICTURE = b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 8000
"""2 MB: more than a connection takes at once."""


@pytest.fixture
def place():
    """A place for this machine alone."""
    place = listen("127.0.0.1", 0)
    yield place
    place.socket.close()


@pytest.fixture
def opening(place):
    with closing(Opening(PICTURE, place)) as opening:
        yield opening


def get(place, path, host=None):
    """Return status, headers and content of what is served at a path."""
    connection = HTTPConnection("127.0.0.1", place.port, timeout=LIMIT_S)
    connection.request("GET", path, headers={} if host is None else {"Host": host})
    answer = connection.getresponse()
    content = answer.read()
    connection.close()
    return answer.status, dict(answer.getheaders()), content


def start(place, request):
    """Return a connection with a request that is sent, and not answered yet."""
    connection = socket.create_connection(("127.0.0.1", place.port), timeout=LIMIT_S)
    connection.sendall(request.encode())
    return connection


def rest(connection):
    """Return what a connection receives until it is closed."""
    with connection:
        return b"".join(iter(lambda: connection.recv(65536), b""))


def test_the_page_shows_the_saved_picture_at_once(opening, place):
    status, headers, page = get(place, "/")

    assert status == 200
    assert f'src="{PICTURE_PATH}"'.encode() in page
    assert headers["Content-Type"] == "text/html; charset=utf-8"
    assert "default-src 'self'" in headers["Content-Security-Policy"]
    status, headers, picture = get(place, f"/{PICTURE_PATH}")
    assert (status, picture) == (200, PICTURE)
    assert headers["Content-Type"] == "image/png"


def test_the_files_of_the_page_are_served_meanwhile(opening, place):
    names = [name for name in static_files() if name != "index.html"]
    assert "main.js" in names
    for name in names:
        content, kind = static_files()[name]
        status, headers, answer = get(place, f"/{name}")
        assert (status, answer) == (200, content)
        assert headers["Content-Type"].split(";")[0] == kind


def test_only_who_knows_the_token_sees_the_picture():
    place = listen("0.0.0.0", 0)
    with closing(Opening(PICTURE, place)):
        assert f"?token={place.token}" in url_of("0.0.0.0", place)
        page = get(place, f"/?token={place.token}")[2]
        path = f"{PICTURE_PATH}?token={place.token}"
        assert f'src="{path}"'.encode() in page
        assert get(place, f"/{path}")[2] == PICTURE
        for query in ("", "?token=", "?token=x", f"?tokens={place.token}"):
            assert get(place, f"/{query}")[2] == static_files()["index.html"][0]
            unanswered = start(place, f"GET /{PICTURE_PATH}{query} HTTP/1.1\r\nHost: a\r\n\r\n")
            assert get(place, "/main.js")[0] == 200
            unanswered.setblocking(False)
            with unanswered, pytest.raises(BlockingIOError):
                unanswered.recv(1)


def test_a_foreign_name_of_this_machine_gets_no_picture(opening, place):
    for host in ("evil.example", "[", "", "127.0.0.1.evil.example"):
        assert get(place, "/", host)[2] == static_files()["index.html"][0]
    for host in ("localhost", "[::1]:80", "127.0.0.1"):
        assert PICTURE_PATH.encode() in get(place, "/", host)[2]


@pytest.mark.parametrize(
    ("request_text", "status"),
    [
        ("POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n", 405),
        ("GET /etc/passwd HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n", 404),
        ("GET /../view.py HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n", 404),
        (f"GET /{PICTURE_PATH} HTTP/1.1\r\nHost: evil\r\nConnection: close\r\n\r\n", 404),
        ("nonsense\r\n\r\n", 400),
        ("GET / HTTP/1.1 and more\r\n\r\n", 400),
    ],
)
def test_what_is_no_file_waits_for_the_view(opening, place, result, request_text, status):
    connection = start(place, request_text)
    assert get(place, "/main.js")[0] == 200  # the request has been seen
    server = serve_result(result, "ring", opening=opening)
    try:
        answer = rest(connection)
    finally:
        server.close()
    assert int(answer.split()[1]) == status
    assert server.failure is None


def test_pages_that_came_early_are_answered_by_the_view(opening, place, result):
    seen, url = [], url_of("127.0.0.1", place)

    def early():
        with join(url) as connection:
            seen.append(look(connection))

    page = Thread(target=early)
    page.start()
    silent = start(place, "")  # a browser connects ahead of its next request
    halved = start(place, "GET /main.js HTTP/1.1\r\nHo")
    assert get(place, "/main.js")[0] == 200
    server = serve_result(result, "ring", opening=opening)
    try:
        page.join(LIMIT_S)
        silent.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n")
        halved.sendall(b"st: 127.0.0.1\r\nConnection: close\r\n\r\n")
        assert static_files()["index.html"][0] in rest(silent)
        assert static_files()["main.js"][0] in rest(halved)
        assert (server.url, server.port) == (url, place.port)
        with join(url) as connection:
            assert look(connection).is_complete
    finally:
        server.close()
    assert [page.is_complete for page in seen] == [True]
    assert server.failure is None


def test_nothing_is_served_after_it_was_closed(place):
    opening, port = Opening(PICTURE, place), place.port
    waiting = start(place, "GET /socket HTTP/1.1\r\n\r\n")
    opening.close()
    opening.close()
    with waiting, suppress(ConnectionResetError):  # its request was never read
        assert waiting.recv(1) == b""
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", port), timeout=LIMIT_S)


def test_the_browser_shows_the_picture_until_it_draws(chromium, tmp_path, result):
    result.save(tmp_path)
    place = listen("127.0.0.1", 0)
    opening = Opening((tmp_path / "map.png").read_bytes(), place)
    with closing(opening), opened(chromium, url_of("127.0.0.1", place)) as real:
        real.page.wait_for_function("document.getElementById('opening')?.naturalWidth > 0")
        assert real.page.is_visible("#opening")
        assert real.page.inner_text("#state") == "reading the map"
        assert real.page.is_hidden("#banner")
        server = serve_result(result, "ring", opening=opening)
        try:
            real.settle()
            real.page.wait_for_function("!document.getElementById('opening')")
        finally:
            server.close()
