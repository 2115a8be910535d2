# SPDX-License-Identifier: Apache-2.0
"""From a source to a map, until the source ends or the user stops it."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from time import monotonic

import numpy as np

from cartoloop.live.inbox import Inbox
from cartoloop.live.message_loop import MessageLoop
from cartoloop.live.notices import Notices
from cartoloop.live.sequencer import Sequencer
from cartoloop.live.source import Source
from cartoloop.live.warm_up import tidy
from cartoloop.mapper import Mapper
from cartoloop.sensor.events import SensorEvent
from cartoloop.sensor.pose import Pose

STATUS_S = 5.0
"""Period of the status lines [s]."""


@dataclass(frozen=True, slots=True)
class AddedScan:
    """A scan at the moment its pose is known.

    Attributes
    ----------
    stamp : of the scan [s].
    tf_local_tracking, tf_map_tracking : its pose in both frames.
    latency : from its arrival to the pose [s].
    """

    stamp: float
    tf_local_tracking: Pose
    tf_map_tracking: Pose
    latency: float


class LiveSession:
    """Maps what a source sends, and publishes each pose before its scan is inserted.

    Parameters
    ----------
    source : opened already.
    mapper : made for live mapping.
    inbox, sequencer, notices : queue, order and problems of the messages in between.
    after_scan : called when a pose is known, before its scan is inserted; must be quick.
    idle : called in each cycle of 50 ms or less, also without messages.
    end_after : end after this time without a message [s]; never if None.

    Attributes
    ----------
    latencies : of the last scans [s].
    """

    def __init__(
        self,
        source: Source,
        mapper: Mapper,
        inbox: Inbox,
        sequencer: Sequencer,
        notices: Notices,
        *,
        after_scan: Callable[[AddedScan], None] | None = None,
        idle: Callable[[], None] | None = None,
        end_after: float | None = None,
    ) -> None:
        self._mapper = mapper
        self._inbox = inbox
        self._notices = notices
        self._after_scan = after_scan
        self._idle = idle
        self._loop = MessageLoop(
            source, inbox, sequencer, notices, self._add, idle=self._tidy, end_after=end_after
        )
        self._has_answered = False
        self._next_status = monotonic() + STATUS_S
        self.latencies: deque[float] = deque(maxlen=1000)

    def run(self, is_stopped: Callable[[], bool]) -> None:
        """Map the messages; return at the end of the source, or when stopped.

        Raises
        ------
        Exception
            The failure of the source or the mapper.
        """
        self._loop.run(is_stopped)

    def _add(self, event: SensorEvent, arrival: float) -> None:
        self._mapper.add(event, partial(self._publish, event.stamp, arrival))

    def _publish(self, stamp: float, arrival: float) -> None:
        """Publish the pose of a scan that is not inserted yet."""
        latency = self._inbox.now() - arrival
        self.latencies.append(latency)
        self._has_answered = True
        if self._after_scan is not None:
            pose, local = self._mapper.pose, self._mapper.local_pose
            self._after_scan(AddedScan(stamp, local, pose, latency))

    def _tidy(self) -> None:
        """Report the status now and then, and collect memory when no scan is near."""
        if self._idle is not None:
            self._idle()
        # Right after a scan was answered, the next one is as far away as it can be.
        if self._has_answered and monotonic() >= self._next_status:
            self._next_status = monotonic() + STATUS_S
            tidy()
            self._notices.say(self._status())
        self._has_answered = False

    def _status(self) -> str:
        mapper = self._mapper
        p50, p99 = 1e3 * np.quantile(self.latencies or [0.0], (0.5, 0.99))
        slam = mapper.global_slam
        num_dropped = slam.closures.num_dropped
        dropped = f", {num_dropped} dropped" if num_dropped else ""
        return (
            f"{mapper.num_scans} scans, {mapper.num_loop_closures} closures, latency {p50:.1f} ms "
            f"(p99 {p99:.1f}), {slam.search.backlog} searches behind{dropped}"
        )
