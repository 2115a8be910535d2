# SPDX-License-Identifier: Apache-2.0
"""``cartoloop locate``: where a robot is in a finished map."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cartoloop.cli.locate_changes import NEVER_LOCATED_STATUS, ChangeOptions, update
from cartoloop.cli.options import (
    VIEW,
    ConfigOptions,
    LiveSourceOptions,
    ReadingOptions,
    parse_pose_deg,
)
from cartoloop.cli.view_command import ViewOptions

if TYPE_CHECKING:
    from typing import BinaryIO

    from cartoloop.config import Config
    from cartoloop.localisation.answer import Answer
    from cartoloop.localisation.localizer import Localizer
    from cartoloop.localisation.run import PoseKeeper, RunSummary
    from cartoloop.readers import Log
    from cartoloop.runtime.process_memory import PeriodicRelease
    from cartoloop.sensor.events import SensorEvent
    from cartoloop.sensor.pose import Pose
    from cartoloop.stop_request import StopRequest
    from cartoloop.viewer.locate_view import LocateView

START = "Start"
"""Group of options in the help."""

LIVE_SCHEMES = ("tcp", "ws", "ros2")
"""What the address of a live source begins with."""


@dataclass(frozen=True, kw_only=True)
class LocateOptions(ViewOptions, ChangeOptions, ReadingOptions, LiveSourceOptions, ConfigOptions):
    """Options of ``cartoloop locate``."""

    map_: Annotated[
        Path,
        typer.Argument(
            metavar="MAP",
            help="Folder of a finished map, or the YAML file of a map of another program, as ROS's "
            "map_server reads it.",
        ),
    ]
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE",
            help="A recording, or a live source: - (standard input), tcp://127.0.0.1:PORT, "
            "ws://127.0.0.1:PORT or ros2:.",
        ),
    ]
    poses: Annotated[
        str | None,
        typer.Option(
            metavar="FILE",
            help="Write a line of JSON for each scan; - prints it. docs/localisation.md "
            "describes it.",
        ),
    ] = None
    strict: Annotated[
        bool, typer.Option("--strict", help="End with status 3 if the robot was never located.")
    ] = False
    at: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,DEG",
            help="Pose of the robot at the first scan [m, m, deg], to about a metre and 20 deg.",
            rich_help_panel=START,
        ),
    ] = None
    keep: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Begin with the pose in this file, if it fits, and keep the latest pose in it.",
            rich_help_panel=START,
        ),
    ] = None
    view: Annotated[
        bool,
        typer.Option(
            "--view",
            help="Show the map in a browser, with the robot and where else it may be; its pose can "
            "be given there.",
            rich_help_panel=VIEW,
        ),
    ] = False

    def require_view(self) -> None:
        """Refuse options that have no effect without a view, or on such a source.

        Raises
        ------
        typer.BadParameter
            One was given.
        """
        super().require_view()
        if self.is_live and self.speed is not None:
            raise typer.BadParameter(
                "is for recordings: a live source has its own", param_hint="--speed"
            )
        given = {
            "--source-host": self.source_host is not None,
            "--end-after": self.end_after is not None,
            "--no-drop": self.no_drop,
        }
        if not self.is_live and (name := next((each for each in given if given[each]), None)):
            raise typer.BadParameter("is for live sources: leave it out", param_hint=name)

    @property
    def is_live(self) -> bool:
        """Whether SOURCE is a live source rather than a recording."""
        scheme, colon, _ = self.source.partition(":")
        return self.source == "-" or (bool(colon) and scheme.lower() in LIVE_SCHEMES)


def locate_command(options: LocateOptions) -> None:
    """Say where a robot is in a finished map, scan by scan, and when it is not known."""
    start = parse_pose_deg(options.at, "--at")
    options.require_view()
    options.read_options()  # refused before the map is read
    loaded = options.load()

    from cartoloop.cli.live_mapping import poses_stream
    from cartoloop.cli.locate_view import open_view, stay_open
    from cartoloop.cli.mapping import compilation_notice, show_problems
    from cartoloop.cli.stop_signals import stop_signals
    from cartoloop.errors import Interrupted
    from cartoloop.localisation.run import PoseKeeper, RunSummary
    from cartoloop.runtime.process_memory import (
        PeriodicRelease,
        relax_gc,
        set_malloc_thresholds,
    )

    set_malloc_thresholds()
    options.check(options.map_, is_live=options.is_live)
    is_quiet = options.poses == "-"
    log = None if options.is_live else _recording(options)
    with ExitStack() as closing:
        with (
            poses_stream(options.poses, options.map_, options.source) as poses,
            compilation_notice() as compiler,
            stop_signals() as stop,
        ):
            localizer = _localizer(options, loaded.config, start)
            relax_gc()
            keeper = None
            if options.keep is not None:
                keeper = PoseKeeper(options.keep, localizer, _warn, begins_there=start is None)
            view = closing.enter_context(open_view(options, localizer, log, is_quiet=is_quiet))
            run = _Run(RunSummary(), keeper, poses, view, PeriodicRelease(), is_quiet=is_quiet)
            if start is not None:
                run.watch_start(localizer)
            if log is None:
                _locate_source(options, localizer, run, stop)
            else:
                _locate_recording(log, localizer, run, stop)
            if keeper is not None:
                keeper.write()
            if view is not None:
                view.finished()
            run.say(run.summary.text())
            options.report(localizer, run.say)
            if log is not None and not options.update:
                show_problems(log, "`cartoloop doctor`")
            if options.update and log is not None:
                at = run.summary.first_pose
                update(options.map_, log, loaded, at, stop, compiler, run.say)
        was_stopped = log is not None and stop.made
        if view is not None and not stop.made:
            stay_open(view, is_quiet=is_quiet)
    if was_stopped:
        raise Interrupted(f"stopped after {sum(run.summary.states.values())} scans")
    if options.strict and run.summary.pose is None:
        raise typer.Exit(NEVER_LOCATED_STATUS)
    _require_whole(log)


def _recording(options: LocateOptions) -> Log:
    """Return the recording, which can be compared with the map as the options ask."""
    from cartoloop.readers import open_log

    log = open_log(options.source, options.read_options())
    options.check_recording(options.map_, log)
    return log


def _localizer(options: LocateOptions, config: Config, start: Pose | None) -> Localizer:
    """Return the localizer that the options ask for."""
    from cartoloop.localisation.localizer import Localizer

    return Localizer(
        options.map_,
        config,
        at=start,
        live=options.is_live,
        waits=options.no_drop,
        watch_changes=options.changes is not None,
    )


def _require_whole(log: Log | None) -> None:
    """Check that the recording was read to its end.

    Raises
    ------
    InputError
        A part of it was lost.
    """
    from cartoloop.errors import InputError

    problems = () if log is None else log.problems
    if lost := next((each.message for each in problems if each.severity == "error"), None):
        raise InputError(f"the poses are of a part of the recording: {lost}")


def _locate_recording(log: Log, localizer: Localizer, run: _Run, stop: StopRequest) -> None:
    """Localise by a recording."""
    from cartoloop.localisation.run import locate_events

    run.say(log.description)
    events: Iterable[SensorEvent] = log
    if run.view is not None:
        events = run.view.paced(log, lambda: stop.made)
    for answer in locate_events(localizer, events, stop):
        run.add(answer)
        run.write(answer)


class _Run:
    """What is printed and written of the answers.

    Parameters
    ----------
    summary : of all answers.
    keeper : keeps the pose on disk, or None.
    poses : stream for a line of JSON a scan, or None.
    view : shows the answers, or None.
    memory : released now and then.
    is_quiet : whether standard output is for poses.
    """

    def __init__(
        self,
        summary: RunSummary,
        keeper: PoseKeeper | None,
        poses: BinaryIO | None,
        view: LocateView | None,
        memory: PeriodicRelease,
        *,
        is_quiet: bool,
    ) -> None:
        self.summary = summary
        self.poses = poses
        self.view = view
        self._keeper = keeper
        self._is_quiet = is_quiet
        self._state = ""
        self._starting: Localizer | None = None
        self._memory = memory

    def watch_start(self, localizer: Localizer) -> None:
        """Say if the first scan does not fit at the pose that was given."""
        self._starting = localizer

    def say(self, line: str) -> None:
        """Print a line, to standard error where standard output is for poses."""
        typer.echo(line, err=self._is_quiet)

    def add(self, answer: Answer) -> None:
        """Count and show an answer, keep its pose, and say it if the state changes."""
        self.summary.add(answer)
        if self._keeper is not None:
            self._keeper.add(answer)
        if self._starting is not None and self._starting.given_pose_fits is not None:
            if not self._starting.given_pose_fits:
                self.say("--at: the scan does not fit there; the whole map is searched")
            self._starting = None
        if answer.state != self._state:
            self._state = answer.state
            self.say(change(answer))
        if self.view is not None:
            self.view.after_answer(answer)
        self._memory.after_scan()

    def write(self, answer: Answer) -> None:
        """Write the line of an answer.

        Raises
        ------
        OutputError
            It cannot be written.
        """
        if self.poses is None:
            return
        import json

        from cartoloop.errors import OutputError
        from cartoloop.localisation.lines import answer_content

        try:
            self.poses.write(json.dumps(answer_content(answer)).encode() + b"\n")
        except BrokenPipeError:
            self.poses = None  # the reader has left
        except OSError as error:
            raise OutputError(f"--poses: cannot be written: {error.strerror}") from error


def _warn(line: str) -> None:
    typer.echo(f"warning: {line}", err=True)


def change(answer: Answer) -> str:
    """Return the line that says a new state."""
    line = f"{answer.stamp:.3f}  {answer.state}"
    if answer.tf_map_tracking is not None:
        x, y, theta = answer.tf_map_tracking
        return f"{line}  x {x:.2f} m, y {y:.2f} m, {math.degrees(theta):.1f} deg"
    if answer.places:
        (x, y, theta), probability, _ = answer.places[0]
        count = len(answer.places)
        # The probability of a single place is relative to others, and there are none.
        places = (
            "one place fits, not proved yet:"
            if count == 1
            else f"{count} places fit, the likeliest ({probability:.0%})"
        )
        return f"{line}  {places} x {x:.2f} m, y {y:.2f} m, {math.degrees(theta):.1f} deg"
    return line


def _locate_source(
    options: LocateOptions,
    localizer: Localizer,
    run: _Run,
    stop: StopRequest,
) -> None:
    """Localise by the messages of a live source."""
    from cartoloop.cli.lost_output import would_wait
    from cartoloop.live import locate_run
    from cartoloop.live.notices import Notices
    from cartoloop.live.poses import PoseWriter
    from cartoloop.localisation.lines import answer_content

    def report(line: str) -> None:
        if not would_wait(sys.stderr):
            typer.echo(line, err=True)

    notices = Notices(report)
    source = options.make_source(options.source)
    locate_run.get_ready_to_locate(localizer.known_map)
    writer = None if run.poses is None else PoseWriter(run.poses, notices)

    def on_answer(answer: Answer, latency: float) -> None:
        if writer is not None:
            writer.put_content(answer_content(answer, latency))
        run.add(answer)

    messages = options.message_options()
    try:
        on_idle = None if run.view is None else run.view.idle
        locate_run.locate_live(source, localizer, messages, notices, on_answer, stop, on_idle)
    finally:
        if writer is not None:
            writer.close()
