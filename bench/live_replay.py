# SPDX-License-Identifier: Apache-2.0
# ruff: noqa: T201 - its output is read by the process that started it
"""A recording as a live source, in a process of its own: the latency of each pose.

Run: ``python -m bench.live_replay LOG FIRST PACE SECONDS [PACE SECONDS ...]``; maps
FIRST events at full speed, then SECONDS at each PACE, and prints the results as JSON.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from threading import Event

import numpy as np

from cartoloop.config import Config
from cartoloop.live.inbox import Arrival, Inbox
from cartoloop.live.messages import EndMessage, parse_message
from cartoloop.live.notices import Notices
from cartoloop.live.sequencer import Sequencer
from cartoloop.live.session import AddedScan, LiveSession
from cartoloop.live.source import Put
from cartoloop.live.warm_up import get_ready
from cartoloop.map_file.run_header import RunHeader
from cartoloop.mapper import Mapper
from cartoloop.readers import open_log
from cartoloop.runs.journal import RunJournal, begin_journal
from cartoloop.sensor.events import LaserScan, Odometry, SensorEvent

CONFIG = Config()

SETTLING_S = 5.0


@dataclass(frozen=True, slots=True)
class PaceResult:
    """The results at one pace.

    Attributes
    ----------
    pace : times real time.
    scans : number of scans sent.
    poses : number of them that got a pose.
    latencies : of each, from its arrival until its pose was available [s].
    pose_cpu_s : of each, processor time of the mapping thread until its pose was available [s]: the
        latency on a processor that no other program uses.
    cpu_s : the same, including the work after the pose and between scans [s].
    joined_after : of each closure, periods of adjustment from the request of its search until it
        was added to the graph.
    nodes, closures, adjustments : number added meanwhile.
    journal_bytes : written meanwhile.
    searched : number of searches.
    put_off : searches that had started but not ended when the graph was adjusted.
    dropped : searches dropped.
    """

    pace: float
    scans: int
    poses: int
    latencies: list[float]
    pose_cpu_s: list[float]
    cpu_s: list[float]
    joined_after: list[float]
    nodes: int
    closures: int
    adjustments: int
    journal_bytes: int
    searched: int
    put_off: int
    dropped: int


class PacedSource:
    """Sends lines when they are due. Parsing them is a part of receiving.

    Parameters
    ----------
    events : to send.
    pace : times real time.
    """

    name = "replay"

    def __init__(self, events: Sequence[SensorEvent], pace: float) -> None:
        self._lines = [line_of(event) for event in events]
        self._due = [(event.time - events[0].time) / pace for event in events]

    def open(self) -> str:
        """Return its name."""
        return self.name

    def run(self, put: Put, notices: Notices, stop: Event) -> None:
        """Send all lines, then the end."""
        start = time.perf_counter()
        for line, due in zip(self._lines, self._due, strict=True):
            while (left := start + due - time.perf_counter()) > 0.0:
                time.sleep(left)
            if stop.is_set():
                return
            put(parse_message(line))
        put(EndMessage())


class _WatchedInbox(Inbox):
    """Records the processor time of the mapping thread at each take [s]."""

    cpu_s = 0.0

    def take(self, timeout: float) -> list[Arrival]:
        """Return what has arrived; see :class:`Inbox`."""
        arrivals = super().take(timeout)
        self.cpu_s = time.thread_time()
        return arrivals


def replay(path: Path, num_first: int, paces: Sequence[tuple[float, float]]) -> list[PaceResult]:
    """Map the first events of a recording, then a part at each pace, as a live source sends them.

    Parameters
    ----------
    path : of the recording.
    num_first : number of events that are mapped before.
    paces : multiples of real time, each with its duration [s].
    """
    events = iter(open_log(path))
    get_ready()
    results = []
    notices = Notices(lambda line: print(line, file=sys.stderr))
    sequencer = Sequencer(notices)
    with tempfile.TemporaryDirectory(prefix="cartoloop-live-") as folder:
        header = RunHeader("live", path.name, "", CONFIG)
        journal = begin_journal(Path(folder), header, notices.say)
        mapper = Mapper(CONFIG, live=True, outcomes=journal.outcomes)
        for event in islice(events, num_first):
            mapper.add(event)
        _catch_up(mapper)
        # The session holds scans back until it knows the sensors: their latency is not measured.
        start = list(_of_duration(events, SETTLING_S))
        _at_pace(start, 1.0, mapper, sequencer, notices, journal)
        for pace, seconds in paces:
            part = list(_of_duration(events, pace * seconds))
            results.append(_at_pace(part, pace, mapper, sequencer, notices, journal))
        mapper.close()
        journal.close()
    return results


def _at_pace(
    events: Sequence[SensorEvent],
    pace: float,
    mapper: Mapper,
    sequencer: Sequencer,
    notices: Notices,
    journal: RunJournal,
) -> PaceResult:
    latencies: list[float] = []
    pose_cpu_s: list[float] = []
    inbox = _WatchedInbox()
    cpu_times: list[float] = []

    def after_scan(scan: AddedScan) -> None:
        latencies.append(scan.latency)
        pose_cpu_s.append(time.thread_time() - inbox.cpu_s)
        cpu_times.append(time.thread_time())

    session = LiveSession(
        PacedSource(events, pace), mapper, inbox, sequencer, notices, after_scan=after_scan
    )
    before, num_found = _counts(mapper, journal), mapper.global_slam.closures.num_found
    session.run(lambda: False)
    _catch_up(mapper)
    after = _counts(mapper, journal)
    num_scans = sum(isinstance(event, LaserScan) for event in events)
    added = [now - then for now, then in zip(after, before, strict=True)]
    cpu_s = np.diff(cpu_times).tolist()
    period = CONFIG.global_slam.optimize_every_n_nodes
    joined = (mapper.global_slam.closures.num_nodes_to_join()[num_found:] / period).tolist()
    return PaceResult(pace, num_scans, len(latencies), latencies, pose_cpu_s, cpu_s, joined, *added)


def _counts(mapper: Mapper, journal: RunJournal) -> tuple[int, ...]:
    slam = mapper.global_slam
    return (
        mapper.num_nodes,
        slam.closures.num_found,
        len(slam.adjustments),
        journal.num_written,
        slam.closures.num_searched,
        slam.num_put_off,
        slam.closures.num_dropped,
    )


def _catch_up(mapper: Mapper) -> None:
    """Return when all nodes are in the graph and all searches have ended."""
    done = Event()
    mapper.run_on_graph_thread(done.set)
    done.wait()
    while mapper.global_slam.search.num_running:
        time.sleep(0.01)


def _of_duration(events: Iterator[SensorEvent], seconds: float) -> Iterator[SensorEvent]:
    """Yield the events of the next `seconds` of a recording."""
    first: float | None = None
    for event in events:
        first = event.time if first is None else first
        if event.time - first > seconds:
            return
        yield event


def line_of(event: SensorEvent) -> bytes:
    """Return an event as a robot would send it."""
    content: dict[str, object]
    if isinstance(event, LaserScan):
        geometry = event.geometry
        content = {
            "type": "scan",
            "stamp": event.stamp,
            "angle_min": geometry.angle_min,
            "angle_increment": geometry.angle_increment,
            "ranges": np.round(event.ranges, 3).tolist(),
            "pose": list(geometry.tf_tracking_sensor),
        }
    elif isinstance(event, Odometry):
        x, y, theta = event.tf_odom_tracking
        content = {"type": "odometry", "stamp": event.stamp, "x": x, "y": y, "theta": theta}
    else:
        raise TypeError(f"recordings with {type(event).__name__} are not replayed")
    return json.dumps(content).encode()


def main() -> None:
    """Print the results of the replay that the arguments describe."""
    path, num_first, *rest = sys.argv[1:]
    numbers = [float(number) for number in rest]
    paces = list(zip(numbers[::2], numbers[1::2], strict=True))
    print(json.dumps([asdict(done) for done in replay(Path(path), int(num_first), paces)]))


if __name__ == "__main__":
    main()
