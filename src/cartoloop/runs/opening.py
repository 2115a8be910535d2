# SPDX-License-Identifier: Apache-2.0
"""What a run is given, as it needs it: configuration, recording and folder."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from cartoloop.arguments import as_path, require_type, shown
from cartoloop.config import Config
from cartoloop.config_file import LoadedConfig
from cartoloop.errors import UsageError
from cartoloop.map_output.output_folder import RunFolder

if TYPE_CHECKING:
    from cartoloop.readers import Log, ReadOptions


def loaded_config(config: Config | LoadedConfig | None) -> LoadedConfig:
    """Return a configuration with the origins of its values; None: the defaults."""
    if isinstance(config, LoadedConfig):
        return config
    if config is not None:
        require_type(config, Config, "map_recording: config", "a cartoloop.Config")
    return LoadedConfig(config or Config(), {})


def opened_log(
    recording: str | PathLike[str] | Sequence[str | PathLike[str]] | Log,
    options: ReadOptions | None,
    out: str | PathLike[str] | None,
    overwrite: bool,
) -> Log:
    """Return the log, opened if need be; before, check the folder to save in."""
    from cartoloop.readers import open_logs
    from cartoloop.readers.spool import regular_files

    if not isinstance(recording, str | PathLike | Sequence):
        if not hasattr(recording, "num_scans"):
            raise UsageError(
                f"map_recording: recording is {shown(recording)}: give a path, a list of paths, or "
                "what cartoloop.open_log returns"
            )
        return recording
    given = [recording] if isinstance(recording, str | PathLike) else recording
    if not given:
        raise UsageError("map_recording: recording is an empty list: give at least one path")
    files = regular_files([as_path(part, "recording") for part in given])
    if out is not None:
        folder_of(Path(out), files, overwrite=overwrite).check()
    return open_logs(files, options)


def folder_of(out: Path, files: Sequence[Path], *, overwrite: bool) -> RunFolder:
    """Return the folder for the map of a recording that is not open yet.

    Parameters
    ----------
    out : the folder.
    files : of the recording, in order.
    overwrite : whether the map of another recording may be replaced.
    """
    from cartoloop.readers.fingerprint import fingerprint, joint_fingerprint
    from cartoloop.readers.log import short_name

    name = " + ".join(short_name(file) for file in files)
    return RunFolder(out, name, joint_fingerprint([fingerprint(file) for file in files]), overwrite)
