# SPDX-License-Identifier: Apache-2.0
"""The sentences that explain one row of the record of closures."""

from __future__ import annotations

import math
from collections.abc import Callable

from cartoloop.config import GlobalSlamConfig
from cartoloop.global_slam.closure_status import Reason, Status
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.following import MIN_SCORE, MIN_SCORE_RATIO
from cartoloop.global_slam.pair_verdict import PairVerdict
from cartoloop.global_slam.pose_graph import TRUE_ROTATION_RAD, TRUE_TRANSLATION_M
from cartoloop.global_slam.search_windows import path_length_of

TINY = 1e-6
"""Thresholds that differ by less are the same one."""

REQUESTS_NOT_RECORDED = (
    "Requests and searches are not known: the map file is of an earlier version and has no record "
    "of them; map the recording again."
)
"""Said of pairs of a map file that holds no requests."""


class Sentences:
    """Describes rows of a record, given the parameters of the run.

    The values of a row are those of :class:`Explanation`.

    Parameters
    ----------
    config, closures : of the run.
    own_score_between_sessions : of a row, the mean score of the submap's own scans in it, if the
        node is of another session; such pairs may be searched with other thresholds.
    """

    def __init__(
        self,
        config: GlobalSlamConfig,
        closures: Closures,
        own_score_between_sessions: Callable[[int], float | None],
    ) -> None:
        self._config = config
        self._closures = closures
        self._own_score_between_sessions = own_score_between_sessions

    def of_request(self, row: int, values: dict[str, float]) -> list[str]:
        """Return the sentences about the request of a row, which must be a request."""
        record = self._closures
        config = self._config.constraint_search
        x, y, theta = record.predicted[row].tolist()
        path = self._path_length(values)
        if values["window_m"] >= config.linear_search_window and path is not None:
            why = "the largest window"
        elif path is not None:
            why = f"the path between the two is {path:.1f} m long"
        else:
            why = (
                f"{config.wide_search.num_sigmas:g} standard deviations of the drift between the "
                f"two; searched with the scans of the {config.wide_search.length:g} m of path "
                "before the node together"
            )
        return [
            f"Requested when the graph had {values['requested_at']:.0f} nodes. Predicted pose in "
            f"the submap: x {x:.2f} m, y {y:.2f} m, {math.degrees(theta):.1f} deg.",
            f"Search window radius: {values['window_m']:.2f} m, {values['window_deg']:.1f} deg "
            f"({why}).",
        ]

    def _path_length(self, values: dict[str, float]) -> float | None:
        """Return the path length that a search window follows from; None for a wide search."""
        return path_length_of(
            self._config.constraint_search,
            values["window_m"],
            math.radians(values["window_deg"]),
        )

    def after_request(self, row: int, values: dict[str, float]) -> list[str]:
        """Return the sentences about search, last pass and final residual of a row."""
        return [
            *self._search_sentences(row, values),
            *self._last_pass_sentences(row, values),
            *_residual_sentences(Status(int(self._closures.status[row])), values),
        ]

    def _search_sentences(self, row: int, values: dict[str, float]) -> list[str]:
        config = self._config
        sentences = []
        if "min_score" in values:
            sentences.append(self._threshold_sentence(row, values))
        match Status(int(self._closures.search_status[row])):
            case Status.WAITING:
                sentences.append("The search had not ended when the run was stopped.")
            case Status.DROPPED:
                sentences.append(
                    f"Dropped: {config.max_live_backlog} other searches were waiting "
                    "(max_live_backlog)."
                )
            case Status.NOT_SEARCHED:
                sentences.append(
                    f"Not searched: {config.constraint_search.max_closures_of_pair} closures with "
                    "other nodes of the same submap had been found (max_closures_of_pair), or the "
                    "submap is empty."
                )
            case Status.NOT_FOUND if self._closures.reason[row] == Reason.AMBIGUOUS:
                sentences.append(
                    "Searched: a candidate reached the minimum score, but elsewhere in the window "
                    f"another one is less than {config.constraint_search.min_runner_up_margin:g} "
                    "worse (min_runner_up_margin)."
                )
            case Status.NOT_FOUND:
                sentences.append("Searched: no candidate in the window reached the minimum score.")
            case Status.HYPOTHESIS:
                sentences.append(
                    "Searched: a candidate reached the minimum score, but it fits as well in "
                    "another place, or too few others along the path agree with it."
                )
            case Status.FOUND:
                sentences.append(_found_sentence(values))
        return sentences

    def _threshold_sentence(self, row: int, values: dict[str, float]) -> str:
        search, min_score = self._config.constraint_search, values["min_score"]
        is_wide = self._path_length(values) is None
        config = search.wide_search if is_wide else search
        limits = [("", config.min_score, config.min_score_ratio)]
        own = self._own_score_between_sessions(row)
        if own is not None:
            join = search.join
            limits += [
                (" of parts that were not joined yet", join.min_score, join.min_score_ratio),
                (" near a place where parts may fit", MIN_SCORE, MIN_SCORE_RATIO),
            ]
            limits = [
                each for each in limits if abs(min(each[1], each[2] * own) - min_score) < TINY
            ]
        if not limits:  # the submap has changed since
            return f"Minimum score: {min_score:.3f}."
        ((where, most, ratio), *_) = limits
        if min_score >= most:
            return f"Minimum score{where}: {min_score:.3f} (min_score)."
        return (
            f"Minimum score{where}: {min_score:.3f}, {ratio:g} of the mean score of the submap's "
            f"own scans, {min_score / ratio:.3f} (min_score_ratio): less than min_score, {most:g}."
        )

    def _last_pass_sentences(self, row: int, values: dict[str, float]) -> list[str]:
        reason = Reason(int(self._closures.reason[row]))
        if self._closures.has_final_match[row] and reason in (Reason.FITS, Reason.DISAGREES):
            sentence = "matched from the adjusted pose, {fit}: accepted."
        elif reason in _LAST_PASS:
            sentence = _LAST_PASS[reason]
        else:
            return []
        config = self._config.constraint_search
        fit = f"residual {values.get('residual', math.nan):.3f}"
        if "moved_m" in values:
            fit += f", moved by {values['moved_m']:.3f} m, {values['moved_deg']:.2f} deg"
        degrees = math.degrees(config.max_refinement / config.lever)
        return ["Last pass: " + sentence.format(fit=fit, config=config, degrees=degrees)]


