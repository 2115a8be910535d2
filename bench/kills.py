# SPDX-License-Identifier: Apache-2.0
"""Runs that are killed while they map over an older map: what is left of the files.

Each run maps a short drive into a folder with a finished map that other parameters made, so that
each file of it differs. It is ended at a random moment of the run, of its saving, or of the
millisecond in which the files change places. Afterwards all files must be of one map, and each must
open; the next program that opens the folder must find a whole map. Some runs add the drive to the
map of another one (``--onto``): those are resumed, and must end in the same bytes.
"""

from __future__ import annotations

import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from bench.environment import environment
from bench.opened_files import digest_of, digests_of, opening_fault
from bench.record import Case, Figure, Record, Row
from cartoloop.errors import CartoloopError
from cartoloop.journal.frames import FILE_NAME as JOURNAL
from cartoloop.map_file.file_set import COMPLETE, FILES, MOVING, UNFINISHED
from cartoloop.map_output.output_folder import STOPPED, saved_map
from cartoloop.result import load_map
from cartoloop.simulation import ring, simulate

DRIVE_S = 60.0
"""Recorded time of the drive [s]: mapped in about a second, and saved in some tenths of one."""

MAX_TRIALS = 20
"""Runs that may end before they are killed."""

LIMIT_S = 300.0
"""A run that takes longer hangs [s]."""

OLD_SETTING = "local_slam.submaps.resolution=0.08"
"""Parameter of the older map: no file of it is the same as with the default."""

SIGNALS = ("SIGKILL", "SIGKILL", "SIGKILL", "SIGTERM", "SIGHUP", "SIGINT")
"""What ends a run, each as likely as it stands here."""

COMMANDS = ("map", "map --onto", "live")
_IN_TURN = ("map", "map --onto", "live", "map", "map", "map --onto", "live", "map --onto")

MOMENTS = ("mapping", "saving", "replacing")
"""When a run is ended: at any moment, after the first file was begun, while files change places."""


@dataclass(frozen=True, slots=True)
class Kill:
    """A run to be ended.

    Attributes
    ----------
    command : one of `COMMANDS`.
    moment : one of `MOMENTS`.
    signal : name of the signal.
    share : moment within the part of the run, 0 to 1.
    """

    command: str
    moment: str
    signal: str
    share: float


@dataclass(slots=True)
class Left:
    """What a killed run left.

    Attributes
    ----------
    kill : the run.
    state : ``old``, ``new`` or ``none``: whose files are in the folder.
    faults : what is wrong with them.
    """

    kill: Kill
    state: str = "none"
    faults: list[str] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Drive:
    """The recording, the map that a run replaces, and what it ends in.

    Attributes
    ----------
    log : the recording.
    folder : of the older map: with other parameters, or of the drive that this one is added to.
    digests : of the files of both maps, by ``old`` and ``new``.
    mapping_s, saving_s : time of a run until the first file is begun, and from there on [s].
    """

    log: Path
    folder: Path
    digests: dict[str, dict[str, str]]
    mapping_s: float
    saving_s: float


def run(
    num_kills: int, num_saving: int, seed: int = 0, progress: Callable[[str], None] = print
) -> Record:
    """Kill runs, and return how many left what.

    Parameters
    ----------
    num_kills : number of runs.
    num_saving : number of these that are killed while saving, a quarter of them while the files
        change places.
    seed : of commands, signals and moments.
    progress : receives a line now and then.
    """
    with tempfile.TemporaryDirectory(prefix="cartoloop-kills-") as folder:
        alone, added = _drive(Path(folder)), _added_drive(Path(folder))
        found = []
        for number, kill in enumerate(_kills(num_kills, num_saving, seed), 1):
            drive = added if kill.command == "map --onto" else alone
            found.append(_killed_in_time(kill, drive, Path(folder) / "out"))
            if found[-1].faults:
                progress(f"{kill}: {'; '.join(found[-1].faults)}")
            if number % 10 == 0:
                progress(f"{number} of {num_kills} runs killed")
    return Record("kills", tuple(_rows(found)), environment())


def _kills(num_kills: int, num_saving: int, seed: int) -> Iterator[Kill]:
    draw = random.Random(seed)
    for number in range(num_kills):
        moment = "mapping"
        if number < num_saving:
            moment = "replacing" if number % 4 == 3 else "saving"
        yield Kill(_IN_TURN[number % len(_IN_TURN)], moment, draw.choice(SIGNALS), draw.random())


def _drive(folder: Path) -> Drive:
    """Return the drive and its maps, made in a folder."""
    log, old, new = folder / "drive.log", folder / "old", folder / "new"
    simulate(ring(), seed=1, duration=DRIVE_S).write_log(log)
    for out, setting in ((old, ("--set", OLD_SETTING)), (new, ())):  # the last is timed
        times = _timed("map", log, out, *setting)
    return Drive(log, old, {"old": digests_of(old), "new": digests_of(new)}, *times)


def _added_drive(folder: Path) -> Drive:
    """Return a second drive, which is added to the map of the one of `_drive`."""
    log, old, new = folder / "second.log", folder / "first", folder / "both"
    simulate(ring(), seed=2, duration=DRIVE_S).write_log(log)
    _timed("map", folder / "drive.log", old)
    for _ in range(2):
        shutil.rmtree(new, ignore_errors=True)
        shutil.copytree(old, new)
        times = _timed("map --onto", log, new)
    return Drive(log, old, {"old": digests_of(old), "new": digests_of(new)}, *times)


