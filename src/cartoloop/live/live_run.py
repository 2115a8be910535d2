# SPDX-License-Identifier: Apache-2.0
"""One call from a live source to a saved map: warm up, map, save while mapping and at the end."""

from __future__ import annotations

import time
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from secrets import token_hex
from typing import BinaryIO

from cartoloop.config import Config
from cartoloop.config_file import LoadedConfig
from cartoloop.errors import InputError, Interrupted
from cartoloop.live.continued import last_pose, map_to_add_to
from cartoloop.live.message_loop import MessageOptions, inbox_for
from cartoloop.live.notices import Notices
from cartoloop.live.poses import PoseWriter
from cartoloop.live.sequencer import Sequencer
from cartoloop.live.session import AddedScan, LiveSession
from cartoloop.live.source import Source
from cartoloop.live.warm_up import get_ready
from cartoloop.map_data import MapData
from cartoloop.map_file.run_header import BaseOfRun, RunHeader
from cartoloop.map_output.output_folder import RunFolder, map_state, prepare_folder
from cartoloop.map_output.picture import DEFAULT_LAYERS, Layer
from cartoloop.mapper import Mapper
from cartoloop.result import Result
from cartoloop.runs.base import base_of_new_run, is_same_folder, path_of_base
from cartoloop.runs.end import Outcome, Saved, completed, save_outcome, timed
from cartoloop.runs.events import finish
from cartoloop.runs.journal import RunJournal, begin_journal
from cartoloop.runs.observer import RunObserver
from cartoloop.sensor.pose import Pose
from cartoloop.session import named
from cartoloop.stop_request import StopRequest


@dataclass(frozen=True, slots=True)
class LiveOptions:
    """How a live source is mapped.

    Attributes
    ----------
    messages : how its messages are treated.
    poses : stream for a line of JSON with the pose of each scan, or None.
    start : where the robot is at first, in the map that is continued: to a metre or two and 20
        degrees; None: it is searched for everywhere.
    starts_at_end : whether it is still where that map ends.
    """

    messages: MessageOptions = field(default_factory=MessageOptions)
    poses: BinaryIO | None = None
    start: Pose | None = None
    starts_at_end: bool = False


class LiveObserver(RunObserver):
    """Callbacks of a live run; this one ignores them all."""

    def say(self, line: str) -> None:
        """Receive a line for the operator; may be called in any thread."""

    def changed(self, mapper: Mapper) -> None:
        """The map may have changed; also called now and then while no message arrives."""


def map_live(
    source: Source,
    config: Config | LoadedConfig | None,
    out: Path,
    options: LiveOptions | None = None,
    *,
    layers: Collection[Layer] = DEFAULT_LAYERS,
    observer: LiveObserver | None = None,
    stop: StopRequest | None = None,
    overwrite: bool = False,
    onto: MapData | str | PathLike[str] | None = None,
    lifelong: bool = False,
) -> Result:
    """Map what a source sends until it ends or the run is stopped, and save the map.

    Parameters
    ----------
    source : of messages; opened here.
    config : by default that of the map that is added to, or the defaults.
    out : folder to save in. While mapping, a journal is written there, which opens as a map. A
        finished map in it is only replaced when the run comes to its end.
    options : how messages are treated.
    layers : drawn over the picture of the map.
    observer : is informed of the progress.
    stop : ends the session when made; made again during the last pass, it skips that.
    overwrite : whether a map in `out` may be replaced.
    onto : a map, or its path, that the drive is added to as a session, which is apart until the
        robot is found in the map. It may be that in `out`, also of a live run that was interrupted;
        then it is replaced in the end, also if the run is stopped.
    lifelong : whether what the drive shows again gives way to it in the end; only with `onto`.

    Raises
    ------
    InputError
        The source cannot be opened, failed, or sent no scan that can be mapped. What was mapped
        until then is saved.
    OutputError
        The folder `out` cannot be written, or holds a map.
    Interrupted
        The last pass was stopped; what was mapped until then is saved, unless it was stopped again.
    """
    start = time.perf_counter()
    options, observer = options or LiveOptions(), observer or LiveObserver()
    stop = stop or StopRequest()
    plan = _plan(
        source.name, config, out, options, onto, observer, overwrite=overwrite, lifelong=lifelong
    )
    prepare_folder(out)
    notices = Notices(observer.say)
    journal = _journal(plan, layers, notices)
    try:
        mapped = _mapped(source, plan, journal, notices, options, observer, stop)
        outcome = _reported(mapped, plan.folder, notices, start)
        observer.mapped(outcome.result, outcome.failure)
        origins = plan.loaded.origins
        saved = save_outcome(outcome, plan.folder, layers, origins, observer.saving, start, stop)
        journal.remove()
    except KeyboardInterrupt as interrupt:
        raise Interrupted(_given_up(journal)) from interrupt
    finally:
        journal.close()
    observer.saved(saved.outcome.result, outcome.failure)
    _raise_if_incomplete(saved, source.name)
    return saved.outcome.result


