# SPDX-License-Identifier: Apache-2.0
"""What is done with an input of each kind: everything that reads it, up to where it is used."""

from __future__ import annotations

import gzip
import shutil
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import NamedTuple

from bench.fuzz.mutations import mutate_arguments, mutate_database, mutated
from bench.fuzz.seeds import Seeds
from cartoloop.config_file import load_config
from cartoloop.errors import CartoloopError
from cartoloop.evaluation import lines, map_image, relations, trajectories
from cartoloop.live.growing_file import GrowingFile
from cartoloop.live.inbox import Inbox
from cartoloop.live.messages import LiveMessage, MessageError
from cartoloop.live.notices import Notices
from cartoloop.live.ros_messages import RosParser
from cartoloop.live.sequencer import Sequencer
from cartoloop.live.source import LineReceiver
from cartoloop.live.web_socket import WebSocketReceiver
from cartoloop.mapper import Mapper
from cartoloop.plain_text import one_line
from cartoloop.readers import open_log
from cartoloop.readers.ros.urdf import read_urdf
from cartoloop.readers.ros.zstd import zstd
from cartoloop.result import load_map
from cartoloop.viewer.feed import whole
from cartoloop.viewer.live_state import LiveState
from cartoloop.viewer.readings import Readings
from cartoloop.viewer.requests import BadRequestError, parse_request

Make = Callable[[Random, Seeds, Path], list[str]]
"""Writes an input into a folder; returns what it is called with, mostly the path."""

Use = Callable[[list[str]], None]


class Target(NamedTuple):
    """A kind of input.

    Attributes
    ----------
    name : of the kind.
    weight : share of the inputs.
    make, use : see their types; `use` may raise a `CartoloopError` and nothing else.
    """

    name: str
    weight: int
    make: Make
    use: Use


def _file(kind: str, name: str, pack: Callable[[bytes], bytes] | None = None) -> Make:
    def make(random: Random, seeds: Seeds, folder: Path) -> list[str]:
        contents = seeds.contents[kind]
        content = mutated(random, random.choice(contents), random.choice(contents))
        if pack is not None:
            content = pack(content)
            content = mutated(random, content) if random.random() < 0.1 else content
        path = folder / name
        path.write_bytes(content)
        return [str(path)]

    return make


def _database(kind: str, name: str) -> Make:
    def make(random: Random, seeds: Seeds, folder: Path) -> list[str]:
        path = folder / name
        path.write_bytes(seeds.contents[kind][0])
        mutate_database(random, path)
        return [str(path)]

    return make


def _read_log(arguments: list[str]) -> None:
    log = open_log(arguments[0])
    for number, _ in enumerate(log):
        if number == 500:
            break
    for _ in (log.description, log.duration, log.problems):
        pass  # computed when they are asked for


def _map_log(arguments: list[str]) -> None:
    """Map a recording in memory, up to the drawn map."""
    log = open_log(arguments[0])
    mapper = Mapper()
    try:
        for number, event in enumerate(log):
            mapper.add(event)
            if number == 60:
                break
        mapper.finish().occupancy_map()
    finally:
        mapper.close()


def _show_map(arguments: list[str]) -> None:
    result = load_map(arguments[0])
    readings = Readings(result.report.input.scans, result.report.input.duration_s)
    state = LiveState("a", "finished", result.config.local_slam.submaps, readings)
    readings.end("finished")
    state.apply(whole(result))
    state.refresh()
    subscription = state.subscribe()
    for _ in range(100):
        if not subscription.bundle(state.parts):
            break


def _read_config(arguments: list[str]) -> None:
    load_config(Path(arguments[0]))


def _read_evaluation(arguments: list[str]) -> None:
    path = Path(arguments[0])
    readers: dict[str, Callable[[Path], object]] = {
        ".tum": trajectories.read_tum,
        ".relations": relations.read_relations,
        ".lines": lines.read_lines,
        ".yaml": map_image.read_map,
    }
    readers[path.suffix](path)