def why_not_requested(verdict: PairVerdict) -> str:
    """Return why a pair was never requested."""
    path = f"shortest path over closures counts as {verdict.path_length:.1f} m"
    apart = f"{verdict.distance:.1f} m apart, {path}"
    if verdict.why_not is None:
        return (
            f"Never requested while mapping, though it would be at the final poses ({apart}): "
            "then the poses, or the number of nodes and submaps, were others."
        )
    return f"Never requested while mapping: {verdict.why_not.value} ({apart})."


def _residual_sentences(status: Status, values: dict[str, float]) -> list[str]:
    if "residual_m" not in values:
        return []
    sentences = [
        f"The map disagrees with the measured pose by {values['residual_m']:.3f} m and "
        f"{values['residual_deg']:.2f} deg; its weight there is {values['weight']:.2f}."
    ]
    if status == Status.CONTRADICTED:
        sentences.append(
            f"Removed from the graph: after the adjustment with it the residual was above "
            f"{TRUE_TRANSLATION_M:g} m or {math.degrees(TRUE_ROTATION_RAD):g} deg: the other "
            "constraints contradict it."
        )
    elif status == Status.REMOVED:
        sentences.append("Removed from the graph by an edit of the map ('cartoloop edit').")
    elif status in (Status.FINAL, Status.FOUND):
        sentences.append("It is a constraint of the graph.")
    elif status == Status.ADDED:
        sentences.append("It is a constraint of the graph, added by an edit of the map.")
    return sentences


def _found_sentence(values: dict[str, float]) -> str:
    runner_up = values.get("runner_up", 0.0)
    other = (
        f"the best elsewhere in the window {runner_up:.3f}"
        if runner_up > 0.0
        else "no candidate elsewhere in the window comes near"
    )
    sentence = f"Found: score {values.get('score', math.nan):.3f}, {other}."
    if "found_at" in values:
        sentence += f" It joined the graph when that had {values['found_at']:.0f} nodes."
    return sentence


_LAST_PASS = {
    Reason.RESIDUAL: (
        "{fit}. Residual above the limit of {config.max_refined_residual:g} (max_refined_residual, "
        "more where the submap's own scans fit poorly)."
    ),
    Reason.TRANSLATION: "{fit}. Shift above {config.max_refinement:g} m (max_refinement).",
    Reason.ROTATION: "{fit}. Rotation above {degrees:.1f} deg (max_refinement).",
    Reason.START_RESIDUAL: (
        "at the adjusted pose the residual was above {config.max_start_residual:g} "
        "(max_start_residual); not matched again."
    ),
    Reason.EVERY_NTH_NODE: (
        "not matched again, one in {config.final_every_nth_node} nodes is (final_every_nth_node)."
    ),
    Reason.NO_OVERLAP: "at the adjusted poses the node is outside the submap's grid.",
    Reason.KEPT: (
        "fewer pairs were matched between the two submaps than searches had found. They are of two "
        "sessions, and the adjusted poses agree with this closure: it stays."
    ),
    Reason.REPAIR: (
        "{fit}. Visits contradicted each other there. Several scans as one were matched, and with "
        "this closure the visits agree."
    ),
    Reason.NEARER_SUBMAPS: (
        "{config.final_max_submaps_of_node} other submaps were nearer to the node "
        "(final_max_submaps_of_node)."
    ),
}
"""What the last pass came to, by the reason of a pair's status."""