def _timed(command: str, log: Path, out: Path, *options: str) -> tuple[float, float]:
    """Let a run come to its end; return the time until it saves its map, and that of saving [s]."""
    begin = time.perf_counter()
    process = _started(command, log, out, *options)
    _wait_for(process, [out / UNFINISHED])
    mapped = time.perf_counter()
    process.communicate(timeout=LIMIT_S)
    if process.returncode:
        raise CartoloopError(f"mapping {log} ended with status {process.returncode}")
    return mapped - begin, time.perf_counter() - mapped


def _killed_in_time(kill: Kill, drive: Drive, out: Path) -> Left:
    """End a run before it ends by itself: if it was faster than expected, another one, sooner."""
    for _ in range(MAX_TRIALS):
        if (left := _killed(kill, drive, out)) is not None:
            return left
        kill = replace(kill, share=0.7 * kill.share)
    raise CartoloopError(f"{kill}: the run always ended before it could be killed")


def _killed(kill: Kill, drive: Drive, out: Path) -> Left | None:
    """End a run into a copy of the older map, and examine what is left; None if it was too late."""
    shutil.rmtree(out, ignore_errors=True)
    shutil.copytree(drive.folder, out)
    end_after = ("--end-after", "0.5", "--no-drop", "--overwrite") if kill.command == "live" else ()
    process = _started(kill.command, drive.log, out, *end_after)
    folders = (out, out / STOPPED)
    if kill.moment == "mapping":
        _wait_for(process, [], kill.share * (drive.mapping_s + drive.saving_s))
    elif kill.moment == "saving":
        _wait_for(process, [path / UNFINISHED for path in folders])
        _wait_for(process, [], kill.share * drive.saving_s)
    else:
        places = [path / name for path in folders for name in (COMPLETE, MOVING)]
        _wait_for(process, places, pause_s=0.0)
    is_too_late = process.poll() is not None
    process.send_signal(getattr(signal, kill.signal))
    process.communicate(timeout=LIMIT_S)
    return None if is_too_late else _examined(kill, drive, out)


def _started(command: str, source: Path, out: Path, *options: str) -> subprocess.Popen[bytes]:
    name, _, onto = command.partition(" ")
    return subprocess.Popen(
        [sys.executable, "-m", "cartoloop", name, str(source), onto or "-o", str(out), *options],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def _wait_for(
    process: subprocess.Popen[bytes],
    places: Sequence[Path],
    at_most_s: float = LIMIT_S,
    pause_s: float = 0.0005,
) -> None:
    """Wait until one of the places exists, the process has ended, or the time is over."""
    end = time.perf_counter() + at_most_s
    while time.perf_counter() < end and process.poll() is None:
        if any(place.exists() for place in places):
            return
        time.sleep(pause_s)


def _examined(kill: Kill, drive: Drive, out: Path) -> Left:
    left = Left(kill)
    owners = {name: owner for name in FILES if (owner := _owner(out / name, drive, kill))}
    if len(set(owners.values())) > 1:
        left.faults.append(f"files of two maps: {owners}")
    left.state = next(iter(owners.values()), "none")
    for folder in (out, out / STOPPED):
        faults = (opening_fault(folder / name) for name in FILES if (folder / name).exists())
        left.faults += [fault for fault in faults if fault]
    try:
        load_map(out)  # which completes what was cut short
    except CartoloopError as error:
        left.faults.append(str(error))
    saved = saved_map(out)
    if saved is None or saved.files not in (FILES, ("map.cartoloop",)):
        left.faults.append(f"not a whole map: {saved}")
    if kill.command == "map --onto" and (out / JOURNAL).exists():
        left.faults += _resuming_faults(drive, out)
    return left


def _resuming_faults(drive: Drive, out: Path) -> list[str]:
    """Resume a run; return what is wrong with its end."""
    resumed = subprocess.run(
        [sys.executable, "-m", "cartoloop", "map", str(drive.log), "--resume", str(out)],
        capture_output=True, text=True, timeout=LIMIT_S, check=False,
    )  # fmt: skip
    if resumed.returncode:
        return [f"not resumed: {resumed.stderr.strip()}"]
    differing = [name for name in FILES if digest_of(out / name) != drive.digests["new"][name]]
    return [f"resumed, but other bytes in {', '.join(differing)}"] if differing else []


def _owner(path: Path, drive: Drive, kill: Kill) -> str:
    """Return whose file it is: ``old``, ``new``, or "" if it is not there or the same in both."""
    old, new = drive.digests["old"][path.name], drive.digests["new"][path.name]
    if not path.exists() or old == new:
        return ""
    digest = digest_of(path)
    if digest == old:
        return "old"
    # No two live maps are the same.
    is_new = kill.command == "live" or digest == new
    return "new" if is_new else f"unknown ({path.name})"


def _rows(found: list[Left]) -> Iterator[Row]:
    for command in COMMANDS:
        for moment in MOMENTS:
            some = [x for x in found if (x.kill.command, x.kill.moment) == (command, moment)]
            if not some:
                continue
            states = Counter(left.state for left in some)
            case: Case = {"command": command, "killed while": moment}
            figures = {
                "kills": Figure.exact(len(some), better=None),
                "faults": Figure.exact(sum(bool(left.faults) for left in some)),
                "old map": Figure.exact(states["old"], better=None),
                "new map": Figure.exact(states["new"], better=None),
                "no map": Figure.exact(states["none"], better=None),
            }
            faults = [fault for left in some for fault in left.faults]
            yield Row(case, figures, faults[0] if faults else "")