def _image(kind: str) -> Make:
    def make(random: Random, seeds: Seeds, folder: Path) -> list[str]:
        image = mutated(random, seeds.contents[kind][0])
        (folder / f"map.{kind}").write_bytes(image)
        description = seeds.contents["yaml"][0].replace(b"map.pgm", f"map.{kind}".encode())
        if random.random() < 0.5:
            description = mutated(random, description)
        (folder / "map.yaml").write_bytes(description)
        return [str(folder / "map.yaml")]

    return make


def _lines_of(arguments: list[str]) -> bytes:
    return Path(arguments[0]).read_bytes()


def _map_live(arguments: list[str]) -> None:
    """Pass messages on as a session does, with a clock of its own."""
    now = [0.0]
    notices = Notices(_require_plain)
    inbox, sequencer = Inbox(clock=lambda: now[0]), Sequencer(notices)
    mapper = Mapper(live=True)

    def put(message: LiveMessage) -> None:
        now[0] += 0.05
        inbox.put(message)
        for arrival in inbox.take(0.0):
            sequencer.add(arrival)
        for event, _ in sequencer.ready(now[0]):
            mapper.add(event)

    try:
        receiver = LineReceiver(put, notices, "fuzz")
        receiver.feed(_lines_of(arguments))
        receiver.end()
        for event, _ in sequencer.ready(float("inf")):
            mapper.add(event)
        mapper.finish()
    finally:
        mapper.close()


def _receive_live(arguments: list[str]) -> None:
    notices = Notices(_require_plain)
    receiver = LineReceiver(lambda _: None, notices, "fuzz")
    content = _lines_of(arguments)
    for start in range(0, len(content), 1000):
        receiver.feed(content[start : start + 1000])
    receiver.end()


def _receive_socket(arguments: list[str]) -> None:
    notices = Notices(_require_plain)
    receiver = WebSocketReceiver(LineReceiver(lambda _: None, notices, "fuzz"))
    content = _lines_of(arguments)
    for start in range(0, len(content), 300):
        receiver.feed(content[start : start + 300])
        receiver.ping()
        receiver.answer()
        if receiver.is_over:
            break
    receiver.say_goodbye()
    receiver.end()


def _follow(arguments: list[str]) -> None:
    source = GrowingFile(Path(arguments[0]))
    source.open()
    received: list[LiveMessage] = []
    receiver = LineReceiver(received.append, Notices(_require_plain), "fuzz", source.parse)
    receiver.feed(_lines_of(arguments))
    receiver.end()


def _decode_cdr(arguments: list[str]) -> None:
    msgtype, path = arguments
    parser = RosParser(Notices(_require_plain))
    raw = Path(path).read_bytes()
    try:
        if msgtype.endswith("TFMessage"):
            parser.add_transforms(raw)
        else:
            parser.parse("/topic", msgtype, raw)
    except MessageError as error:
        raise CartoloopError(str(error)) from error


def _cdr(random: Random, seeds: Seeds, folder: Path) -> list[str]:
    kind = random.choice(sorted(kind for kind in seeds.contents if kind.startswith("cdr ")))
    [path] = _file(kind, "a.cdr")(random, seeds, folder)
    return [kind.removeprefix("cdr "), path]


def _request(arguments: list[str]) -> None:
    text = _lines_of(arguments).decode("utf-8", "replace")
    try:
        parse_request(text)
    except BadRequestError as error:
        raise CartoloopError(str(error)) from error