@dataclass(frozen=True, slots=True)
class _Plan:
    """What is known of a run before its first message.

    Attributes
    ----------
    folder : where it is saved.
    loaded : the configuration.
    base : the map that it adds to, or None.
    start_pose : where the robot is in that at first, if it is known.
    about : what the journal says about that map.
    """

    folder: RunFolder
    loaded: LoadedConfig
    base: MapData | None
    start_pose: Pose | None
    about: BaseOfRun | None


def _plan(
    name: str,
    config: Config | LoadedConfig | None,
    out: Path,
    options: LiveOptions,
    onto: MapData | str | PathLike[str] | None,
    observer: LiveObserver,
    *,
    overwrite: bool,
    lifelong: bool,
) -> _Plan:
    """Return what a run begins with, given the name of its source; see :func:`map_live`."""
    adds = is_same_folder(onto, out)
    base = None if onto is None else map_to_add_to(onto, out, observer.say)
    added_to = map_state(out) if adds else None
    loaded = _loaded(config, base, lifelong=lifelong)
    # No drive is the same as another.
    folder = RunFolder(out, name, token_hex(8), overwrite, adds_for_good=adds, added_to=added_to)
    folder.check()
    start_pose = last_pose(base) if options.starts_at_end and base else options.start
    about = None
    if base is not None and onto is not None:
        recording = folder.name, folder.fingerprint
        run_base = base_of_new_run(base, start_pose, out, loaded.config, recording)
        about = replace(run_base.about, path=path_of_base(onto, out))
    return _Plan(folder, loaded, base, start_pose, about)


def _mapped(
    source: Source,
    plan: _Plan,
    journal: RunJournal,
    notices: Notices,
    options: LiveOptions,
    observer: LiveObserver,
    stop: StopRequest,
) -> Outcome:
    """Map until the source ends, and do the last pass; a journal without a scan is removed."""
    get_ready()
    mapper = Mapper(
        plan.loaded.config,
        live=True,
        onto=plan.base,
        onto_pose=plan.start_pose,
        outcomes=journal.outcomes,
    )
    files = _Files(notices, options.poses)
    try:
        failure = _map_source(source, mapper, notices, options, files, observer, stop)
        if plan.base is not None and mapper.num_scans == 0:
            nothing = f"{source.name}: no scan has arrived; nothing was saved"
            raise failure or InputError(nothing)
    except BaseException:
        mapper.close()
        if mapper.num_scans == 0:
            journal.remove()
        raise
    outcome = _finish(mapper, observer, stop, failure)
    files.close()
    return outcome


def _loaded(
    config: Config | LoadedConfig | None, base: MapData | None, *, lifelong: bool
) -> LoadedConfig:
    """Return the configuration: that of the map that is added to if none is given.

    Whether old gives way to new is no matter of that map: it is decided for each session.
    """
    if isinstance(config, LoadedConfig):
        loaded = config
    elif config is not None or base is None:
        loaded = LoadedConfig(config or Config(), {})
    else:
        off = base.config.lifelong.model_copy(update={"enabled": False})
        loaded = LoadedConfig(base.config.model_copy(update={"lifelong": off}), {})
    if not lifelong:
        return loaded
    section = loaded.config.lifelong.model_copy(update={"enabled": True})
    return replace(loaded, config=loaded.config.model_copy(update={"lifelong": section}))


