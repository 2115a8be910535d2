# SPDX-License-Identifier: Apache-2.0
"""Runs that are killed: whether each opens, what of it is lost, and what it comes to when resumed.

Runs of recordings are killed by SIGKILL at random moments, from the start of the process to the
saving of the map, and resumed; a resumed run may be killed again. In the end the files must be
those of a run without interruption, byte by byte. Live runs are killed while a robot drives: their
journal must open as the map of all but the last second.
"""

from __future__ import annotations

import json
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from threading import Thread
from typing import IO

from bench.environment import environment
from bench.live_replay import line_of
from bench.record import Figure, Record, Row
from cartoloop.errors import CartoloopError
from cartoloop.journal.frames import FILE_NAME as JOURNAL
from cartoloop.map_file.file_set import FILES
from cartoloop.readers import open_log
from cartoloop.result import load_map
from cartoloop.runs.journal import interrupted_run
from cartoloop.simulation import make_world, ring, simulate

LIMIT_S = 900.0
"""A run that takes longer hangs [s]."""

MOST_KILLS_OF_A_RUN = 4
"""A run is killed between once and so often before it is left to end."""

READY_S = 60.0
"""A live run that has mapped nothing until then is killed [s]."""

LIVE_PACE = 8.0
"""Times real time at which messages of a live run are sent."""

ALLOWED_LOSS_S = 1.0
"""What may be missing of a killed run [s]."""

_RUN_TIMES = ("wall_s", "cpu_s", "peak_memory_mb", "real_time_factor", "stages", "adjustment")


@dataclass(slots=True)
class Kills:
    """What became of the runs of one command over one recording.

    Attributes
    ----------
    recording, command : which.
    num_kills : runs that were killed.
    num_opened : of these, opened as a map; `num_empty`: killed before there was one.
    num_resumed : runs that were killed and came to their end; `num_same`: in the same bytes.
    lost_s : of each kill, how much of the run is missing [s].
    faults : what is wrong, a line each.
    """

    recording: str
    command: str
    num_kills: int = 0
    num_opened: int = 0
    num_empty: int = 0
    num_resumed: int = 0
    num_same: int = 0
    lost_s: list[float] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)

    def row(self) -> Row:
        """Return the figures."""
        return Row(
            {"recording": self.recording, "command": self.command},
            {
                "kills": Figure.exact(self.num_kills, better=None),
                "opened": Figure.exact(self.num_opened, better=None),
                "before a map": Figure.exact(self.num_empty, better=None),
                "resumed": Figure.exact(self.num_resumed, better=None),
                "same bytes": Figure.exact(self.num_same, better=None),
                "most lost": Figure.exact(max(self.lost_s, default=0.0), "s"),
                "faults": Figure.exact(len(self.faults)),
            },
            self.faults[0] if self.faults else "",
        )


class Progress:
    """The lines that a process prints, with the time at which each came."""

    def __init__(self, stream: IO[bytes]) -> None:
        self.lines: list[bytes] = []
        self.times: list[float] = []
        self._stream = stream
        self._thread = Thread(target=self._read, daemon=True)
        self._thread.start()

    def wait(self) -> None:
        """Wait until the process has ended, so that no more lines come."""
        self._thread.join()

    def _read(self) -> None:
        for line in self._stream:
            self.lines.append(line)
            self.times.append(time.perf_counter())


