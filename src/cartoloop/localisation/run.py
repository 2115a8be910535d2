# SPDX-License-Identifier: Apache-2.0
"""What a run of a localiser came to, whatever its source: counts, and the pose that is kept."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

from cartoloop.errors import OutputError
from cartoloop.localisation.answer import Answer, State
from cartoloop.localisation.lines import KeptPose, read_pose_file, write_pose_file
from cartoloop.localisation.localizer import Localizer
from cartoloop.sensor.events import SensorEvent
from cartoloop.sensor.pose import IDENTITY, Pose, compose, relative
from cartoloop.stop_request import StopRequest

KEEP_PERIOD_S = 5.0
"""Period at which the pose is kept on disk, by the stamps of scans [s]."""


@dataclass(slots=True)
class RunSummary:
    """Counts of the answers of a run.

    Attributes
    ----------
    states : number of scans by state.
    times_lost : how often the place was known and then not.
    path_to_first : path by local SLAM until the place was first known [m]; NaN: it never was.
    pose : the last pose in the map, None without any.
    first_pose : the pose in the map at the first scan, by that at the first scan that was located
        and the motion before it; None without any.
    """

    states: Counter[State] = field(default_factory=Counter)
    times_lost: int = 0
    path_to_first: float = math.nan
    pose: Pose | None = None
    first_pose: Pose | None = None
    _path: float = 0.0
    _first_local: Pose = IDENTITY
    _last: Answer | None = None

    def add(self, answer: Answer) -> None:
        """Count an answer."""
        last = self._last
        if last is None:
            self._first_local = answer.tf_local_tracking
        else:
            step = math.dist(last.tf_local_tracking[:2], answer.tf_local_tracking[:2])
            self._path += step
            self.times_lost += last.state is State.LOCATED and answer.state is not State.LOCATED
        self.states[answer.state] += 1
        if answer.tf_map_tracking is not None:
            self.pose = answer.tf_map_tracking
            if self.first_pose is None:
                self.path_to_first = self._path
                back = relative(answer.tf_local_tracking, self._first_local)
                self.first_pose = compose(self.pose, back)
        self._last = answer

    def text(self) -> str:
        """Return the summary for the terminal."""
        num_scans = sum(self.states.values())
        counts = ", ".join(f"{self.states[state]} {state}" for state in State if self.states[state])
        lines = [f"{'scans':<15}{num_scans}: {counts or 'none'}"]
        if self.pose is None:
            return "\n".join((*lines, f"{'located':<15}never"))
        times = "once" if self.times_lost == 1 else f"{self.times_lost} times"
        lost = f", lost {times}" if self.times_lost else ""
        x, y, theta = self.pose
        return "\n".join(
            (
                *lines,
                f"{'located':<15}after {self.path_to_first:.1f} m{lost}",
                f"{'last pose':<15}x {x:.2f} m, y {y:.2f} m, {math.degrees(theta):.1f} deg",
            )
        )


class PoseKeeper:
    """Keeps the pose on disk, so that the next run can begin with it.

    Parameters
    ----------
    path : of the file.
    localizer : that begins with the pose in the file, if there is one.
    warn : receives the reason when the file cannot be written during the run, once.
    begins_there : false where another pose was given to begin with.

    Raises
    ------
    InputError
        The file is no file of a pose.
    OutputError
        The folder of the file does not exist, or cannot be written to.
    """

    def __init__(
        self,
        path: Path,
        localizer: Localizer,
        warn: Callable[[str], None],
        *,
        begins_there: bool = True,
    ) -> None:
        self._path, self._localizer, self._warn = path, localizer, warn
        self._has_warned = False
        self._kept_at = -math.inf
        self._kept: KeptPose | None = None
        if not os.access(path.parent, os.W_OK | os.X_OK):
            raise OutputError(f"{path}: cannot be written; give a file in a folder that can be")
        kept = read_pose_file(path)
        if begins_there and kept is not None:
            localizer.start_near(kept.tf_map_tracking, kept.tf_odom_tracking)

    def add(self, answer: Answer) -> None:
        """Note an answer, and write its pose now and then."""
        if answer.tf_map_tracking is None:
            return
        self._kept = KeptPose(answer.tf_map_tracking, self._localizer.odometry_pose)
        if abs(answer.stamp - self._kept_at) >= KEEP_PERIOD_S:
            self._kept_at = answer.stamp
            try:
                self.write()
            except OutputError as error:
                # A full disk must not take the pose from a robot that drives by it.
                if not self._has_warned:
                    self._warn(f"{error}; localising goes on")
                self._has_warned = True

    def write(self) -> None:
        """Write the last pose, if there is any, with the odometry's pose then.

        Raises
        ------
        OutputError
            The file cannot be written.
        """
        if self._kept is not None:
            write_pose_file(self._path, self._kept)


def locate_events(
    localizer: Localizer, events: Iterable[SensorEvent], stop: StopRequest
) -> Iterable[Answer]:
    """Yield the answers to the scans of a recording, until its end or until stopped."""
    answers: list[Answer] = []
    for event in events:
        if stop.made:
            return
        localizer.add(event, answers.append)
        yield from answers
        answers.clear()
    localizer.finish(answers.append)
    yield from answers
