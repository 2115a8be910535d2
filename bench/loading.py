# SPDX-License-Identifier: Apache-2.0
"""How long a saved map takes to load: until it can be gone on with, and until it is seen."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import time
from http.client import HTTPConnection
from pathlib import Path
from urllib.parse import urlsplit

from bench.command_runs import CommandFailed
from bench.record import Figure, Row

_LOAD = """\
import time, json, sys
from cartoloop.result import load_map
a = time.perf_counter(), time.process_time()
load_map(sys.argv[1])
b = time.perf_counter(), time.process_time()
print(json.dumps([b[0] - a[0], b[1] - a[1], b[1]]))
"""


def loading_rows(name: str, out: Path, repeats: int) -> list[Row]:
    """Return how long new processes take to have a map, and to show a picture of it.

    Parameters
    ----------
    name : of the recording.
    out : folder of the map.
    repeats : of each measurement.

    Raises
    ------
    CommandFailed
        No picture is served.
    """
    loaded = [_loaded(out) for _ in range(repeats)]
    shown = [first_picture(out) for _ in range(repeats)]
    return [
        Row(
            {"recording": name, "what": "loading"},
            {
                "wall": Figure.of_samples([wall for wall, _, _ in loaded], "s"),
                "cpu": Figure.of_samples([cpu for _, cpu, _ in loaded], "s"),
                "cpu with imports": Figure.of_samples([whole for _, _, whole in loaded], "s"),
            },
        ),
        Row(
            {"recording": name, "what": "first picture of `cartoloop view`"},
            {
                "wall": Figure.of_samples([wall for wall, _ in shown], "s"),
                "cpu": Figure.of_samples([cpu for _, cpu in shown], "s"),
            },
        ),
    ]


def first_picture(out: Path) -> tuple[float, float]:
    """Return the time until `cartoloop view` has sent a picture of a map, and its CPU time [s].

    From the start of the process; the page, which says where the picture is, is asked for before.

    Raises
    ------
    CommandFailed
        No picture is served.
    """
    before, start = os.times(), time.perf_counter()
    command = [sys.executable, "-u", "-m", "cartoloop", "view", str(out), "--view-port", "8930"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            found = re.search(r"http://\S+", process.stdout.readline())
            if found is None:
                raise CommandFailed(f"{out}: is not shown")
            place = urlsplit(found[0]).netloc
            page = _get(place, "/").decode()
            picture = re.search(r'src="(opening\.png[^"]*)"', page)
            if picture is None or not _get(place, f"/{picture[1]}").startswith(b"\x89PNG"):
                raise CommandFailed(f"{out}: no picture of it is served")
            wall = time.perf_counter() - start
        finally:
            process.kill()
    after = os.times()
    spent = after.children_user + after.children_system
    return wall, spent - before.children_user - before.children_system


def _loaded(out: Path) -> tuple[float, float, float]:
    """Return time and CPU time of loading, and CPU time of the process until then [s]."""
    done = subprocess.run(
        [sys.executable, "-c", _LOAD, str(out)], check=True, stdout=subprocess.PIPE
    )
    wall, cpu, whole = json.loads(done.stdout)
    return wall, cpu, whole


def _get(place: str, path: str) -> bytes:
    connection = HTTPConnection(place, timeout=60.0)
    try:
        connection.request("GET", path)
        return connection.getresponse().read()
    finally:
        connection.close()
