# SPDX-License-Identifier: Apache-2.0
"""The journal of a run in its folder: begun, resumed where it stopped, removed at the end."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

from cartoloop.config_file import LoadedConfig, changed_keys, config_hash
from cartoloop.errors import InputError, OutputError
from cartoloop.global_slam.graph_records import index_of_submap
from cartoloop.journal.frames import FILE_NAME, LOCAL_KINDS, Content, Kind
from cartoloop.journal.outcomes import RecordedOutcomes, RunOutcomes
from cartoloop.journal.writer import JournalWriter
from cartoloop.map_file.run_header import RunHeader, environment, read_journal
from cartoloop.sensor.pose import Pose
from cartoloop.version import __version__

if TYPE_CHECKING:
    from cartoloop.readers.read_options import ReadOptions


@dataclass(frozen=True, slots=True)
class InterruptedRun:
    """A run that was interrupted, with a journal in its folder.

    Attributes
    ----------
    folder : of the run.
    header : of the journal.
    """

    folder: Path
    header: RunHeader

    @property
    def loaded(self) -> LoadedConfig:
        """Its configuration."""
        return LoadedConfig(self.header.config, dict(self.header.origins))

    @property
    def read_options(self) -> ReadOptions:
        """How it read the recording.

        Raises
        ------
        InputError
            The robot description that it used has changed.
        """
        from cartoloop.readers.read_options import ReadOptions

        options = self.header.options
        pose, urdf = options.get("laser_pose"), options.get("urdf")
        found = ReadOptions(
            scan_topics=tuple(options.get("scan_topics", ())),
            odom_topic=options.get("odom_topic"),
            imu_topic=options.get("imu_topic"),
            urdf=None if urdf is None else Path(urdf),
            laser_pose=None if pose is None else Pose(*pose),
            echo=cast(Literal["first", "strongest"], options.get("echo", "first")),
        )
        if urdf is not None and options_document(found).get(_URDF_HASH) != options.get(_URDF_HASH):
            raise self._refusal(f"{urdf} has changed since")
        return found

    def check_recording(self, name: str, fingerprint: str) -> None:
        """Check that a recording is that of the run, and that this program can resume it.

        Raises
        ------
        InputError
            It is another, or the program is.
        """
        header = self.header
        if header.kind == "live":
            raise InputError(
                f"{self.folder}: holds a live run that was interrupted, which no recording "
                "resumes; `cartoloop view` and `cartoloop export` open its map"
            )
        own_name, own_fingerprint = header.recording
        is_same = own_fingerprint == fingerprint if fingerprint else own_name == name
        if not is_same:
            raise InputError(
                f"{self.folder}: holds an interrupted run of another recording ({own_name}), "
                f"not of {name}; give that one, or another folder"
            )
        if header.program != __version__:
            raise self._refusal(f"cartoloop {header.program} began it, this is {__version__}")
        for what, now in environment().items():
            before = header.environment.get(what, "")
            if before != now:
                raise self._refusal(f"it was begun with {what} {before}, this is {now}")

    def check_config(self, loaded: LoadedConfig) -> None:
        """Check that given parameters are those of the run.

        Raises
        ------
        InputError
            One is not.
        """
        if config_hash(loaded.config) != config_hash(self.header.config):
            keys = changed_keys(self.header.config, loaded.config)
            raise self._refusal(f"it was begun with other parameters ({', '.join(keys[:3])})")

    def check_pose(self, pose: Pose) -> None:
        """Check that a pose where the robot is at first is that of the run.

        Raises
        ------
        InputError
            It is not.
        """
        base = self.header.base
        if base is None or base.pose != pose:
            raise self._refusal("it was begun with another pose at first, or with none")

    def check_options(self, options: ReadOptions) -> None:
        """Check that the recording is read as the run did.

        Raises
        ------
        InputError
            It is not.
        """
        given = options_document(options)
        differing = [key for key, value in given.items() if self.header.options.get(key) != value]
        if differing:
            what = differing[0].replace("_", " ")
            raise self._refusal(f"it was begun with another {what} of the recording")

    def _refusal(self, why: str) -> InputError:
        return InputError(
            f"{self.folder}: the interrupted run cannot be resumed like this: {why}; do as then, "
            "or map from the beginning, without --resume"
        )


class RunJournal:
    """The journal of a run that is going on.

    Attributes
    ----------
    path : of the file.
    outcomes : for the mapper.
    num_recorded_scans : scans that were mapped before it was resumed.
    """

    def __init__(
        self, writer: JournalWriter, path: Path, outcomes: RunOutcomes, num_scans: int = 0
    ) -> None:
        self._writer = writer
        self.path = path
        self.outcomes = outcomes
        self.num_recorded_scans = num_scans

    @property
    def num_written(self) -> int:
        """Number of bytes written so far."""
        return self._writer.num_written

    def close(self) -> None:
        """Write what is left: the run can be resumed later."""
        self._writer.close()

    def remove(self) -> None:
        """Remove the journal: the run has come to its end."""
        self._writer.remove()


def interrupted_run(folder: Path) -> InterruptedRun | None:
    """Return the interrupted run in a folder; None if there is none.

    Raises
    ------
    InputError
        Its journal is damaged, or of a newer program.
    """
    path = folder / FILE_NAME
    return InterruptedRun(folder, read_journal(path, whole=False)[0]) if path.is_file() else None


def begin_journal(folder: Path, header: RunHeader, on_failure: Callable[[str], None]) -> RunJournal:
    """Begin the journal of a run in a folder; one that is there is replaced.

    Parameters
    ----------
    on_failure : called with one line where it cannot be written; mapping goes on, and so do
        attempts.

    Raises
    ------
    OutputError
        Another process writes the journal that is there.
    """
    path = folder / FILE_NAME
    writer = JournalWriter(path, on_failure, header=header.to_json())
    is_replayable = header.kind == "map"
    local, graph = (RecordedOutcomes(writer.append, is_replayable=is_replayable) for _ in range(2))
    return RunJournal(writer, path, RunOutcomes(local, graph))


def resume_journal(run: InterruptedRun, on_failure: Callable[[str], None]) -> RunJournal:
    """Return the journal of an interrupted run, to be gone over and continued.

    Raises
    ------
    OutputError
        Another process writes it, or it cannot be written.
    InputError
        It is damaged at its beginning.
    """
    path = run.folder / FILE_NAME
    content: Content | None = None

    def kept_size() -> int:
        nonlocal content
        content = read_journal(path)[1]
        return content.size

    writer = JournalWriter(path, on_failure, kept_size=kept_size)
    assert content is not None
    records = content.records
    local = [record for record in records if record.kind in LOCAL_KINDS]
    graph = [record for record in records if record.kind not in LOCAL_KINDS]
    finished = frozenset(
        index_of_submap(record.payload) for record in graph if record.kind == Kind.SUBMAP
    )
    outcomes = RunOutcomes(
        RecordedOutcomes(writer.append, local, is_replayable=True),
        RecordedOutcomes(writer.append, graph, is_replayable=True),
        finished,
    )
    num_scans = sum(record.kind == Kind.SCAN for record in local)
    return RunJournal(writer, path, outcomes, num_scans)


def options_document(options: ReadOptions | None) -> dict[str, Any]:
    """Return how a recording is read as values of JSON, with the hash of the robot description."""
    from cartoloop.readers.read_options import ReadOptions

    options = options or ReadOptions()
    document: Mapping[str, Any] = asdict(options)
    found = {key: _plain(value) for key, value in document.items()}
    if options.urdf is not None:
        found["urdf"] = str(options.urdf.absolute())
        with suppress(OSError):  # opening the recording reports it
            found[_URDF_HASH] = hashlib.sha256(options.urdf.read_bytes()).hexdigest()
    return found


_URDF_HASH = "urdf_sha256"


def _plain(value: object) -> object:
    if isinstance(value, Path):
        return str(value)
    return list(value) if isinstance(value, Sequence) and not isinstance(value, str) else value


def nothing_to_resume(folder: Path) -> OutputError:
    """Return the error of a folder that holds no interrupted run."""
    return OutputError(
        f"{folder}: holds no interrupted run; map without --resume, or give the folder of the run"
    )
