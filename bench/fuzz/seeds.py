# SPDX-License-Identifier: Apache-2.0
"""Sound inputs of each kind, small, to be changed: of simulated drives, and of recordings."""

from __future__ import annotations

import gzip
import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from cartoloop.config import Config
from cartoloop.config_file import config_toml
from cartoloop.mapper import Mapper
from cartoloop.result import edit
from cartoloop.sensor.events import LaserScan, Odometry, SensorEvent
from cartoloop.simulation import ring, simulate
from cartoloop.simulation.recording import Recording

HEAD_BYTES = 60_000
"""Of a recording in the folder of data [bytes]."""

URDF = b"""<?xml version="1.0"?>
<robot name="r">
  <link name="base_link"/><link name="laser"/>
  <joint name="a" type="fixed"><parent link="base_link"/><child link="laser"/>
    <origin xyz="0.1 -0.2 0.3" rpy="3.14 0 1.5"/></joint>
</robot>"""


@dataclass
class Seeds:
    """Files by kind, in a folder.

    Attributes
    ----------
    folder : with the files of `files`.
    contents : inputs by kind.
    """

    folder: Path
    contents: dict[str, list[bytes]] = field(default_factory=dict)

    def add(self, kind: str, *contents: bytes) -> None:
        """Add inputs of a kind."""
        self.contents.setdefault(kind, []).extend(contents)


def make_seeds(folder: Path, data: Path | None = None) -> Seeds:
    """Return inputs of each kind, made in a folder.

    Parameters
    ----------
    folder : to be filled.
    data : folder of recordings whose beginnings are used too; none if None.
    """
    drive = simulate(ring(), seed=1, duration=4.0)
    seeds = Seeds(folder)
    events = list(drive.events())
    _add_texts(seeds, drive, events)
    _add_bags(seeds, drive)
    _add_map(seeds, events)
    _add_live(seeds, events)
    seeds.add("config", config_toml(Config()).encode(), b"[sensor]\nrange_max = 20.0\n")
    seeds.add("urdf", URDF)
    for path in sorted(data.rglob("*")) if data is not None else []:
        if path.name.endswith((".clf", ".log")):
            with path.open("rb") as file:
                seeds.add("text", file.read(HEAD_BYTES))
        elif path.name.endswith(".gz"):
            with gzip.open(path) as file:
                seeds.add("text", file.read(HEAD_BYTES))
    return seeds


def _add_texts(seeds: Seeds, drive: Recording, events: list[SensorEvent]) -> None:
    drive.write_carmen(seeds.folder / "a.log")
    text = (seeds.folder / "a.log").read_bytes()
    seeds.add("text", text)
    scans = [event for event in events if isinstance(event, LaserScan)]
    lines = [" ".join(f"{r:.2f}" for r in scan.ranges[::6]) for scan in scans]
    count = len(lines[0].split())
    mount = "0.1 0 0 0 0 0 0 0 0 0 0"
    seeds.add(
        "text",
        "".join(
            f"ROBOTLASER1 0 -1.57 3.14 0.1 30 0 0 {count} {line} 0 {mount} {i}.5 host {i}\n"
            f"ODOM 0 0 0 0 0 0 {i} host {i}\n"
            for i, line in enumerate(lines)
        ).encode(),
        b"# angle_min=-1.5708 angle_increment=0.1\ntime,x,y,theta,ranges\n"
        + "".join(f"{i},0,0,0,{line.replace(' ', ',')}\n" for i, line in enumerate(lines)).encode(),
        "".join(
            f"Odometry {i} 0 0\nLaser {count} {line}\n" for i, line in enumerate(lines)
        ).encode(),
        "".join(
            f"{i}00000 0 {i} {i} " + "0 " * 20 + " ".join(["1500"] * 682) + "\n" for i in range(8)
        ).encode(),
    )
    drive.write_truth(seeds.folder / "a.tum")
    drive.write_relations(seeds.folder / "a.relations", 30)
    seeds.add("tum", (seeds.folder / "a.tum").read_bytes())
    seeds.add("relations", (seeds.folder / "a.relations").read_bytes())
    seeds.add("lines", b"0 0 1 0 1.0\n# comment\n0 0 0 2 2.05\n")


