# SPDX-License-Identifier: Apache-2.0
"""Sources over real sockets and files: senders come, stall, send nonsense, leave and come back."""

from __future__ import annotations

import errno
import json
import socket
from contextlib import ExitStack, contextmanager, suppress
from threading import Event, Thread

import pytest
import websockets.sync.client
from websockets.exceptions import InvalidStatus

from cartoloop.errors import InputError
from cartoloop.live import sockets
from cartoloop.live.address import SourceOptions, make_source
from cartoloop.live.growing_file import GrowingFile
from cartoloop.live.notices import Notices
from cartoloop.live.sockets import (
    FIRST_MESSAGE_S,
    KEEPALIVE_S,
    MAX_CLIENTS,
    SILENT_S,
    TcpSource,
    WebSocketSource,
)
from cartoloop.sensor.events import LaserScan, Odometry
from tests.limits import LIMIT_S, wait_until
from tests.live.live_room import drive

READING = b'{"type": "odometry", "x": 1, "y": 2, "theta": 0}\n'


class Running:
    """A source in a thread, and what came of it."""

    def __init__(self, source):
        self.source = source
        self.received, self.reported = [], []
        self.opened = source.open()
        self.stop = Event()
        notices = Notices(self.reported.append)
        self.thread = Thread(target=source.run, args=(self.received.append, notices, self.stop))
        self.thread.start()

    def wait_for(self, condition):
        wait_until(condition, period_s=0.005)


@contextmanager
def running(source):
    """Yield the source while it runs; it ends within a second."""
    it = Running(source)
    try:
        yield it
    finally:
        it.stop.set()
        it.thread.join(LIMIT_S)
        assert not it.thread.is_alive()


def test_tcp_senders_come_and_go():
    with running(TcpSource("127.0.0.1", 0)) as it:
        assert it.opened == f"listening on {it.source.name}"
        with socket.create_connection(it.source.address) as first:
            first.sendall(READING * 2 + READING[:20])
            with socket.create_connection(it.source.address) as second:
                second.sendall(READING)
            it.wait_for(lambda: len(it.received) == 3)
            first.sendall(READING[20:])
            it.wait_for(lambda: len(it.received) == 4)
        with socket.create_connection(it.source.address) as again:
            again.sendall(b"\xff\x00 rubbish\n" + READING)
            it.wait_for(lambda: len(it.received) == 5)
    assert any("message 1 skipped: is no JSON" in line for line in it.reported)
    assert any(" connected" in line for line in it.reported)
    assert any(" disconnected, after" in line for line in it.reported)


def test_a_sender_that_is_cut_off_is_survived():
    with running(TcpSource("127.0.0.1", 0)) as it:
        sender = socket.create_connection(it.source.address)
        sender.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\x01\0\0\0\0\0\0\0")
        sender.sendall(READING + READING[:10])
        it.wait_for(lambda: it.received)
        sender.close()  # by a reset, as when the network breaks
        it.wait_for(lambda: len(it.reported) == 2)
        with socket.create_connection(it.source.address) as again:
            again.sendall(READING)
            it.wait_for(lambda: len(it.received) == 2)
    assert "lost: " in it.reported[1]
    assert not any("skipped" in line for line in it.reported)


def test_web_sockets_carry_the_same_messages():
    with running(WebSocketSource("127.0.0.1", 0)) as it:
        url = "ws://{}:{}".format(*it.source.address)
        with websockets.sync.client.connect(url) as sender:
            sender.send(READING.decode().strip())
            sender.send(READING + READING)
            sender.send("rubbish")
            it.wait_for(lambda: len(it.received) == 3)
        with websockets.sync.client.connect(url) as again:
            again.send(READING)
            it.wait_for(lambda: len(it.received) == 4)
    assert all(isinstance(message, Odometry) for message in it.received)
    assert any("message 4 skipped: is no JSON" in line for line in it.reported)


def test_silent_connections_give_way_to_a_robot():
    with running(TcpSource("127.0.0.1", 0)) as it, ExitStack() as silent:
        for _ in range(3 * MAX_CLIENTS):
            silent.enter_context(socket.create_connection(it.source.address))
        robot = silent.enter_context(socket.create_connection(it.source.address))
        robot.sendall(READING)
        it.wait_for(lambda: it.received)
        for _ in range(MAX_CLIENTS):
            silent.enter_context(socket.create_connection(it.source.address))
        robot.sendall(READING)
        it.wait_for(lambda: len(it.received) == 2)
    assert any("closed: its place was needed, after 0 messages" in line for line in it.reported)


