# SPDX-License-Identifier: Apache-2.0
"""The outcomes of the expensive steps of a thread, in their order: recorded, or replayed.

Mapping a recording is deterministic. So a run that was interrupted is resumed by mapping the
recording again with the outcomes that its journal holds, until these end: each step asks
:meth:`RecordedOutcomes.replay` first, and computes and records only what is not there.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import NamedTuple

from cartoloop.errors import InputError
from cartoloop.journal.frames import Record


class RecordedOutcomes:
    """A sequence of recorded outcomes, replayed up to its end and continued there.

    Parameters
    ----------
    append : receives the kind and the payload of each new record; None: nothing is kept.
    recorded : records of the run that is resumed.
    is_replayable : whether the run can be repeated, so that outcomes are worth keeping that its map
        does not consist of.
    """

    def __init__(
        self,
        append: Callable[[int, bytes], None] | None = None,
        recorded: Sequence[Record] = (),
        *,
        is_replayable: bool = False,
    ) -> None:
        self._append = append
        self.is_replayable = is_replayable
        self._recorded = recorded
        self._next = 0

    @property
    def is_recording(self) -> bool:
        """Whether records go anywhere; otherwise none have to be made."""
        return self._append is not None

    @property
    def is_replaying(self) -> bool:
        """Whether there are outcomes to replay."""
        return self._next < len(self._recorded)

    def replay(self, kind: int) -> memoryview | None:
        """Return the outcome of the next step; None if it has to be computed and recorded.

        Raises
        ------
        InputError
            The next outcome is of another step: the journal is not of this run.
        """
        if self._next == len(self._recorded):
            return None
        found = self._recorded[self._next]
        if found.kind != kind:
            raise unfit(f"record {self._next} is of kind {found.kind} instead of {int(kind)}")
        self._next += 1
        if self._next == len(self._recorded):
            self._recorded, self._next = (), 0
        return found.payload

    def record(self, kind: int, payload: bytes) -> None:
        """Record the outcome of a step that was computed."""
        if self._append is not None:
            self._append(kind, payload)


class RunOutcomes(NamedTuple):
    """The records of a run by the thread that they come from.

    Attributes
    ----------
    local : of local SLAM.
    graph : of global SLAM.
    finished_submaps : indices of the submaps whose finished grids are in `graph`.
    """

    local: RecordedOutcomes
    graph: RecordedOutcomes
    finished_submaps: Collection[int] = frozenset()

    @property
    def is_replaying(self) -> bool:
        """Whether an interrupted run has not been gone over completely."""
        return self.local.is_replaying or self.graph.is_replaying


NO_OUTCOMES = RecordedOutcomes()
"""Records nothing and replays nothing."""

NO_RUN_OUTCOMES = RunOutcomes(NO_OUTCOMES, NO_OUTCOMES)


def unfit(what: str) -> InputError:
    """Return the error of a journal that is not of the run that is resumed."""
    return InputError(
        f"the journal does not fit the recording ({what}); map it from the beginning, without "
        "--resume"
    )