def _add_bags(seeds: Seeds, drive: Recording) -> None:
    from rosbags.rosbag1 import Reader
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    path = seeds.folder / "a.bag"
    drive.write_bag(path)
    seeds.add("bag", path.read_bytes())
    store = get_typestore(Stores.ROS2_HUMBLE)
    for plugin, packed in ((StoragePlugin.SQLITE3, False), (StoragePlugin.MCAP, False),
                           (StoragePlugin.MCAP, True)):  # fmt: skip
        folder = seeds.folder / f"{plugin.name}{packed}"
        writer = Writer(folder, version=9, storage_plugin=plugin)
        if packed:
            writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        with Reader(path) as reader, writer:
            added = {}
            for connection, time, raw in reader.messages():
                if connection.topic not in added:
                    added[connection.topic] = writer.add_connection(
                        connection.topic, connection.msgtype, typestore=store
                    )
                cdr = store.ros1_to_cdr(raw, connection.msgtype)
                writer.write(added[connection.topic], time, cdr)
                if plugin is StoragePlugin.MCAP and not packed:
                    seeds.add(f"cdr {connection.msgtype}", bytes(cdr))
        ending = ".db3" if plugin is StoragePlugin.SQLITE3 else ".mcap"
        file = next(file for file in folder.iterdir() if file.name.endswith(ending))
        seeds.add(ending.removeprefix("."), file.read_bytes())


def _add_map(seeds: Seeds, events: list[SensorEvent]) -> None:
    mapper = Mapper()
    for event in events:
        mapper.add(event)
    folder = seeds.folder / "map"
    mapper.finish().save(folder)
    seeds.add("map", (folder / "map.cartoloop").read_bytes())
    with edit(folder) as editor:
        editor.pin_node(0, (1.0, 2.0, 0.5))
        editor.set_control_points([(0, 0, 5, 5), (1, 0, 5, 6)])
        editor.forget_area(1.0, 6.0, 3.0, 8.0)
        editor.forget_time(editor.map.stamps[-1], editor.map.stamps[-1])
        editor.split_session(0, editor.map.stamps[len(editor.map.stamps) // 2])
    seeds.add("map", (folder / "map.cartoloop").read_bytes())
    seeds.add("yaml", (folder / "map.yaml").read_bytes())
    seeds.add("png", (folder / "map.png").read_bytes())
    seeds.add("pgm", (folder / "map.pgm").read_bytes())


def _add_live(seeds: Seeds, events: list[SensorEvent]) -> None:
    lines = [json.dumps({"type": "imu", "linear_acceleration": [0, 0, 9.8],
                         "angular_velocity": [0, 0, 0.1]})]  # fmt: skip
    points = np.round(np.random.default_rng(1).uniform(-3.0, 3.0, (20, 3)), 2).tolist()
    lines.append(json.dumps({"type": "cloud", "stamp": 1.0, "points": points}))
    for event in events:
        if isinstance(event, LaserScan):
            scan = {
                "type": "scan", "stamp": event.stamp, "angle_min": -1.57, "angle_increment": 0.1,
                "ranges": event.ranges[::6].tolist(), "range_max": 30.0, "pose": [0.1, 0.0, 0.0],
                "sensor": "front",
            }  # fmt: skip
            lines.append(json.dumps(scan))
        elif isinstance(event, Odometry):
            x, y, theta = event.tf_odom_tracking
            lines.append(
                json.dumps(
                    {"type": "odometry", "stamp": event.stamp, "x": x, "y": y, "theta": theta}
                )
            )
    seeds.add("live", "\n".join(lines).encode() + b"\n")
    requests = (
        '{"type": "play"}', '{"type": "speed", "value": 2.0}',
        '{"type": "closure", "id": 1, "constraint": 0}',
        '{"type": "node_scan", "id": 2, "node": 1}',
        '{"type": "picture", "id": 3}', '{"type": "ping", "id": 4}',
        '{"type": "drop_closure", "id": 5, "submap": 0, "node": 1}',
        '{"type": "undo_edit", "id": 6, "edit": 0}', '{"type": "redo_edit", "id": 7, "edit": 0}',
    )  # fmt: skip
    seeds.add("request", *(request.encode() for request in requests))
    seeds.add("handshake", _handshake())


def _handshake() -> bytes:
    """Return what a robot sends over a WebSocket: handshake, two messages, a ping, the end."""
    from websockets.client import ClientProtocol
    from websockets.server import ServerProtocol
    from websockets.uri import parse_uri

    client, server = ClientProtocol(parse_uri("ws://127.0.0.1:7000/")), ServerProtocol()
    request = client.connect()
    client.send_request(request)
    sent = b"".join(client.data_to_send())
    server.receive_data(sent)
    server.send_response(server.accept(request))
    client.receive_data(b"".join(server.data_to_send()))
    for text in (b'{"type": "odometry", "x": 0, "y": 0, "theta": 0}', b'{"type": "end"}'):
        client.send_text(text)
    client.send_ping(b"x")
    client.send_close(1000)
    return sent + b"".join(client.data_to_send())