def test_connections_without_a_handshake_give_way():
    with running(WebSocketSource("127.0.0.1", 0)) as it, ExitStack() as silent:
        for _ in range(2 * MAX_CLIENTS):
            silent.enter_context(socket.create_connection(it.source.address))
        url = "ws://{}:{}".format(*it.source.address)
        with websockets.sync.client.connect(url) as robot:
            robot.send(READING)
            it.wait_for(lambda: it.received)


def test_robots_that_send_keep_their_places():
    with running(TcpSource("127.0.0.1", 0, clock=lambda: 0.0)) as it, ExitStack() as open_ones:
        robots = [
            open_ones.enter_context(socket.create_connection(it.source.address))
            for _ in range(MAX_CLIENTS)
        ]
        for robot in robots:
            robot.sendall(READING)
        it.wait_for(lambda: len(it.received) == MAX_CLIENTS)
        with socket.create_connection(it.source.address) as newest:
            assert newest.recv(1) == b""
        for robot in robots:
            robot.sendall(READING)
        it.wait_for(lambda: len(it.received) == 2 * MAX_CLIENTS)
    assert any("16 senders are active already" in line for line in it.reported)


@pytest.mark.parametrize(("sent", "limit_s"), [(b"", FIRST_MESSAGE_S), (READING, SILENT_S)])
def test_connections_without_messages_end(sent, limit_s):
    now = [0.0]
    source = TcpSource("127.0.0.1", 0, clock=lambda: now[0])
    with running(source) as it, socket.create_connection(it.source.address) as silent:
        silent.sendall(sent or b"{")
        it.wait_for(lambda: any("connected" in line for line in it.reported))
        it.wait_for(lambda: it.received or not sent)
        now[0] = limit_s + 1.0
        assert silent.recv(1) == b""
    assert f"closed: no message in {limit_s:.0f} s" in it.reported[-1]


def test_a_web_socket_that_does_not_answer_ends():
    now = [0.0]
    with running(WebSocketSource("127.0.0.1", 0, clock=lambda: now[0])) as it:
        url = "ws://{}:{}".format(*it.source.address)
        with websockets.sync.client.connect(url) as robot:
            robot.send(READING)
            it.wait_for(lambda: it.received)
            now[0] = KEEPALIVE_S + 1.0  # pinged, and answered by the library
            it.wait_for(lambda: it.source._clients[0].last_sign == now[0])
            now[0] = 10.0 * KEEPALIVE_S  # no answer came since, by this clock
            it.wait_for(lambda: not it.source._clients)
    assert "closed: it does not answer, after 1 messages" in it.reported[-1]


def test_incomplete_messages_do_not_fill_the_memory(monkeypatch):
    monkeypatch.setattr(sockets, "MAX_UNFINISHED_BYTES", 10_000)
    with (
        running(TcpSource("127.0.0.1", 0)) as it,
        socket.create_connection(it.source.address) as robot,
        socket.create_connection(it.source.address) as flood,
    ):
        robot.sendall(READING)
        flood.sendall(b"[" * 20_000)
        flood.settimeout(LIMIT_S)
        with suppress(ConnectionResetError):
            assert flood.recv(1) == b""
        robot.sendall(READING)
        it.wait_for(lambda: len(it.received) == 2)
    assert any("incomplete messages fill the memory" in line for line in it.reported)


class FullSocket(socket.socket):
    """Has no more file descriptors for the first connections."""

    num_failures = 3

    def accept(self):
        if self.num_failures:
            self.num_failures -= 1
            raise OSError(errno.EMFILE, "Too many open files")
        return super().accept()


@pytest.mark.parametrize("kind", [TcpSource, WebSocketSource])
def test_too_many_open_files_do_not_end_a_listener(kind):
    source = kind("127.0.0.1", 0)
    source.open()
    source.open = lambda: ""
    source._socket = FullSocket(fileno=source._socket.detach())
    with running(source) as it, socket.create_connection(source.address):
        it.wait_for(lambda: any("connected" in line for line in it.reported))
    assert it.reported[0].endswith("Too many open files")


def test_a_refused_handshake_is_answered_and_reported():
    with running(WebSocketSource("127.0.0.1", 0)) as it:
        with socket.create_connection(it.source.address) as client:
            client.sendall(b"GET / HTTP/1.1\r\nHost: a\r\n\r\n")
            assert client.recv(100).startswith(b"HTTP/1.1 426")
        it.wait_for(lambda: "refused: " in it.reported[-1])


def test_pages_in_a_browser_may_not_send_scans():
    with running(WebSocketSource("127.0.0.1", 0)) as it:
        url = "ws://{}:{}".format(*it.source.address)
        with pytest.raises(InvalidStatus):
            websockets.sync.client.connect(url, origin="https://example.org")


