# SPDX-License-Identifier: Apache-2.0
"""From a path to the messages in it: its kind of recording, and the reader for it.

Sound recordings are read by the library rosbags; files that it refuses, because the recorder died
or the file is cut off, by `salvage_bag.py` and `salvage_ros2.py`.
"""

from __future__ import annotations

import shutil
import tempfile
import weakref
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cartoloop.errors import InputError
from cartoloop.foreign_database import open_database
from cartoloop.input_file import open_input
from cartoloop.readers.ros.container import (
    BagFinding,
    ChainedContainer,
    Container,
    LibraryContainer,
    reason_of,
)
from cartoloop.readers.ros.unpacking import BudgetError, unpack_file

if TYPE_CHECKING:
    from rosbags.interfaces import Connection

BAG1_MAGIC = b"#ROSBAG V"
MCAP_MAGIC = b"\x89MCAP0\r\n"
SQLITE_MAGIC = b"SQLite format 3\x00"
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"


def is_recording(path: Path) -> bool:
    """Return whether a path is for this family of readers: a folder, or a file by its content."""
    if path.is_dir() or path.name == "metadata.yaml":
        return True
    try:
        if not path.is_file():
            return False  # a pipe, whose first bytes must not be lost
        with open_input(path) as file:
            head = file.read(16)
    except OSError:
        return False  # reading it as text reports the reason
    if head.startswith((BAG1_MAGIC, MCAP_MAGIC, SQLITE_MAGIC)):
        return True
    if head.startswith(ZSTD_MAGIC):
        return path.suffixes[-2:-1] in ([".db3"], [".mcap"], [".bag"])
    return path.suffix in (".bag", ".db3", ".mcap", ".active")


def open_containers(path: Path) -> Iterator[Container]:
    """Yield the readers of a path to try, best first; each is opened only when it is reached.

    Raises
    ------
    InputError
        There is no recording, or nothing of it can be read.
    """
    if path.name == "metadata.yaml" and path.is_file():
        path = path.parent
    if path.is_dir():
        yield _open_folder(path)
    else:
        yield from _open_file(path)


def _open_folder(path: Path) -> Container:
    inside = sorted(path.iterdir())
    files = [p for p in inside if _magic(p) in (MCAP_MAGIC, SQLITE_MAGIC)]
    bags = [p for p in inside if _magic(p) == BAG1_MAGIC]
    if (path / "metadata.yaml").exists():
        from rosbags.rosbag2 import Reader

        try:
            for file in inside:
                if _magic(file) == SQLITE_MAGIC:
                    _require_plain_tables(file)
            size = sum(file.stat().st_size for file in inside if file.is_file())
            return LibraryContainer(Reader(path), "ROS 2 recording", False, size)
        except Exception as error:  # noqa: BLE001 - on damaged files it raises anything
            if not files:
                raise InputError(
                    f"{path}: cannot be read ({reason_of(error)}); if a file is missing, copy the "
                    "whole folder again"
                ) from None
            note = f"its metadata.yaml does not fit ({reason_of(error)})"
    elif files:
        note = "it has no metadata.yaml: the recorder was not ended properly"
    elif bags:
        raise InputError(
            f"{path}: is a folder of bags; give the bags themselves, in the order of time"
        )
    else:
        raise InputError(f"{path}: is a folder without a recording; give the recording itself")
    parts = [next(_open_file(p)) for p in sorted(files, key=_by_number)]
    chained = ChainedContainer(parts, "ROS 2 recording")
    chained.notes.append(
        BagFinding("warning", "no_metadata", note, "its files are read all the same")
    )
    return chained


def _by_number(path: Path) -> tuple[int, str]:
    """Split recordings are numbered name_0, name_1, ..., name_10."""
    number = path.name.split(".")[0].rsplit("_", 1)[-1]
    return (int(number) if number.isdigit() else -1, path.name)


def _open_file(path: Path) -> Iterator[Container]:
    """Yield the library's reader of a file, unless it refuses it, then the one from the front."""
    from cartoloop.readers.ros.salvage_bag import BagSalvage
    from cartoloop.readers.ros.salvage_ros2 import DatabaseSalvage, McapSalvage

    magic = _magic(path)
    if magic == ZSTD_MAGIC:
        yield from _open_compressed(path)
        return
    if not magic:
        raise InputError(_unreadable_message(path))
    refusal = ""
    try:
        container = _open_by_library(path, magic)
    except Exception as error:  # noqa: BLE001 - on damaged files it raises anything
        refusal = reason_of(error)
    else:
        container.notes += _notes(path, refusal)
        yield container
    salvages: dict[bytes, Callable[[Path], Container]] = {
        BAG1_MAGIC: BagSalvage,
        MCAP_MAGIC: McapSalvage,
        SQLITE_MAGIC: DatabaseSalvage,
    }
    salvage = salvages[magic](path)
    salvage.notes += _notes(path, refusal)
    yield salvage


