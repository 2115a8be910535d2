# SPDX-License-Identifier: Apache-2.0
"""The events of a recording, one by one into a mapper, until the end or a stop."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from cartoloop.runs.end import Outcome
from cartoloop.runs.observer import RunObserver
from cartoloop.stop_request import StopRequest

if TYPE_CHECKING:
    from cartoloop.mapper import Mapper
    from cartoloop.readers import Log


def map_events(log: Log, mapper: Mapper, observer: RunObserver, stop: StopRequest) -> Outcome:
    """Add all events of a log to a mapper and finish the map; close the mapper.

    A failure after the first scan ends the run but is not raised, so that the map can be kept.
    """
    failure: Exception | None = None
    is_stopped = False
    try:
        for event in log:
            if stop.made:
                break
            observer.before_event(mapper, event)
            mapper.add(event)
            observer.after_event(mapper, event)
        is_stopped = stop.made
    except KeyboardInterrupt:
        is_stopped = True
    except Exception as error:
        if mapper.num_scans == 0:
            mapper.close()
            raise
        failure = error
    if is_stopped or failure is not None:
        mapper.close()
        return Outcome(mapper.result(), failure, is_complete=False)
    return finish(mapper, observer, stop)


def finish(mapper: Mapper, observer: RunObserver, stop: StopRequest) -> Outcome:
    """Do the last pass and close the mapper; if it is stopped or fails, keep the map before it."""
    failure: Exception | None = None
    try:
        observer.finishing(mapper, None)
        with stop.at_once():
            return Outcome(mapper.finish(partial(observer.finishing, mapper)), None, True)
    except KeyboardInterrupt:
        pass
    except Exception as error:
        if mapper.num_scans == 0:
            raise
        failure = error
    finally:
        mapper.close()
    return Outcome(mapper.result(), failure, is_complete=False)
