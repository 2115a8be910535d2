# SPDX-License-Identifier: Apache-2.0
"""Tables of requests and matches, which make up the record of closures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import CodeArray, FloatArray, IntArray, RowArray
from cartoloop.growing_array import GrowingArray

UPPER = np.triu_indices(3)
"""Entries of an information matrix that are stored: the upper triangle, row by row."""


class Requests(NamedTuple):
    """Pairs to be searched.

    Attributes
    ----------
    submap, node : int32, shape (n,), indices in the pose graph.
    node_submap : int32, shape (n,), the older submap that the node was inserted into.
    tf_submap_node : float64, shape (n, 3), predicted, the centre of the window [m, m, rad].
    linear_window, angular_window : float64, shape (n,), search window radii [m], [rad].
    """

    submap: RowArray
    node: RowArray
    node_submap: RowArray
    tf_submap_node: FloatArray
    linear_window: FloatArray
    angular_window: FloatArray

    def take(self, which: IntArray | slice) -> Requests:
        """Return some of them, by index or slice."""
        return Requests._make(column[which] for column in self)


class SearchMatches(NamedTuple):
    """Closures that a search found.

    Attributes
    ----------
    row : int32, shape (n,), rows of the record.
    tf_submap_node : float64, shape (n, 3), as measured [m, m, rad].
    information : float64, shape (n, 3, 3), inverse covariance, submap axes.
    residual : float64, shape (n,), root mean square of 1 - M_smooth at the returns.
    score : float64, shape (n,), mean probability at the best candidate, in [0, 1].
    runner_up : float64, shape (n,), best score elsewhere in the window; 0 where none was good
        enough.
    moved_m, moved_rad : float64, shape (n,), from the best candidate to the refined pose.
    """

    row: RowArray
    tf_submap_node: FloatArray
    information: FloatArray
    residual: FloatArray
    score: FloatArray
    runner_up: FloatArray
    moved_m: FloatArray
    moved_rad: FloatArray


class FinalMatches(NamedTuple):
    """Matches of the last pass, accepted or not.

    Attributes
    ----------
    submap, node : int, shape (n,).
    tf_submap_node : float64, shape (n, 3), as measured [m, m, rad].
    information : float64, shape (n, 3, 3), inverse covariance, submap axes.
    residual : float64, shape (n,), as of :class:`SearchMatches`.
    moved_m, moved_rad : float64, shape (n,), from the adjusted pose to the match.
    reason : int8, shape (n,), FITS or why not.
    """

    submap: IntArray
    node: IntArray
    tf_submap_node: FloatArray
    information: FloatArray
    residual: FloatArray
    moved_m: FloatArray
    moved_rad: FloatArray
    reason: CodeArray


class MatchTable(NamedTuple):
    """All measurements: of the searches in joining order, then those of the last pass.

    Attributes
    ----------
    row : int, shape (n,), in the record.
    tf_submap_node : float64, shape (n, 3), as measured [m, m, rad].
    information : float64, shape (n, 6), upper triangle of the inverse covariance, submap axes.
    residual : float64, shape (n,), of the fit.
    moved : float32, shape (n, 2), by the refinement [m, rad].
    score, runner_up, joined_at : shape (num_found,), of the searches.
    """

    row: IntArray
    tf_submap_node: FloatArray
    information: FloatArray
    residual: FloatArray
    moved: NDArray[np.float32]
    score: FloatArray
    runner_up: FloatArray
    joined_at: RowArray


@dataclass(frozen=True, slots=True)
class Matched:
    """Rows that have a measured pose, as arrays.

    Attributes
    ----------
    row : int, shape (n,), in the record.
    submap, node : int32, shape (n,).
    tf_submap_node : float64, shape (n, 3), as measured [m, m, rad].
    information : float64, shape (n, 3, 3), inverse covariance, submap axes.
    residual : float64, shape (n,), fit residual of this measurement.
    score, runner_up : float64, shape (n,), of the search; NaN where the pair was not found by one.
    """

    row: IntArray
    submap: RowArray
    node: RowArray
    tf_submap_node: FloatArray
    information: FloatArray
    residual: FloatArray
    score: FloatArray
    runner_up: FloatArray

    def __len__(self) -> int:
        return len(self.row)

    def take(self, which: IntArray) -> Matched:
        """Return some of them, by index."""
        return Matched(
            self.row[which],
            self.submap[which],
            self.node[which],
            self.tf_submap_node[which],
            self.information[which],
            self.residual[which],
            self.score[which],
            self.runner_up[which],
        )


class MatchColumns:
    """The columns of all matches: those of the searches first, then those of the last pass.

    Attributes
    ----------
    poses, informations, residuals, moves : of each match, as in :class:`MatchTable`.
    scores, runner_ups, joined_at : of the matches of searches.
    """

    def __init__(self) -> None:
        self.poses = GrowingArray((3,), np.float64)
        self.informations = GrowingArray((6,), np.float64)
        self.residuals = GrowingArray((), np.float64)
        self.moves = GrowingArray((2,), np.float32)
        self.scores = GrowingArray((), np.float64)
        self.runner_ups = GrowingArray((), np.float64)
        self.joined_at = GrowingArray((), np.int32)

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def num_found(self) -> int:
        """Number of matches of searches."""
        return len(self.scores)

    def add(self, matches: SearchMatches | FinalMatches) -> IntArray:
        """Add matches and return their numbers; :meth:`add_scores` completes those of searches."""
        first = len(self)
        self.poses.extend(matches.tf_submap_node)
        self.informations.extend(matches.information[:, *UPPER])
        self.residuals.extend(matches.residual)
        self.moves.extend(np.column_stack((matches.moved_m, matches.moved_rad)))
        return np.arange(first, len(self))

    def add_scores(self, matches: SearchMatches, num_nodes: int) -> None:
        """Add the scores of matches that join a graph of `num_nodes`."""
        self.scores.extend(matches.score)
        self.runner_ups.extend(matches.runner_up)
        self.joined_at.grow(len(matches.row))[:] = num_nodes

    def replace(self, number: int, match: FinalMatches) -> None:
        """Replace a match that has no score by another, the only one of `match`."""
        self.poses.view[number] = match.tf_submap_node[0]
        self.informations.view[number] = match.information[0][UPPER]
        self.residuals.view[number] = match.residual[0]
        self.moves.view[number] = match.moved_m[0], match.moved_rad[0]

    def restore(self, table: MatchTable) -> None:
        """Add the matches of a table."""
        for column, values in zip(vars(self).values(), table[1:], strict=True):
            column.extend(values)

    def forget_last_pass(self) -> None:
        """Keep the matches of searches only."""
        for column in (self.poses, self.informations, self.residuals, self.moves):
            column.shorten(self.num_found)

    def table(self, rows: IntArray) -> MatchTable:
        """Return all matches, given the row of the record that each belongs to."""
        return MatchTable(rows, *(column.view for column in vars(self).values()))