def _journal(plan: _Plan, layers: Collection[Layer], notices: Notices) -> RunJournal:
    """Return the journal of a new run in its folder."""

    def note(problem: str) -> None:
        notices.note("the journal is not written", problem)

    folder, base = plan.folder, plan.base
    header = RunHeader(
        "live",
        folder.name,
        folder.fingerprint,
        plan.loaded.config,
        plan.loaded.origins,
        layers=tuple(layers),
        overwrite=folder.overwrite,
        continues=base is not None,
        first_node=base.graph.num_nodes if base else 0,
        first_submap=base.graph.num_submaps if base else 0,
        base=plan.about,
    )
    return begin_journal(folder.path, header, note)


class _Files:
    """What is written while mapping besides the journal.

    Parameters
    ----------
    notices : of failures to write.
    poses : stream for poses, or None.
    """

    def __init__(self, notices: Notices, poses: BinaryIO | None) -> None:
        self._poses = None if poses is None else PoseWriter(poses, notices)

    def after_scan(self, scan: AddedScan) -> None:
        """Write the pose of a scan."""
        if self._poses is not None:
            self._poses.put(scan.stamp, scan.tf_local_tracking, scan.tf_map_tracking, scan.latency)

    def close(self) -> None:
        """Wait until all is written; only after the mapper was closed."""
        if self._poses is not None:
            self._poses.close()


def _map_source(
    source: Source,
    mapper: Mapper,
    notices: Notices,
    options: LiveOptions,
    files: _Files,
    observer: LiveObserver,
    stop: StopRequest,
) -> Exception | None:
    """Map until the source ends; return its failure if there is still a map to save."""

    def after_scan(scan: AddedScan) -> None:
        files.after_scan(scan)
        observer.changed(mapper)

    messages = options.messages
    session = LiveSession(
        source,
        mapper,
        inbox_for(source, messages),
        Sequencer(notices, messages.max_delay, messages.laser_pose),
        notices,
        after_scan=after_scan,
        idle=lambda: observer.changed(mapper),
        end_after=messages.end_after,
    )
    observer.say(f"{source.open()} (Ctrl-C ends)")
    try:
        session.run(lambda: stop.made)
    except KeyboardInterrupt:
        stop.made = True
    except Exception as failure:
        if mapper.num_scans == 0:
            raise
        return failure
    return None


def _finish(
    mapper: Mapper, observer: LiveObserver, stop: StopRequest, failure: Exception | None
) -> Outcome:
    """Do the last pass, unless the session failed."""
    stop.made = False  # the request that ended the session; another one skips the last pass
    if failure is None:
        return finish(mapper, observer, stop)
    mapper.close()
    return Outcome(mapper.result(), failure, is_complete=False)


def _reported(outcome: Outcome, folder: RunFolder, notices: Notices, start: float) -> Outcome:
    """Return the outcome with a report that says all about the source and the run."""
    result = outcome.result
    report = completed(result, folder.name, notices.skipped, fingerprint=folder.fingerprint)
    report = replace(report, finished=report.finished and report.nodes > 0)
    sessions = named(result.sessions, folder.name, folder.fingerprint)
    return replace(outcome, result=replace(result, report=timed(report, start), sessions=sessions))


def _given_up(journal: RunJournal) -> str:
    """Return what is left when the user does not wait for the map to be saved."""
    if not journal.path.is_file():
        return "stopped at once: nothing was saved"
    return f"stopped at once: the map is in {journal.path} alone, which `cartoloop view` opens"


def _raise_if_incomplete(saved: Saved, name: str) -> None:
    """Raise the error of a session whose map is not complete."""
    outcome, where = saved.outcome, saved.where
    if outcome.failure is not None:
        raise outcome.failure
    if not outcome.is_complete:
        raise Interrupted(f"the last loops were not closed; the map so far is{where}")
    if outcome.result.report.nodes == 0:
        raise InputError(
            f"{name}: no scan with enough returns to be mapped has arrived, the map{where} is "
            "empty; docs/live.md describes what to send"
        )