def run(
    num_kills: int,
    live_share: float = 0.25,
    seed: int = 0,
    data: Path | None = None,
    *,
    is_quick: bool = False,
    progress: Callable[[str], None] = print,
) -> Record:
    """Kill runs, and return what became of them.

    Parameters
    ----------
    num_kills : in all.
    live_share : share of them that are live runs.
    seed : of moments.
    data : folder with the recordings, for MIT CSAIL; None: a simulated office alone.
    is_quick : whether a short drive takes the place of the office.
    progress : receives a line now and then.
    """
    draw = random.Random(seed)
    with tempfile.TemporaryDirectory(prefix="cartoloop-resume-") as name:
        folder = Path(name)
        logs = list(_logs(folder, data, is_quick))
        found = []
        of_each = max(num_kills // len(logs), 1)
        for log in logs:
            num_live = round(live_share * of_each)
            found.append(_killed_runs(log, of_each - num_live, draw, folder, progress))
            if num_live:
                found.append(_killed_live_runs(log, num_live, draw, folder, progress))
    return Record("resume", tuple(kills.row() for kills in found), environment())


def _logs(folder: Path, data: Path | None, is_quick: bool) -> Iterator[Path]:
    csail = None if data is None else data / "radish" / "mit-csail.clf.gz"
    if csail is not None and csail.exists():
        yield csail
    path = folder / "office.log"
    if is_quick:
        simulate(ring(), seed=1, duration=30.0).write_carmen(path)
    else:
        simulate(make_world("office", 3), seed=3).write_carmen(path)
    yield path


def _killed_runs(
    log: Path, num_kills: int, draw: random.Random, folder: Path, progress: Callable[[str], None]
) -> Kills:
    whole = folder / f"{log.name}-whole"
    _end_of(_started(log, whole))  # compiles, and loads files into the memory
    shutil.rmtree(whole)
    begin = time.perf_counter()
    _end_of(_started(log, whole))
    duration = time.perf_counter() - begin
    kills, number = Kills(log.name, "map"), 0
    while kills.num_kills < num_kills:
        out = folder / "out"
        shutil.rmtree(out, ignore_errors=True)
        left = min(draw.randint(1, MOST_KILLS_OF_A_RUN), num_kills - kills.num_kills)
        for _ in range(left):
            _kill(log, out, draw.uniform(0.0, duration), kills)
        _end_of(_started(log, out))
        kills.num_resumed += 1
        differing = _differing(out, whole)
        if differing:
            kills.faults.append(f"run {number}: other bytes in {', '.join(differing)}")
        else:
            kills.num_same += 1
        number += 1
        progress(f"{log.name}: {kills.num_kills} of {num_kills} runs killed, {kills.num_same} same")
        for fault in kills.faults[-1:]:
            progress(fault)
    return kills


def _started(log: Path, out: Path) -> subprocess.Popen[bytes]:
    """Start a run, or resume the one that is there."""
    is_begun = (out / JOURNAL).exists() or (out / "report.json").exists()
    how = "resume" if is_begun else "begin"
    return subprocess.Popen(
        [sys.executable, "-m", "bench.resumed_child", str(log), str(out), how, "counted"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


def _end_of(process: subprocess.Popen[bytes]) -> None:
    _, errors = process.communicate(timeout=LIMIT_S)
    if process.returncode:
        raise CartoloopError(f"a run ended with status {process.returncode}: {errors.decode()}")


def _kill(log: Path, out: Path, after_s: float, kills: Kills) -> None:
    """Run, or go on with a run, kill it, and examine what is left."""
    process = _started(log, out)
    assert process.stdout is not None
    lines = Progress(process.stdout)
    _wait(process, after_s)
    killed = time.perf_counter()
    process.send_signal(signal.SIGKILL)
    process.wait(LIMIT_S)
    lines.wait()
    _close(process)
    kills.num_kills += 1
    num_kept = _examine(out, kills)
    if num_kept is not None:
        kills.lost_s.append(
            max(killed - lines.times[num_kept], 0.0) if num_kept < len(lines.times) else 0.0
        )
        if kills.lost_s[-1] > ALLOWED_LOSS_S:
            kills.faults.append(f"killed after {after_s:.2f} s: {kills.lost_s[-1]:.2f} s are lost")


def _close(process: subprocess.Popen[bytes]) -> None:
    """Close the streams of a process that has ended."""
    for stream in (process.stdin, process.stdout, process.stderr):
        if stream is not None:
            with suppress(BrokenPipeError):
                stream.close()


def _wait(process: subprocess.Popen[bytes], seconds: float) -> None:
    end = time.perf_counter() + seconds
    while time.perf_counter() < end and process.poll() is None:
        time.sleep(0.001)


def _examine(out: Path, kills: Kills) -> int | None:
    """Open what a killed run left; return the number of its scans, None if it is not to be judged.

    That is where the run had come to its end, or had not begun.
    """
    try:
        if (out / JOURNAL).exists():
            run = interrupted_run(out)
            assert run is not None
            result = load_map(out / JOURNAL)
        elif (out / "report.json").exists():
            load_map(out)
            kills.num_opened += 1
            return None
        else:
            kills.num_empty += 1
            return None
    except CartoloopError as error:
        kills.faults.append(f"does not open: {error}")
        return None
    kills.num_opened += 1
    return len(result.stamps)


def _differing(out: Path, whole: Path) -> list[str]:
    """Return the names of the files that are not as without interruption."""
    differing = [
        name
        for name in FILES
        if name != "report.json" and _bytes(out / name) != _bytes(whole / name)
    ]
    if _lasting(out / "report.json") != _lasting(whole / "report.json"):
        differing.append("report.json")
    others = {path.name for path in out.iterdir()} - set(FILES)
    return differing + sorted(others)


def _bytes(path: Path) -> bytes | None:
    return path.read_bytes() if path.exists() else None


def _lasting(path: Path) -> object:
    """Return what of a report does not depend on the time that the run took."""
    if not path.exists():
        return None
    report = json.loads(path.read_bytes())
    return {key: value for key, value in report.items() if key not in _RUN_TIMES}


def _killed_live_runs(
    log: Path, num_kills: int, draw: random.Random, folder: Path, progress: Callable[[str], None]
) -> Kills:
    events = list(open_log(log))
    sent = [line_of(event).rstrip() + b"\n" for event in events]
    due = [(event.time - events[0].time) / LIVE_PACE for event in events]
    kills = Kills(log.name, "live")
    for number in range(num_kills):
        out = folder / "live"
        shutil.rmtree(out, ignore_errors=True)
        _kill_live(sent, due, draw.uniform(0.0, due[-1]), out, kills)
        progress(f"{log.name}: {number + 1} of {num_kills} live runs killed")
        for fault in kills.faults[-1:]:
            progress(fault)
    return kills


def _kill_live(
    sent: Sequence[bytes], due: Sequence[float], after_s: float, out: Path, kills: Kills
) -> None:
    command = [sys.executable, "-m", "cartoloop", "live", "-", "-o", str(out), "--poses", "-"]
    process = subprocess.Popen(
        [*command, "--no-drop"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    poses = Progress(process.stdout)
    # The time counts from the first pose: the robot sends when the program is ready.
    killer = Thread(target=_kill_later, args=(process, poses, after_s), daemon=True)
    killer.start()
    try:
        start = time.perf_counter()
        for line, moment in zip(sent, due, strict=True):
            while (left := start + moment - time.perf_counter()) > 0.0:
                time.sleep(min(left, 0.01))
            process.stdin.write(line)
            process.stdin.flush()
    except BrokenPipeError:
        pass
    killer.join()
    process.wait(LIMIT_S)
    poses.wait()
    _close(process)
    kills.num_kills += 1
    num_kept = _examine(out, kills)
    if num_kept is None:
        return
    killed = poses.times[-1] if poses.times else 0.0
    lost = killed - poses.times[num_kept] if num_kept < len(poses.times) else 0.0
    kills.lost_s.append(lost)
    if lost > ALLOWED_LOSS_S:
        kills.faults.append(f"live, killed after {after_s:.2f} s: {lost:.2f} s are lost")


def _kill_later(process: subprocess.Popen[bytes], poses: Progress, after_s: float) -> None:
    end = time.perf_counter() + READY_S
    while not poses.times and time.perf_counter() < end and process.poll() is None:
        time.sleep(0.001)
    time.sleep(after_s)
    process.kill()
