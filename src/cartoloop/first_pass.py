# SPDX-License-Identifier: Apache-2.0
"""A quick pass of local SLAM over the beginning of a recording: what its sensors are like.

While a map grows, a clock offset becomes known only after some turns, and those come
out wrong by degrees. A recording, unlike a live robot, can be asked for it first.
"""

from __future__ import annotations

import json
import logging
from typing import TYPE_CHECKING

from cartoloop.config import Config
from cartoloop.event_intake import EventIntake
from cartoloop.journal.frames import Kind
from cartoloop.journal.outcomes import RecordedOutcomes
from cartoloop.local_slam.clock_offset import FIRST_ESTIMATE
from cartoloop.local_slam.local_slam import LocalSlam
from cartoloop.local_slam.odometry_veer import MIN_STRETCHES
from cartoloop.local_slam.prediction_record import DOUBTFUL
from cartoloop.local_slam.sensor_calibration import SensorCalibration
from cartoloop.runtime.stage_timer import StageTimer
from cartoloop.sensor.events import Odometry
from cartoloop.stop_request import StopRequest

_logger = logging.getLogger(__name__)

if TYPE_CHECKING:
    from cartoloop.local_slam.odometry_parameters import OdometryParameters
    from cartoloop.readers import Log

MAX_SHARE, LEAST_SCANS = 0.1, 300
"""Largest share of the scans that are tried: local SLAM takes half of a run, so that the pass takes
a twentieth of it where the odometry never becomes known. Of short recordings, a number of scans
instead, which takes a fraction of a second."""

MOST_SCANS = 1500
"""Number of scans that are tried while the robot has not turned enough, or scans have not measured
the scale of the odometry's distances: where scans are sparse, the first turns come late and are
matched worst; in a bare corridor matches show little more of the scale than what was assumed."""

ENOUGH_TURNS = 150
"""Number of turning steps after which an offset that matters would have been found."""

ENOUGH_STRETCHES = 100
"""Number of metres after which a veer is known that was found: it shows at several headings."""


def calibrate(log: Log, config: Config, stop: StopRequest) -> SensorCalibration | None:
    """Return what the beginning of a recording shows about its sensors, or None.

    The pass ends once clock offsets were found, or the robot has turned so much that there are none
    that matter, and it has driven far enough to know its veer; at the latest after `MAX_SHARE` of
    the scans, or `LEAST_SCANS`, or `MOST_SCANS` while it has not turned or no scans have measured
    the scale. A failure ends it as well: the pass that maps will meet and report it.

    Parameters
    ----------
    log : the recording; this is a pass of its own.
    config : of the mapping; loops are not closed here.
    stop : ends the pass early.
    """
    slam = LocalSlam(config.local_slam, config.sensor, None, StageTimer())
    intake = EventIntake(config.sensor, slam, accepts_late_odometry=False)
    limit = max(MAX_SHARE * log.num_scans, LEAST_SCANS)
    last = max(limit, MOST_SCANS)
    has_odometry = False
    events = iter(log)
    try:
        for event in events:
            has_odometry = has_odometry or isinstance(event, Odometry)
            if intake.take(event):
                for scan in intake.ready_scans(event.time):
                    slam.add_scan(scan)
            known = slam.calibration
            is_measured = known.odometry.knows_rotation and known.odometry.knows_scale
            if stop.made or intake.num_scans > (limit if is_measured else last):
                break
            if intake.num_scans <= FIRST_ESTIMATE:
                continue
            uses_odometry = has_odometry and config.local_slam.use_odometry
            is_alone = len(known.scanner_offsets) < 2
            if (is_alone or any(known.scanner_offsets.values())) and (
                not uses_odometry or _is_settled(known.odometry)
            ):
                break
    except KeyboardInterrupt:
        stop.made = True
    except Exception as error:  # noqa: BLE001 - see above
        _logger.debug("the pass over the beginning ended: %s", error)
    finally:
        events.close()
    found = slam.calibration
    odometry, is_doubtful = found.odometry, found.odometry_score >= DOUBTFUL
    is_known = odometry.knows_rotation or odometry.knows_scale or found.odometry_held_s > 0.0
    is_doubtful |= found.odometry_is_mirrored
    if is_known or is_doubtful or any(found.scanner_offsets.values()):
        return found
    return None


def recorded_calibration(
    log: Log, config: Config, stop: StopRequest, outcomes: RecordedOutcomes
) -> SensorCalibration | None:
    """Return :func:`calibrate`: replayed if it was recorded before, otherwise recorded."""
    recorded = outcomes.replay(Kind.CALIBRATION)
    if recorded is not None:
        found = json.loads(bytes(recorded))
        return None if found is None else SensorCalibration.from_dict(found)
    calibration = calibrate(log, config, stop)
    # A pass that was stopped says less than a whole one.
    if outcomes.is_recording and not stop.made:
        content = None if calibration is None else calibration.to_dict()
        outcomes.record(Kind.CALIBRATION, json.dumps(content).encode())
    return calibration


def _is_settled(model: OdometryParameters) -> bool:
    enough = ENOUGH_STRETCHES if any(model.veer) else MIN_STRETCHES
    return (
        model.knows_rotation
        and (bool(model.time_offset) or model.num_turns >= ENOUGH_TURNS)
        and model.num_stretches >= enough
    )
