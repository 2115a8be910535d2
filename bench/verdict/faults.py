# SPDX-License-Identifier: Apache-2.0
"""What is done to a recording, or to the configuration, so that maps fail honestly."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from cartoloop.config import Config
from cartoloop.config_file import load_config
from cartoloop.sensor.events import LaserScan, Odometry, SensorEvent
from cartoloop.sensor.pose import Pose, compose, inverse
from cartoloop.simulation import OdometryModel

Change = Callable[[list[SensorEvent], np.random.Generator], list[SensorEvent]]


@dataclass(frozen=True)
class Fault:
    """Something that goes wrong.

    Attributes
    ----------
    settings : of the configuration, as given to ``--set``.
    odometry : errors of the simulated odometry, or None for the usual ones.
    without_odometry : whether the recording has none.
    change : what is done to the events.
    is_fault : whether it may fail at all; otherwise maps are to be right.
    """

    settings: tuple[str, ...] = ()
    odometry: OdometryModel | None = None
    without_odometry: bool = False
    change: Change | None = field(default=None)
    is_fault: bool = True

    def config(self) -> Config:
        """Return the defaults with the settings."""
        return load_config(None, self.settings).config


def _split(events: list[SensorEvent]) -> tuple[float, float]:
    return events[0].time, events[-1].time


def cut(events: list[SensorEvent], rng: np.random.Generator) -> list[SensorEvent]:
    """Remove some time in which the robot was moved by hand: its odometry does not know."""
    start, end = _split(events)
    length = rng.uniform(6.0, 20.0)
    first = rng.uniform(start + 0.25 * (end - start), start + 0.7 * (end - start))
    return _without(events, first, first + length, odometry_knows=False)


def pause(events: list[SensorEvent], rng: np.random.Generator) -> list[SensorEvent]:
    """Remove some time in which the odometry went on: harmless, if there is odometry."""
    if not any(isinstance(event, Odometry) for event in events):
        return events
    start, end = _split(events)
    first = rng.uniform(start + 0.25 * (end - start), start + 0.7 * (end - start))
    return _without(events, first, first + rng.uniform(2.0, 5.0), odometry_knows=True)


def _without(
    events: list[SensorEvent], first: float, last: float, *, odometry_knows: bool
) -> list[SensorEvent]:
    kept = [event for event in events if not first <= event.time < last]
    if odometry_knows:
        return kept
    before = [e for e in kept if isinstance(e, Odometry) and e.time < first]
    after = [e for e in kept if isinstance(e, Odometry) and e.time >= last]
    if not before or not after:
        return kept
    moved = compose(before[-1].tf_odom_tracking, inverse(after[0].tf_odom_tracking))
    return [
        replace(e, tf_odom_tracking=compose(moved, e.tf_odom_tracking))
        if isinstance(e, Odometry) and e.time >= last
        else e
        for e in kept
    ]


def turn_missing(events: list[SensorEvent], rng: np.random.Generator) -> list[SensorEvent]:
    """Remove one of the turns: neither scans nor odometry of it."""
    readings = [e for e in events if isinstance(e, Odometry)]
    headings = np.unwrap([e.tf_odom_tracking.theta for e in readings])
    times = np.array([e.time for e in readings])
    later = np.minimum(np.searchsorted(times, times + 4.0), len(times) - 1)
    turned = np.abs(headings[later] - headings)
    middle = (np.arange(len(times)) > 0.2 * len(times)) & (
        np.arange(len(times)) < 0.75 * len(times)
    )
    sharp = np.flatnonzero(middle & (turned > math.radians(50.0)))
    if len(sharp) == 0:
        return cut(events, rng)
    first = int(rng.choice(sharp))
    return _without(events, float(times[first]), float(times[later[first]]), odometry_knows=False)


def frozen(events: list[SensorEvent], rng: np.random.Generator) -> list[SensorEvent]:
    """Let the odometry stand still from some time on."""
    start, end = _split(events)
    at = rng.uniform(start + 0.1 * (end - start), start + 0.5 * (end - start))
    last: Pose | None = None
    changed: list[SensorEvent] = []
    for event in events:
        if not isinstance(event, Odometry):
            changed.append(event)
            continue
        if event.time < at or last is None:
            last = event.tf_odom_tracking
        changed.append(replace(event, tf_odom_tracking=last))
    return changed


def jumps(events: list[SensorEvent], rng: np.random.Generator) -> list[SensorEvent]:
    """Let the odometry jump a few times by metres and tens of degrees."""
    start, end = _split(events)
    at = np.sort(rng.uniform(start, end, 6))
    moves = [Pose(*rng.normal(0.0, (1.0, 1.0, 0.7))) for _ in at]
    moved = Pose(0.0, 0.0, 0.0)
    changed: list[SensorEvent] = []
    for event in events:
        while len(at) and event.time >= at[0]:
            moved, at = compose(moved, moves.pop()), at[1:]
        is_odometry = isinstance(event, Odometry)
        changed.append(_moved(event, moved) if is_odometry else event)
    return changed


def _moved(reading: SensorEvent, by: Pose) -> SensorEvent:
    """Return an odometry reading in a frame that was moved."""
    assert isinstance(reading, Odometry)
    return replace(reading, tf_odom_tracking=compose(by, reading.tf_odom_tracking))


def thinned(every: int) -> Change:
    """Return a change that keeps every n-th scan."""

    def change(events: list[SensorEvent], rng: np.random.Generator) -> list[SensorEvent]:
        del rng
        return list(_every_nth_scan(events, every))

    return change


def _every_nth_scan(events: list[SensorEvent], every: int) -> Iterator[SensorEvent]:
    count = 0
    for event in events:
        if isinstance(event, LaserScan):
            count += 1
            if count % every:
                continue
        yield event


def short_sighted(reach: float) -> Change:
    """Return a change that makes all returns beyond a range no returns."""

    def change(events: list[SensorEvent], rng: np.random.Generator) -> list[SensorEvent]:
        del rng
        return [
            replace(e, ranges=np.where(e.ranges < reach, e.ranges, e.geometry.range_max + 1.0))
            if isinstance(e, LaserScan)
            else e
            for e in events
        ]

    return change


def noisy(sigma: float) -> Change:
    """Return a change that adds noise to all ranges."""

    def change(events: list[SensorEvent], rng: np.random.Generator) -> list[SensorEvent]:
        return [
            replace(
                e,
                ranges=np.where(
                    e.ranges < e.geometry.range_max,
                    np.maximum(e.ranges + rng.normal(0.0, sigma, e.ranges.shape), 0.11),
                    e.ranges,
                ),
            )
            if isinstance(e, LaserScan)
            else e
            for e in events
        ]

    return change


def both(first: Change, second: Change) -> Change:
    """Return one change after the other."""
    return lambda events, rng: second(first(events, rng), rng)


BAD_ODOMETRY = OdometryModel(
    translation_scale=1.06,
    rotation_scale=0.9,
    translation_noise=0.03,
    rotation_noise=0.04,
    drift_noise=0.02,
    slips_per_metre=0.1,
    slip_angle=0.1,
)
SKIDDING = OdometryModel(skids_per_metre=0.05, skid_length=1.0)

OPEN = ("global_slam.optimize_every_n_nodes=0",)
NARROW = (
    "global_slam.constraint_search.linear_search_window=0.3",
    "global_slam.constraint_search.min_linear_search_window=0.1",
    "global_slam.constraint_search.angular_search_window_deg=2",
    "global_slam.constraint_search.min_angular_search_window_deg=1",
    "global_slam.constraint_search.max_refinement=0.1",
)
CREDULOUS = (
    "global_slam.constraint_search.min_score=0.25",
    "global_slam.constraint_search.min_score_ratio=0",
    "global_slam.constraint_search.max_refined_residual=0.8",
    "global_slam.constraint_search.max_start_residual=0.9",
)

FAULTS: dict[str, Fault] = {
    "none": Fault(is_fault=False),
    "pause": Fault(change=pause, is_fault=False),
    "noise 2 cm": Fault(change=noisy(0.02), is_fault=False),
    "half the scans": Fault(change=thinned(2), is_fault=False),
    "open": Fault(OPEN),
    "open, bad odometry": Fault(OPEN, BAD_ODOMETRY),
    "open, sparse": Fault(OPEN, BAD_ODOMETRY, change=thinned(6)),
    "open, short-sighted": Fault(OPEN, BAD_ODOMETRY, change=short_sighted(3.5)),
    "narrow, sparse": Fault(NARROW, BAD_ODOMETRY, change=thinned(6)),
    "narrow, short-sighted": Fault(NARROW, BAD_ODOMETRY, change=short_sighted(3.5)),
    "credulous": Fault(CREDULOUS, BAD_ODOMETRY),
    "no odometry": Fault(without_odometry=True),
    "cut": Fault(change=cut),
    "cut, open": Fault(OPEN, change=cut),
    "turn missing": Fault(change=turn_missing),
    "frozen": Fault(change=frozen),
    "frozen, short-sighted": Fault(change=both(short_sighted(4.0), frozen)),
    "jumps": Fault(change=both(thinned(3), jumps)),
    "skids": Fault(odometry=SKIDDING, change=short_sighted(3.0)),
}
"""By name; the first maps rightly."""
