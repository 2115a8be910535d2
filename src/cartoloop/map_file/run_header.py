# SPDX-License-Identifier: Apache-2.0
"""What a journal says about its run: by which program, of what, with which parameters."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Literal

from cartoloop.config import Config
from cartoloop.errors import InputError
from cartoloop.journal.frames import Content, Kind, read_content
from cartoloop.map_file.saved_config import config_of_json
from cartoloop.map_file.schema import FILE_NAME
from cartoloop.sensor.pose import Pose
from cartoloop.version import __version__

RunKind = Literal["map", "live"]


def environment() -> dict[str, str]:
    """Return the versions of what the last digits of a result depend on."""
    found = {"machine": platform.machine()}
    for name in ("numpy", "numba"):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = ""
    return found


@dataclass(frozen=True, slots=True)
class BaseOfRun:
    """The map that a run adds a session to.

    Attributes
    ----------
    path : absolute path of its folder or file; "." for the folder of the run itself, "" where the
        map was given in memory.
    digest : of the map, see `map_file.map_digest`.
    recording : name and fingerprint of the recording that is added.
    pose : where the robot is in it at first, None where that is not known.
    """

    path: str
    digest: str
    recording: tuple[str, str]
    pose: Pose | None = None

    def place(self, folder: Path) -> Path | None:
        """Return where the map is, of a run in `folder`; None if it is in no file there.

        A folder of a run that holds nothing but its journal has no earlier map.
        """
        if not self.path:
            return None
        found = (folder / self.path) if self.path == "." else Path(self.path)
        if found.resolve() == folder.resolve() and not (folder / FILE_NAME).is_file():
            return None
        return found

    def to_dict(self) -> dict[str, Any]:
        """Return it as values of JSON."""
        return {
            "path": self.path,
            "digest": self.digest,
            "recording": list(self.recording),
            "pose": None if self.pose is None else list(self.pose),
        }

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> BaseOfRun:
        """Return it, from values of JSON.

        Raises
        ------
        ValueError, TypeError, KeyError
            It is damaged.
        """
        name, fingerprint = content["recording"]
        pose = content["pose"]
        return cls(
            str(content["path"]),
            str(content["digest"]),
            (str(name), str(fingerprint)),
            None if pose is None else Pose(*map(float, pose)),
        )


@dataclass(frozen=True, slots=True)
class RunHeader:
    """A run that has a journal.

    Attributes
    ----------
    kind : of a recording, or live.
    name, fingerprint : of the recording; see `Report`.
    config : all parameters.
    origins : by key of the configuration, where its value comes from.
    options : how the recording is read, as JSON has it.
    layers : drawn over the picture of the map.
    overwrite : whether the map of another recording may be replaced.
    continues : whether it adds a session to a map; then its nodes and submaps count from
        `first_node` and `first_submap`.
    base : that map; None in journals of earlier programs, where it is the one in the same folder.
    program : version that made the journal.
    environment : versions of what it relies on.
    """

    kind: RunKind
    name: str
    fingerprint: str
    config: Config
    origins: Mapping[str, str] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)
    layers: tuple[str, ...] = ()
    overwrite: bool = False
    continues: bool = False
    first_node: int = 0
    first_submap: int = 0
    base: BaseOfRun | None = None
    program: str = __version__
    environment: Mapping[str, str] = field(default_factory=environment)

    @property
    def recording(self) -> tuple[str, str]:
        """Name and fingerprint of the recording that is mapped, without those of earlier maps."""
        return (self.name, self.fingerprint) if self.base is None else self.base.recording

    def to_json(self) -> bytes:
        """Return the header as the payload of a record."""
        content = {
            "kind": self.kind,
            "name": self.name,
            "fingerprint": self.fingerprint,
            "config": self.config.model_dump(mode="json"),
            "origins": dict(self.origins),
            "options": dict(self.options),
            "layers": list(self.layers),
            "overwrite": self.overwrite,
            "continues": self.continues,
            "first_node": self.first_node,
            "first_submap": self.first_submap,
            "base": None if self.base is None else self.base.to_dict(),
            "program": self.program,
            "environment": dict(self.environment),
        }
        return json.dumps(content).encode()

    @classmethod
    def from_json(cls, payload: memoryview) -> RunHeader:
        """Return the header in the payload of a record.

        Raises
        ------
        ValueError, TypeError, KeyError, AttributeError
            It is damaged.
        """
        content = json.loads(bytes(payload))
        if content["kind"] not in ("map", "live"):
            raise ValueError(f"the run is of kind {content['kind']!r}")
        return cls(
            kind=content["kind"],
            name=str(content["name"]),
            fingerprint=str(content["fingerprint"]),
            config=config_of_json(json.dumps(content["config"])),
            origins={str(key): str(value) for key, value in content["origins"].items()},
            options=dict(content["options"]),
            layers=tuple(map(str, content["layers"])),
            overwrite=bool(content["overwrite"]),
            continues=bool(content["continues"]),
            first_node=int(content["first_node"]),
            first_submap=int(content["first_submap"]),
            base=None if content.get("base") is None else BaseOfRun.from_dict(content["base"]),
            program=str(content["program"]),
            environment={str(key): str(value) for key, value in content["environment"].items()},
        )


def read_journal(path: Path, *, whole: bool = True) -> tuple[RunHeader, Content]:
    """Return the header of a journal, and its other records.

    Parameters
    ----------
    whole : whether the records are wanted; otherwise some or none of them are read.

    Raises
    ------
    InputError
        It cannot be read, is none, is damaged at its beginning, or is of a newer program.
    """
    content = read_content(path, None if whole else 1)
    try:
        first = content.records[0]
        if first.kind != Kind.HEADER:
            raise ValueError("it does not begin with its header")
        header = RunHeader.from_json(first.payload)
    except (ValueError, TypeError, KeyError, AttributeError, IndexError, RecursionError) as error:
        what = " ".join(str(error).split())
        raise InputError(
            f"{path}: is damaged ({type(error).__name__}: {what}); remove it, and map the "
            "recording again"
        ) from error
    return header, Content(content.records[1:], content.size)
