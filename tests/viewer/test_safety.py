# SPDX-License-Identifier: Apache-2.0
"""Who may look, what is served, and what becomes of those who send nonsense."""

from __future__ import annotations

import socket
import threading
from contextlib import ExitStack
from http.client import HTTPConnection

import pytest
from websockets.exceptions import ConnectionClosed, InvalidMessage, InvalidStatus

from cartoloop.config import SubmapConfig
from cartoloop.errors import ServeError
from cartoloop.viewer.live_state import LiveState
from cartoloop.viewer.parts import Latest
from cartoloop.viewer.protocol import MessageType
from cartoloop.viewer.readings import Readings
from cartoloop.viewer.requests import MAX_REQUEST_BYTES
from cartoloop.viewer.server import ViewServer
from cartoloop.viewer.site import static_files
from cartoloop.viewer.subscriptions import key_of
from tests.limits import LIMIT_S, wait_until
from tests.viewer.page_twin import join, look


def empty_state():
    return LiveState("nothing", "recording", SubmapConfig(), Readings(None, None))


@pytest.fixture(scope="module")
def server():
    server = ViewServer(empty_state(), port=0)
    yield server
    server.close()
    assert server.failure is None


@pytest.fixture(scope="module")
def open_server():
    """One that other machines can reach."""
    server = ViewServer(empty_state(), host="0.0.0.0", port=0)
    yield server
    server.close()


def url_of(server, query=""):
    return f"http://127.0.0.1:{server.port}/{query}"


@pytest.fixture
def get(server):
    """Return status, headers and content of what is served at a path."""
    connection = HTTPConnection("127.0.0.1", server.port, timeout=LIMIT_S)

    def get(path, method="GET"):
        connection.request(method, path)
        answer = connection.getresponse()
        return answer.status, dict(answer.getheaders()), answer.read()

    yield get
    connection.close()


def test_a_page_of_our_own_gets_the_state_of_an_empty_map(server):
    with join(server.url) as connection:
        page = look(connection)

    assert page.order == [
        MessageType.HELLO, MessageType.PLAYBACK, MessageType.READINGS, MessageType.COMPLETE,
    ]  # fmt: skip
    assert page.readings["text"] == "waiting for the first scan"


@pytest.mark.parametrize(
    "origin",
    [
        None, "null", "http://evil.example", "http://127.0.0.1:1", "http://127.0.0.1", "http://[",
        "http://[::1", "http://[no address]", "//", ":", "\t", "http://" + 2000 * "a",
    ],
)  # fmt: skip
def test_pages_of_others_are_refused(server, origin):
    with pytest.raises(InvalidStatus) as refused, join(server.url, origin=origin):
        pass

    assert refused.value.response.status_code == 403


def test_a_foreign_name_that_leads_here_is_refused(server):
    """DNS rebinding: origin and host agree, but no page of ours was called by such a name."""
    name = f"http://evil.example:{server.port}"
    with socket.create_connection(("127.0.0.1", server.port)) as raw:
        refused = pytest.raises(InvalidStatus)
        with refused, join(f"{name}/", sock=raw):
            pass

    assert refused.excinfo.value.response.status_code == 403


@pytest.mark.parametrize("query", ["", "?token=", "?token=wrong", "?token=%C3%A9", "?other=1"])
def test_other_machines_need_the_token(open_server, query):
    with pytest.raises(InvalidStatus) as refused, join(url_of(open_server, query)):
        pass

    assert refused.value.response.status_code == 403


def test_url_holds_the_token(open_server):
    query = open_server.url[open_server.url.index("?") :]

    with join(url_of(open_server, query)) as connection:
        assert look(connection).is_complete
    assert len(query) > 20
    assert "token" not in ViewServer.__doc__


def test_each_server_has_a_token_of_its_own(open_server):
    other = ViewServer(empty_state(), host="0.0.0.0", port=0)
    other.close()

    assert other.url.rpartition("=")[2] != open_server.url.rpartition("=")[2]


