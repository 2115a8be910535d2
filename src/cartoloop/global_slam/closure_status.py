# SPDX-License-Identifier: Apache-2.0
"""What can become of a pair of submap and node, and why."""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from cartoloop.arrays import CodeArray


class Status(IntEnum):
    """What became of a pair. The numbers are part of the file format: append only."""

    NOT_REQUESTED = 0
    """Never requested while mapping; only the last pass matched it."""
    WAITING = 1
    """Requested, not searched yet."""
    DROPPED = 2
    """Not searched: too many searches were waiting (live mapping only)."""
    NOT_SEARCHED = 3
    """Not searched: enough closures between the two submaps had been found before its turn."""
    NOT_FOUND = 4
    """Searched; no candidate reached the threshold."""
    FOUND = 5
    """Found by the search, and a constraint of the graph."""
    REPLACED = 6
    """Found while mapping; the last pass matched other pairs instead."""
    FINAL = 7
    """A constraint of the finished graph, measured by the last pass."""
    POOR_FIT = 8
    """Matched by the last pass; the residual was too large."""
    MOVED_TOO_FAR = 9
    """Matched by the last pass; the match was too far from the adjusted pose."""
    CONTRADICTED = 10
    """Removed from the graph after the last adjustment: the other constraints contradict it."""
    HYPOTHESIS = 11
    """Matched by a wide search; not a closure, since too few others agree with it."""
    REMOVED = 12
    """Removed from the graph by an edit of the finished map."""
    ADDED = 13
    """A constraint of the finished graph, added by an edit."""

    @property
    def text(self) -> str:
        """The name in files: lower case with underscores."""
        return self.name.lower()


class Reason(IntEnum):
    """Why a pair has its status. The numbers are part of the file format: append only."""

    NONE = 0
    """No further reason."""
    BACKLOG_FULL = 1
    """DROPPED: more searches were waiting than the limit."""
    ENOUGH_CLOSURES = 2
    """NOT_SEARCHED: ``max_closures_of_pair`` closures had been found."""
    EMPTY_SUBMAP = 3
    """NOT_SEARCHED: the submap's grid has no cells."""
    BELOW_THRESHOLD = 4
    """NOT_FOUND: no candidate in the window reached the minimum score."""
    REACHED_THRESHOLD = 5
    """FOUND: the best candidate reached the minimum score."""
    FITS = 6
    """FINAL: residual and shift of the last match are within their limits."""
    EVERY_NTH_NODE = 7
    """REPLACED: the last pass matches one in ``final_every_nth_node`` nodes, not this one."""
    NO_OVERLAP = 8
    """REPLACED: at the adjusted poses, the node is outside the submap's grid."""
    NEARER_SUBMAPS = 9
    """REPLACED: ``final_max_submaps_of_node`` other submaps were nearer to the node."""
    START_RESIDUAL = 10
    """POOR_FIT: residual at the adjusted pose above ``max_start_residual``; not matched again."""
    RESIDUAL = 11
    """POOR_FIT: residual of the match above ``max_refined_residual``."""
    TRANSLATION = 12
    """MOVED_TOO_FAR: shifted by more than ``max_refinement``."""
    ROTATION = 13
    """MOVED_TOO_FAR: rotated by more than ``max_refinement`` allows."""
    DISAGREES = 14
    """CONTRADICTED: residual after adjustment above 0.2 m or 1 degree (table IV)."""
    UNSUPPORTED = 15
    """HYPOTHESIS: it fits as well elsewhere, or too few others along the path agree with it."""
    AMBIGUOUS = 16
    """NOT_FOUND: the best candidate reached the score, but so did another place."""
    EARLIER_PASS = 17
    """FOUND: by the last pass over an earlier state of the map, from which mapping went on."""
    EDIT = 18
    """REMOVED, ADDED: ``cartoloop edit`` or the like."""
    KEPT = 19
    """FINAL: as a search measured it; between these sessions the last pass matched fewer pairs."""
    REPAIR = 20
    """FINAL: visits contradicted each other, and with this match of several scans they agree."""

    @property
    def text(self) -> str:
        """The name in files; empty for NONE."""
        return self.name.lower() if self else ""


_STATUS_OF_REASON = {
    Reason.EVERY_NTH_NODE: Status.REPLACED,
    Reason.NO_OVERLAP: Status.REPLACED,
    Reason.NEARER_SUBMAPS: Status.REPLACED,
    Reason.FITS: Status.FINAL,
    Reason.START_RESIDUAL: Status.POOR_FIT,
    Reason.RESIDUAL: Status.POOR_FIT,
    Reason.TRANSLATION: Status.MOVED_TOO_FAR,
    Reason.ROTATION: Status.MOVED_TOO_FAR,
    Reason.EDIT: Status.ADDED,
    Reason.KEPT: Status.FINAL,
    Reason.REPAIR: Status.FINAL,
}

STATUS_OF_REASON: CodeArray = np.zeros(len(Reason), dtype=np.int8)
"""What each reason of a match without a search leads to, :class:`Status` by :class:`Reason`."""

for _reason, _status in _STATUS_OF_REASON.items():
    STATUS_OF_REASON[_reason] = _status

REASON_OF_SEARCH: CodeArray = np.zeros(len(Status), dtype=np.int8)
"""Why a search came to a status, :class:`Reason` by :class:`Status`; of NOT_SEARCHED, the usual."""

REASON_OF_SEARCH[Status.DROPPED] = Reason.BACKLOG_FULL
REASON_OF_SEARCH[Status.NOT_SEARCHED] = Reason.ENOUGH_CLOSURES
REASON_OF_SEARCH[Status.NOT_FOUND] = Reason.BELOW_THRESHOLD
REASON_OF_SEARCH[Status.HYPOTHESIS] = Reason.UNSUPPORTED
REASON_OF_SEARCH[Status.FOUND] = Reason.REACHED_THRESHOLD