def _open_by_library(path: Path, magic: bytes) -> LibraryContainer:
    size = path.stat().st_size
    if magic == BAG1_MAGIC:
        from rosbags.rosbag1 import Reader

        return LibraryContainer(Reader(path), "ROS 1 bag", True, size)
    if magic == MCAP_MAGIC:
        from rosbags.rosbag2.storage_mcap import McapReader

        return LibraryContainer(_Bare(McapReader(path)), "MCAP file", False, size)
    from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

    _require_plain_tables(path)
    return LibraryContainer(_Bare(Sqlite3Reader(path)), "ROS 2 database", False, size)


def _require_plain_tables(path: Path) -> None:
    """Raise `sqlite3.Error` if a database computes its messages, maybe without end."""
    from cartoloop.readers.ros.salvage_ros2 import TABLES

    open_database(path, TABLES).close()


def _notes(path: Path, refusal: str) -> list[BagFinding]:
    """Return remarks besides damage; `refusal` is the library's reason for not reading it."""
    notes = []
    if "not indexed" in refusal:
        notes.append(
            BagFinding(
                "warning",
                "unindexed",
                "the bag has no index: its recorder was not ended properly",
                "it is read from the front; `rosbag reindex` would restore the index",
            )
        )
    if has_unwritten_log(path):
        notes.append(
            BagFinding(
                "warning",
                "unwritten_log",
                f"messages still stand in {path.name}-wal, which is not read",
                f"take them in first: sqlite3 {path.name} 'PRAGMA wal_checkpoint'",
            )
        )
    return notes


class _Unpacked:
    """A temporary folder with an unpacked file; removed when no reader needs it any more."""

    def __init__(self, name: str) -> None:
        folder = tempfile.mkdtemp(prefix="cartoloop-")
        self.file = Path(folder) / name
        weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)


def _open_compressed(path: Path) -> Iterator[Container]:
    """Yield the readers of the file in a zstd file."""
    from cartoloop.readers.ros.zstd import zstd

    unpacked = _Unpacked(path.stem)
    damage = ""
    try:
        unpack_file(path, unpacked.file)
    except (OSError, EOFError, zstd.ZstdError, BudgetError) as error:
        damage = reason_of(error)
        if unpacked.file.stat().st_size == 0:
            raise InputError(
                f"{path}: cannot be unpacked ({damage}); copy or download it again"
            ) from None
    for container in _open_file(unpacked.file):
        container.needs = unpacked
        if damage:
            what = f"it cannot be unpacked whole ({damage})"
            container.notes.append(
                BagFinding("error", "damaged", what, "copy it again for the rest")
            )
        yield container


def _magic(path: Path) -> bytes:
    """Return the known signature that a file begins with, or b""."""
    try:
        if not path.is_file():
            return b""
        with open_input(path) as file:
            head = file.read(16)
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(f"{path}: cannot be read ({reason}); check the file") from None
    known = (BAG1_MAGIC, MCAP_MAGIC, SQLITE_MAGIC, ZSTD_MAGIC)
    return next((magic for magic in known if head.startswith(magic)), b"")


def _unreadable_message(path: Path) -> str:
    try:
        size = path.stat().st_size
    except OSError as error:
        return f"{path}: cannot be read ({error.strerror or error}); check the path"
    if size == 0:
        return f"{path}: is empty; record or download it again"
    return f"{path}: is no {path.suffix} recording by its content; download or copy it again"


def has_unwritten_log(path: Path) -> bool:
    """Return whether messages of a database are still in its write-ahead log."""
    beside = path.with_name(path.name + "-wal")
    return beside.is_file() and beside.stat().st_size > 0


class _Bare:
    """A storage of rosbags without its folder, for files of any name."""

    def __init__(self, storage: Any) -> None:  # noqa: ANN401 - untyped
        self._storage = storage
        self.open, self.close, self.messages = storage.open, storage.close, storage.messages

    @property
    def connections(self) -> list[Connection]:
        return list(self._storage.connections)