COMMANDS = (
    ["config", "show", "--set", "local_slam.submaps.resolution=0.1"],
    ["config", "check", "a.toml"],
    ["doctor", "a.log"],
    ["doctor", "a.log", "--json"],
    ["map", "a.log", "-o", "out", "--laser-pose", "0.2,0,0", "--threads", "1"],
    ["map", "a.log", "-o", "out", "--draw", "trajectory", "--set", "sensor.range_max=5"],
    ["evaluate", "trajectory", "a.tum", "a.tum"],
    ["evaluate", "relations", "a.tum", "a.relations", "--json"],
    ["evaluate", "lines", "map", "a.lines"],
    ["evaluate", "closures", "map"],
    ["evaluate", "make-relations", "map", "-o", "made.relations"],
    ["explain", "map", "--pair", "0", "1"],
    ["explain", "map", "--near", "0.5", "1.0"],
    ["quality", "map", "--json"],
    ["simulate", "ring", "-o", "new.log", "--seed", "3", "--duration", "1"],
)
OPTIONS = (
    "--json", "--strict", "--help", "--set", "--config", "a.toml", "--urdf", "a.urdf", "--draw",
    "--laser-pose", "--scan-topic", "/scan", "--odom-topic", "--threads", "0", "map", "a.log",
    "--set=local_slam.submaps.resolution=nan", "--lidar", "--tilt-deg", "--glass", "2", "-o", "--",
    "\x1b[2J", "größe", "\udcff",
)  # fmt: skip


def _command(random: Random, seeds: Seeds, folder: Path) -> list[str]:
    for name, kind in (
        ("a.log", "text"), ("a.toml", "config"), ("a.tum", "tum"), ("a.relations", "relations"),
        ("a.lines", "lines"), ("a.urdf", "urdf"),
    ):  # fmt: skip
        content = seeds.contents[kind][0][:20_000]
        (folder / name).write_bytes(mutated(random, content) if random.random() < 0.3 else content)
    shutil.copytree(seeds.folder / "map", folder / "map", dirs_exist_ok=True)
    arguments = mutate_arguments(random, random.choice(COMMANDS), OPTIONS)
    if arguments[0] == "simulate":
        arguments += ["--duration", "1"]
    return arguments


def _run_command(arguments: list[str]) -> None:
    """Run a command line in this process; its status and its last line must be stated ones."""
    import io
    from contextlib import redirect_stderr, redirect_stdout

    from cartoloop.cli.main import run

    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        status = run(arguments)
    said = err.getvalue()
    if status not in (0, 1, 2, 3) or "Traceback" in said or "this is a bug" in said:
        raise AssertionError(f"status {status}: {said[-500:]}")
    if status:
        raise CartoloopError("refused")


def _require_plain(line: str) -> None:
    if line != one_line(line):
        raise AssertionError(f"a line with control characters: {line!r}")


TARGETS = (
    Target("text", 20, _file("text", "a.log"), _read_log),
    Target("gzip", 5, _file("text", "a.log.gz", gzip.compress), _read_log),
    Target("mapped text", 2, _file("text", "a.log"), _map_log),
    Target("bag", 5, _file("bag", "a.bag"), _read_log),
    Target("db3", 2, _file("db3", "a.db3"), _read_log),
    Target("db3 rows", 3, _database("db3", "a.db3"), _read_log),
    Target("mcap", 5, _file("mcap", "a.mcap"), _read_log),
    Target("packed mcap", 2, _file("mcap", "a.mcap.zst", zstd.compress), _read_log),
    Target("map", 5, _file("map", "map.cartoloop"), _show_map),
    Target("map rows", 10, _database("map", "map.cartoloop"), _show_map),
    Target("config", 8, _file("config", "a.toml"), _read_config),
    Target("urdf", 8, _file("urdf", "a.urdf"), lambda a: _discard(read_urdf(Path(a[0])))),
    Target("tum", 3, _file("tum", "a.tum"), _read_evaluation),
    Target("relations", 3, _file("relations", "a.relations"), _read_evaluation),
    Target("lines", 3, _file("lines", "a.lines"), _read_evaluation),
    Target("image", 2, _image("png"), _read_evaluation),
    Target("pgm", 2, _image("pgm"), _read_evaluation),
    Target("messages", 15, _file("live", "a.ndjson"), _receive_live),
    Target("mapped messages", 3, _file("live", "a.ndjson"), _map_live),
    Target("web socket", 10, _file("handshake", "a.bin"), _receive_socket),
    Target("growing log", 5, _file("text", "a.log"), _follow),
    Target("ros 2 messages", 15, _cdr, _decode_cdr),
    Target("view", 10, _file("request", "a.json"), _request),
    Target("command line", 1, _command, _run_command),
)


def _discard(_: object) -> None:
    """Return None: what was read is of no use."""