def test_a_log_is_followed_while_it_is_written(tmp_path):
    path = tmp_path / "a.log"
    drive(4.0).write_carmen(path)
    text = path.read_bytes()
    half = len(text) // 2
    path.write_bytes(text[:half])
    with running(GrowingFile(path)) as it:
        it.wait_for(lambda: len(it.received) > 10)
        with path.open("ab") as file:
            file.write(text[half:])
        num_scans = 21
        it.wait_for(lambda: sum(isinstance(m, LaserScan) for m in it.received) == num_scans)
        scans = [message for message in it.received if isinstance(message, LaserScan)]
        assert all(len(scan.ranges) == scan.geometry.num_beams for scan in scans)
        assert len(it.received) == 2 * num_scans

        path.write_bytes(text[: half // 4])  # started again
        it.wait_for(lambda: len(it.received) > 2 * num_scans)
    assert it.reported == ["a.log: the file was started again"]


def test_damaged_lines_of_a_log_are_reported(tmp_path):
    path = tmp_path / "a.log"
    path.write_bytes(
        b"# comment\nPARAM robot_frontlaser_offset 0.25\nPARAM robot_name karl\nODOM 1 2 3\n"
        b"ODOM 1 2 0 0 0 0 5.0 host 0.1\nFLASER 3 1 2 x 0 0 0 0 0 0 5 h 1\nHELLO\nGPS 1 2\n"
        b"FLASER 3 1.0 2.0 3.0 0 0 0 0.5 0 0 5.1 host 0.2\n"
        b"ROBOTLASER1 0 -1 2 1 30 0 0 3 1 2 3 0 0 0 0 0 0 0 0 0 0 0 5.2 host 0.3\n"
    )
    with running(GrowingFile(path)) as it:
        it.wait_for(lambda: len(it.received) == 3)
    _, odometry, scan = it.received
    assert odometry.tf_odom_tracking.x == 0.5
    assert scan.geometry.tf_tracking_sensor.x == 0.25
    assert [line.partition(": ")[2] for line in it.reported] == [
        "message 4 skipped: an ODOM line has 7 or 10 tokens, this one 4",
        "message 6 skipped: 'x' is not a number",
        "message 7 skipped: unknown line 'HELLO'",
    ]


def test_a_file_of_messages_is_followed_too(tmp_path):
    path = tmp_path / "a.ndjson"
    path.write_bytes(READING)
    with running(GrowingFile(path)) as it:
        it.wait_for(lambda: len(it.received) == 1)
        assert json.loads(READING)["x"] == it.received[0].tf_odom_tracking.x


@pytest.mark.parametrize(
    ("text", "host", "reported"),
    [
        ("tcp://0.0.0.0:7000", None, "allow it with --source-host 0.0.0.0"),
        ("ws://robot.local:7000", None, "allow it with --source-host robot.local"),
        ("tcp://127.0.0.1", None, "names no port"),
        ("tcp://127.0.0.1:99999", None, "Port out of range"),
        ("http://127.0.0.1:80", None, "no such source; known are -, tcp://"),
        ("ros2:home", None, "no domain of ROS 2"),
        ("nothing.log", None, "nothing.log: cannot be read: No such file"),
        ("tcp://127.0.0.1:7000", "no.such.host.invalid", "there is no such host"),
    ],
)
def test_unusable_addresses_are_refused(text, host, reported):
    with pytest.raises(InputError) as error:
        make_source(text, SourceOptions(host)).open()

    assert reported in str(error.value)
    assert "\n" not in str(error.value)


def test_a_port_in_use_is_reported():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match="cannot listen there: Address already in use"):
            TcpSource("127.0.0.1", port).open()


def test_a_bag_cannot_be_followed(tmp_path):
    (tmp_path / "a").write_bytes(b"#ROSBAG V2.0\n")
    with pytest.raises(InputError, match="is a ROS recording and cannot be followed"):
        GrowingFile(tmp_path / "a").open()


def test_a_compressed_log_cannot_be_followed(tmp_path):
    drive(1.0).write_carmen(tmp_path / "a.log.gz")
    with pytest.raises(InputError, match="use 'cartoloop map'"):
        GrowingFile(tmp_path / "a.log.gz").open()


def test_the_host_is_the_users():
    source = make_source("tcp://:7001", SourceOptions("0.0.0.0"))
    assert source.name == "tcp://0.0.0.0:7001"
    assert make_source("ws://localhost:7001", SourceOptions()).name == "ws://localhost:7001"
    assert make_source("-", SourceOptions()).name == "standard input"
