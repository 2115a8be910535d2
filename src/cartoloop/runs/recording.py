# SPDX-License-Identifier: Apache-2.0
"""One call from a recording to a saved map: read, map, complete the report, save.

>>> from cartoloop.runs.recording import map_recording
>>> result = map_recording("intel.clf.gz", out="intel")
>>> result.report.wall_s, result.report.skipped
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from os import PathLike
from typing import TYPE_CHECKING, Any

from cartoloop.arguments import as_path
from cartoloop.map_file.run_header import RunHeader
from cartoloop.map_output.output_folder import RunFolder, prepare_folder
from cartoloop.map_sessions import checked_onto_pose
from cartoloop.runs.journal import RunJournal, begin_journal, options_document
from cartoloop.runs.observer import RunObserver
from cartoloop.runs.opening import loaded_config, opened_log
from cartoloop.runs.run import Run, carry_out
from cartoloop.stop_request import StopRequest

if TYPE_CHECKING:
    from cartoloop.config import Config
    from cartoloop.config_file import LoadedConfig
    from cartoloop.map_data import MapData
    from cartoloop.map_output.picture import Layer
    from cartoloop.readers import Log, ReadOptions
    from cartoloop.result import Result
    from cartoloop.sensor.pose import Pose


def map_recording(
    recording: str | PathLike[str] | Sequence[str | PathLike[str]] | Log,
    config: Config | LoadedConfig | None = None,
    out: str | PathLike[str] | None = None,
    *,
    options: ReadOptions | None = None,
    layers: Collection[Layer] | None = None,
    observer: RunObserver | None = None,
    stop: StopRequest | None = None,
    overwrite: bool = False,
    onto: MapData | str | PathLike[str] | None = None,
    onto_pose: Pose | None = None,
) -> Result:
    """Map a recording and save the map; the report has name, times and skipped lines.

    Parameters
    ----------
    recording : path of a recording, of its parts in order, or a log that is open.
    config : by default the defaults.
    out : folder to save in; None: the map is not saved. A finished map in it is only replaced when
        the run comes to its end; until then, the map of this one is saved in a folder inside.
    options : how to read the recording; see `cartoloop.readers.open_log`.
    layers : drawn over the picture of the map; by default the trajectory.
    observer : is informed of the progress.
    stop : by which another thread or a signal handler can stop the run. Ctrl-C stops it anyway.
    overwrite : whether the map of another recording in `out` may be replaced.
    onto : a map, or its path, that the recording is added to as a session; see `Mapper`. `out` may
        be its folder: then it is replaced when the run comes to its end, and stays otherwise.
    onto_pose : where the robot is in it at first, see `Mapper`.

    Raises
    ------
    InputError
        The recording cannot be read, has no scan that can be mapped, or only a part of it could
        be read or mapped. What was mapped until then is saved.
    OutputError
        The folder `out` cannot be written, or holds the map of another recording, or another run
        writes there; where possible, raised before mapping starts.
    Interrupted
        The run was stopped; what was mapped until then is saved, unless it was stopped again.
    """
    from cartoloop.map_output.picture import DEFAULT_LAYERS, known_layers

    loaded = loaded_config(config)
    drawn = DEFAULT_LAYERS if layers is None else known_layers(layers)
    out = None if out is None else as_path(out, "map_recording: out")
    start = checked_onto_pose(onto, onto_pose, "map_recording")
    log = opened_log(recording, options, out if onto is None else None, overwrite)
    base = None
    if onto is not None:
        from cartoloop.runs.base import base_of_new_run, has_recording

        base = base_of_new_run(onto, start, out, loaded.config, (log.name, log.fingerprint))
        if observer is not None and has_recording(base.content, log.fingerprint):
            observer.already_added(log.name)
    run = Run(log, loaded, drawn, observer or RunObserver(), stop or StopRequest(), base)
    if out is None:
        return carry_out(run, None, None)
    folder = run.folder(out, overwrite=overwrite)
    folder.check()
    prepare_folder(folder.path)
    return carry_out(run, folder, _new_journal(run, folder, options_document(options)))


def _new_journal(run: Run, folder: RunFolder, options: Mapping[str, Any]) -> RunJournal:
    header = RunHeader(
        "map",
        folder.name,
        folder.fingerprint,
        run.loaded.config,
        run.loaded.origins,
        options,
        tuple(run.layers),
        folder.overwrite,
    )
    if run.base is not None:
        graph = run.base.content.graph
        header = replace(
            header,
            continues=True,
            first_node=graph.num_nodes,
            first_submap=graph.num_submaps,
            base=run.base.about,
        )
    return begin_journal(folder.path, header, run.observer.journal_failed)
