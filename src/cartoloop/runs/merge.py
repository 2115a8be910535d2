# SPDX-License-Identifier: Apache-2.0
"""One call from maps to a merged one in a folder: read, merge, complete the report, save."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from cartoloop.config_file import LoadedConfig, config_hash
from cartoloop.errors import Interrupted, UsageError
from cartoloop.map_data import MapData
from cartoloop.map_output.output_folder import RunFolder, prepare_folder
from cartoloop.runs.end import Outcome, save_outcome, timed
from cartoloop.stop_request import StopRequest

if TYPE_CHECKING:
    from cartoloop.map_output.picture import Layer
    from cartoloop.result import Result


def merge_maps(
    maps: Sequence[Path],
    config: LoadedConfig | None,
    out: Path,
    *,
    layers: Collection[Layer],
    note: Callable[[str], None],
    stop: StopRequest,
    overwrite: bool = False,
) -> tuple[Result, Path]:
    """Merge maps and save the result; return it and the folder that it is in.

    Parameters
    ----------
    maps : folders or files, at least two.
    config : None: that of the first map.
    out : folder; it may be that of one of the maps.
    layers : drawn over the picture of the map.
    note : called with a description of each step as it begins.
    stop : ends the run; nothing is saved then.
    overwrite : whether another map in `out` may be replaced.

    Raises
    ------
    InputError, OutputError
        A map cannot be read, or the folder not be written.
    Interrupted
        The run was stopped; nothing was changed.
    """
    from cartoloop.merging import merge, require_different
    from cartoloop.readers.fingerprint import joint_fingerprint
    from cartoloop.result import load_map

    if len(maps) < 2:
        raise UsageError("merge: one map given: give at least two")
    require_different(maps)
    start = time.perf_counter()
    loaded = [load_map(each) for each in maps]
    for line in _in_several(maps, loaded):
        note(line)
    fingerprint = joint_fingerprint([each.report.fingerprint for each in loaded])
    name = " + ".join(each.report.input.name for each in loaded)
    folder = RunFolder(out, name, fingerprint, overwrite)
    folder.check()
    prepare_folder(out)
    try:
        with stop.at_once():
            result = merge(loaded, None if config is None else config.config, note)
    except KeyboardInterrupt as interrupt:
        raise Interrupted("stopped: nothing was saved") from interrupt
    report = replace(result.report, fingerprint=fingerprint, config_hash=config_hash(result.config))
    result = replace(result, report=timed(report, start))
    origins = {} if config is None else config.origins
    outcome = Outcome(result, None, is_complete=True)
    saved = save_outcome(
        outcome, folder, layers, origins, lambda place: note(f"writing {place}"), start, stop
    )
    return saved.outcome.result, saved.place or out


def _in_several(maps: Sequence[Path], contents: Sequence[MapData]) -> Iterator[str]:
    """Yield a line for each recording that is in two of the maps."""
    seen: dict[str, Path] = {}
    for path, content in zip(maps, contents, strict=True):
        for session in content.sessions:
            first = seen.setdefault(session.fingerprint, path)
            if session.fingerprint and first != path:
                yield (
                    f"warning: {session.recording or 'a recording'} is in {first} and in {path}: "
                    "its scans will be in the merged map twice"
                )
