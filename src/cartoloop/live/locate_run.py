# SPDX-License-Identifier: Apache-2.0
"""From a live source to poses in a finished map, until the source ends or the user stops it."""

from __future__ import annotations

import math
from collections.abc import Callable
from time import monotonic

import numpy as np

from cartoloop.config import LocalSlamConfig
from cartoloop.live.message_loop import MessageLoop, MessageOptions, inbox_for
from cartoloop.live.notices import Notices
from cartoloop.live.sequencer import Sequencer
from cartoloop.live.source import Source
from cartoloop.live.warm_up import get_ready, tidy
from cartoloop.localisation.answer import Answer
from cartoloop.localisation.decision import decide
from cartoloop.localisation.known_map import KnownMap
from cartoloop.localisation.localizer import Localizer
from cartoloop.localisation.tracking import Tracker
from cartoloop.localisation.trail import Trail
from cartoloop.sensor.events import SensorEvent
from cartoloop.sensor.pose import IDENTITY, Pose
from cartoloop.stop_request import StopRequest

_TIDY_S = 5.0
"""Period at which memory is collected [s]."""

OnAnswer = Callable[[Answer, float], None]
"""Receives an answer, and the time from the arrival of its scan to it [s]."""


def get_ready_to_locate(known: KnownMap) -> None:
    """Compile all kernels, and prepare this process for answers without delay."""
    angles = np.linspace(-math.pi, math.pi, 90, endpoint=False)
    points = 3.0 * np.column_stack((np.cos(angles), np.sin(angles)))
    trail = Trail()
    trail.add(IDENTITY, points, IDENTITY)
    composite = trail.composite(1.0)
    if composite is not None:
        decide(known, composite, 0.0)
    centre = known.to_map(Pose(known.grid.origin_x, known.grid.origin_y, 0.0))
    Tracker(known, LocalSlamConfig(), centre, 1e-4 * np.eye(3)).correct(points, IDENTITY)
    get_ready()


def locate_live(
    source: Source,
    localizer: Localizer,
    options: MessageOptions,
    notices: Notices,
    on_answer: OnAnswer,
    stop: StopRequest,
    on_idle: Callable[[], None] | None = None,
) -> None:
    """Localise a robot by what a source sends, until it ends or the run is stopped.

    Parameters
    ----------
    source : opened here.
    options : how messages are treated.
    localizer : made for live use.
    notices : receives the problems of messages.
    on_answer : called with each answer; must be quick.
    on_idle : called in each cycle of 50 ms or less, also without messages.

    Raises
    ------
    InputError
        The source cannot be opened, or failed.
    """
    notices.say(f"{source.open()} (Ctrl-C ends)")
    inbox = inbox_for(source, options)
    sequencer = Sequencer(notices, options.max_delay, options.laser_pose)
    next_tidy = monotonic()

    def add(event: SensorEvent, arrival: float) -> None:
        localizer.add(event, lambda answer: on_answer(answer, inbox.now() - arrival))

    def idle() -> None:
        nonlocal next_tidy
        if on_idle is not None:
            on_idle()
        if monotonic() >= next_tidy:
            next_tidy = monotonic() + _TIDY_S
            tidy()

    loop = MessageLoop(
        source, inbox, sequencer, notices, add, idle=idle, end_after=options.end_after
    )
    try:
        loop.run(lambda: stop.made)
    except KeyboardInterrupt:
        stop.made = True