@pytest.mark.parametrize(
    ("sent", "code"),
    [
        ("", 1008),
        ("{", 1008),
        ("[]", 1008),
        ("null", 1008),
        ('"play"', 1008),
        ('{"type": "unknown"}', 1008),
        ('{"type": "play", "more": 1}', 1008),
        ('{"type": "speed", "value": 0}', 1008),
        ('{"type": "speed", "value": -1}', 1008),
        ('{"type": "speed", "value": NaN}', 1008),
        ('{"type": "speed", "value": "fast"}', 1008),
        ('{"type": "speed"}', 1008),
        ('{"type": "node_scan", "id": 1, "node": -1}', 1008),
        ('{"type": "node_scan", "id": 1, "node": 1.5}', 1008),
        ('{"type": "ping", "id": 1e300}', 1008),
        ('{"type": "ping", "id": {"a": [[[[]]]]}}', 1008),
        (b"\x00\x01", 1003),
        ("x" * (MAX_REQUEST_BYTES + 1), 1009),
        ("ä" * (MAX_REQUEST_BYTES // 2 + 1), 1009),
        (b"x" * 50_000, 1009),
    ],
)
def test_nonsense_ends_the_connection_and_not_the_server(server, sent, code):
    with join(server.url) as connection:
        look(connection)
        with pytest.raises(ConnectionClosed) as closed:
            connection.send(sent)
            while True:
                connection.recv(timeout=LIMIT_S)
        assert closed.value.rcvd.code == code
    with join(server.url) as connection:
        assert look(connection).is_complete


@pytest.mark.parametrize(
    "sent",
    [
        b"\x00" * 100,
        b"\xff" * 100,
        b"\x81\x05hello",  # not masked
        b"\x83\x80\x00\x00\x00\x00",  # a kind that there is not
        b"\xf1\x80\x00\x00\x00\x00",  # extensions that were not agreed on
        b"\x81\xff" + b"\x7f" + b"\xff" * 7 + bytes(4),  # 2**63 bytes to come
        b"\x01\xfe\x02\x00" + bytes(4) + 512 * b" " + b"\x00\xfe\x02\x00" + bytes(4) + 512 * b" ",
        b"\x81\x82" + bytes(4) + b"\xc3\x28",  # no UTF-8
        b"GET / HTTP/1.1\r\n\r\n",
    ],
)
def test_broken_websocket_ends_only_its_connection(server, sent):
    with join(server.url) as connection:
        look(connection)
        with pytest.raises(ConnectionClosed):
            connection.socket.sendall(sent)
            while True:
                connection.recv(timeout=LIMIT_S)
    with join(server.url) as connection:
        assert look(connection).is_complete


@pytest.mark.parametrize(
    "sent",
    [
        b"\x00\x01\x02\r\n\r\n",
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03\r\n\r\n",  # TLS
        b"GET / HTTP/1.1\r\n\r\n",
        b"GET /" + 200_000 * b"a" + b" HTTP/1.1\r\nHost: a\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: a\r\n" + b"A: b\r\n" * 50_000 + b"\r\n",
        b"POST /socket HTTP/1.1\r\nHost: a\r\nContent-Length: 99999999999\r\n\r\n",
        b"GET /socket HTTP/1.1\r\nHost: a\r\nConnection: upgrade\r\nUpgrade: websocket\r\n\r\n",
    ],
)
def test_what_is_no_request_is_refused(server, sent):
    with socket.create_connection(("127.0.0.1", server.port), timeout=LIMIT_S) as raw:
        try:
            raw.sendall(sent)
            raw.shutdown(socket.SHUT_WR)
            answer = b"".join(iter(lambda: raw.recv(65536), b""))
        except OSError:  # it has heard enough
            answer = b""
    assert answer == b"" or 400 <= int(answer.split()[1]) < 600
    with join(server.url) as connection:
        assert look(connection).is_complete


def test_those_who_ask_nothing_make_room(server, monkeypatch):
    monkeypatch.setattr("cartoloop.viewer.connections.MAX_CONNECTIONS", 10)
    with ExitStack() as stack:
        pages = [stack.enter_context(join(server.url)) for _ in range(5)]
        for _ in range(40):
            raw = socket.create_connection(("127.0.0.1", server.port), timeout=LIMIT_S)
            stack.enter_context(raw)
        late = stack.enter_context(join(server.url))
        for connection in (late, *pages):
            assert look(connection).is_complete
        wait_until(lambda: server.num_connections <= 10)


def test_pages_beyond_the_limit_are_refused(server, monkeypatch):
    wait_until(lambda: server.num_connections == 0)
    monkeypatch.setattr("cartoloop.viewer.connections.MAX_CONNECTIONS", 10)
    with ExitStack() as stack:
        pages = [stack.enter_context(join(server.url)) for _ in range(10)]
        with pytest.raises((OSError, EOFError, InvalidMessage, ConnectionClosed)), join(server.url):
            pass
        for connection in pages:
            assert look(connection).is_complete


def test_it_closes_at_once_though_pages_read_nothing():
    others = set(threading.enumerate())
    server = ViewServer(empty_state(), port=0)
    (thread,) = (one for one in threading.enumerate() if one not in others)
    with ExitStack() as stack:
        for _ in range(5):
            stack.enter_context(join(server.url))
            raw = socket.create_connection(("127.0.0.1", server.port))
            stack.enter_context(raw)
        server.close()
        thread.join(LIMIT_S)
        assert not thread.is_alive()
    assert server.failure is None


def test_what_goes_wrong_for_a_page_is_kept_and_others_go_on():
    class Broken(Latest):
        def news(self, seen):
            raise ArithmeticError("one and one is three")

    state = empty_state()
    server = ViewServer(state, port=0)
    with join(server.url) as early:
        page = look(early)
        server.call_and_wait(lambda: state.parts.update({key_of(MessageType.SCAN): Broken()}))
        with join(server.url) as connection, pytest.raises(ConnectionClosed):
            while True:
                connection.recv(timeout=LIMIT_S)
        early.send('{"type": "ping", "id": 1}')
        look(early, page, lambda page: page.answers)
    server.close()
    assert isinstance(server.failure, ArithmeticError)


def test_one_that_vanishes_leaves_no_trace(server):
    for _ in range(3):
        with join(server.url) as connection:
            look(connection)
            connection.socket.shutdown(socket.SHUT_RDWR)
    with join(server.url) as connection:
        assert look(connection).is_complete


def test_a_hail_of_requests_is_answered_late(server):
    with join(server.url) as connection:
        page = look(connection)
        for number in range(40):
            connection.send(f'{{"type": "ping", "id": {number}}}')
        look(connection, page, lambda page: len(page.answers) == 40)
    assert [content["id"] for _, content in page.answers] == list(range(40))


@pytest.mark.parametrize(
    "path",
    [
        "../protocol.py",
        "%2e%2e/protocol.py",
        "..%2fprotocol.py",
        "....//protocol.py",
        "static/../../protocol.py",
        "/etc/passwd",
        "%2fetc%2fpasswd",
        "//etc/passwd",
        "..\\protocol.py",
        "index.html%00.js",
        "index.html/",
        "socket",
        ".",
        "viewer",
    ],
)
def test_nothing_but_the_packaged_files_is_served(server, path):
    request = f"GET /{path} HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\nConnection: close\r\n\r\n"
    with socket.create_connection(("127.0.0.1", server.port), timeout=LIMIT_S) as raw:
        raw.sendall(request.encode())
        answer = b"".join(iter(lambda: raw.recv(65536), b""))

    status = int(answer.split()[1])
    assert status in (400, 404)
    assert b"root:" not in answer
    assert b"SPDX" not in answer


def test_the_page_and_its_files_are_served_with_their_types(get):
    status, headers, page = get("/")
    assert (status, page) == (200, static_files()["index.html"][0])
    assert headers["content-type"].startswith("text/html")
    assert "default-src 'self'" in headers["content-security-policy"]
    assert headers["x-content-type-options"] == "nosniff"
    for name, (content, kind) in static_files().items():
        status, headers, answer = get(f"/{name}")
        assert (status, answer) == (200, content)
        assert headers["content-type"].split(";")[0] == kind
    assert any(kind == "text/javascript" for _, kind in static_files().values())


def test_the_page_loads_nothing_from_elsewhere():
    for name, (content, _) in static_files().items():
        if name.endswith((".html", ".js", ".css")):
            for scheme in (b"https://", b"http://", b"//cdn"):
                assert scheme not in content, name


def test_pages_are_read_only(get):
    assert get("/", "POST")[0] == 405
    assert get("/index.html", "DELETE")[0] == 405


def test_a_port_that_is_taken_leads_to_the_next(server):
    other = ViewServer(empty_state(), port=server.port)
    try:
        assert server.port < other.port < server.port + 20
        with join(other.url) as connection:
            assert look(connection).is_complete
    finally:
        other.close()


def test_impossible_addresses_are_errors_of_one_line():
    for host, port in (("192.0.2.1", 8765), ("no such host", 8765)):
        with pytest.raises(ServeError) as error:
            ViewServer(empty_state(), host=host, port=port)
        assert "\n" not in str(error.value)
        assert host in str(error.value)
