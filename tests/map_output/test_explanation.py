# SPDX-License-Identifier: Apache-2.0
"""Explanations of closures, on records made by hand."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from cartoloop.errors import InputError
from cartoloop.global_slam.closure_status import Reason, Status
from cartoloop.map_output.explanation import Explainer
from cartoloop.session import Session
from tests.evaluation.hand_made_run import closure, hand_made_result
from tests.global_slam.closures import final_matches, record, requests

ALL_POINTS = [np.zeros((30, 2))] * 6


def explainer(closures=None, **parts):
    result = replace(hand_made_result(**parts), node_points=ALL_POINTS)
    return Explainer(result if closures is None else replace(result, closures=closures))


def after_last_pass(reason, found=True):
    one = closure(0, 5, 0.1)
    closures = record(found=[one] if found else [])
    closures.note_last_pass(
        np.array([Reason.NO_OVERLAP] * found, dtype=np.int8), [final_matches([one], [reason])]
    )
    return closures


def test_a_final_closure_is_explained():
    explanation = explainer(final=[closure(0, 5, 0.1)], found=[closure(0, 5, 0.3)]).row(0)

    assert (explanation.submap, explanation.node, explanation.closure) == (0, 5, 0)
    assert (explanation.status, explanation.reason) == ("final", "fits")
    assert explanation.values["residual_m"] == pytest.approx(0.1)
    assert explanation.values["score"] == pytest.approx(0.7)
    text = explanation.text
    for part in (
        "Closure 0: submap 0, node 5: final",
        "Requested when the graph had 20 nodes",
        "Search window radius: 1.00 m, 10.0 deg",
        "Minimum score: 0.500, 0.85 of the mean score of the submap's own scans, 0.588",
        "Found: score 0.700, no candidate elsewhere",
        "Last pass: matched from the adjusted pose, residual 0.250, moved by 0.125 m",
        "disagrees with the measured pose by 0.100 m",
        "is a constraint of the graph",
    ):
        assert part in text


@pytest.mark.parametrize(
    ("reason", "status", "words"),
    [
        (Reason.RESIDUAL, "poor_fit", "Residual above the limit of 0.55"),
        (Reason.TRANSLATION, "moved_too_far", "Shift above 0.3 m"),
        (Reason.ROTATION, "moved_too_far", "Rotation above 3.4 deg"),
    ],
)
def test_failed_matches_name_the_limit(reason, status, words):
    explanation = explainer(after_last_pass(reason)).row(0)

    assert explanation.status == status
    assert words in explanation.text


@pytest.mark.parametrize(
    ("reason", "status", "words"),
    [
        (Reason.START_RESIDUAL, "poor_fit", "above 0.75 (max_start_residual)"),
        (Reason.EVERY_NTH_NODE, "replaced", "one in 2 nodes"),
        (Reason.NO_OVERLAP, "replaced", "outside the submap's grid"),
        (Reason.NEARER_SUBMAPS, "replaced", "32 other submaps were nearer"),
    ],
)
def test_closures_not_matched_again_name_the_rule(reason, status, words):
    closures = record(found=[closure(0, 5)])
    closures.note_last_pass(np.array([reason], dtype=np.int8), [])

    explanation = explainer(closures).row(0)

    assert explanation.status == status
    assert words in explanation.text


def test_closures_that_make_visits_agree_say_so():
    explanation = explainer(after_last_pass(Reason.REPAIR)).row(0)

    assert explanation.status == "final"
    assert "Visits contradicted each other there" in explanation.text


def test_contradicted_closures_name_the_limits():
    explanation = explainer(rejected=[closure(0, 5, 0.5)]).row(0)

    assert explanation.status == "contradicted"
    assert "0.2 m or 1 deg" in explanation.text


def test_searches_without_a_closure_are_explained():
    closures = record()
    rows = closures.request(requests((0, 4), (0, 5), (1, 0), (2, 0)), 6)
    closures.note_searched(rows[:1], 0.55)
    closures.note_dropped(rows[1:2])
    closures.note_not_searched(rows[2:3], Reason.ENOUGH_CLOSURES)
    explain = explainer(closures)

    assert "no candidate in the window reached" in explain.row(0).text
    assert "Minimum score: 0.550 (min_score)." in explain.row(0).text
    assert "10000 other searches were waiting" in explain.row(1).text
    assert "12 closures with other nodes" in explain.row(2).text
    assert "had not ended" in explain.row(3).text
    assert [explain.row(row).status for row in range(4)] == [
        Status.NOT_FOUND.text, Status.DROPPED.text, Status.NOT_SEARCHED.text, Status.WAITING.text,
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("own", "min_score", "words"),
    [
        (0.8, 0.55, "Minimum score: 0.550 (min_score)."),
        (0.6, 0.51, "Minimum score: 0.510, 0.85 of the mean score of the submap's own scans, 0.6"),
        (0.8, 0.38, "Minimum score of parts that were not joined yet: 0.380 (min_score)."),
        (0.5, 0.34, "of parts that were not joined yet: 0.340, 0.68 of the mean score"),
        (0.5, 0.225, "near a place where parts may fit: 0.225, 0.45 of the mean score"),
        (0.5, 0.3, "Minimum score: 0.300."),
        (None, 0.51, "Minimum score: 0.510, 0.85 of the mean score of the submap's own scans, 0.6"),
    ],
)
def test_thresholds_between_sessions_are_explained(own, min_score, words, monkeypatch):
    closures = record()
    closures.note_searched(closures.request(requests((0, 5)), 6), min_score)
    sessions = (Session(), Session(first_scan=3, first_node=3, first_submap=1))
    monkeypatch.setattr("cartoloop.map_output.explanation.mean_score", lambda *_: own)
    known = replace(hand_made_result(), node_points=ALL_POINTS, closures=closures)
    known = replace(known, sessions=sessions[: 1 if own is None else 2])

    assert words in Explainer(known).row(0).text


def test_pairs_never_requested_have_a_reason():
    explain = explainer()

    own, odd = explain.pair(0, 0), explain.pair(0, 3)

    assert own.closure is None
    assert own.reason == "the node was inserted into this submap"
    assert odd.status == "not_requested"
    assert "only every n-th node is searched" in odd.reason
    assert "Never requested while mapping" in odd.text


def test_pairs_matched_in_the_last_pass_only_say_so():
    text = explainer(after_last_pass(Reason.FITS, found=False)).row(0).text

    assert "Never requested while mapping" in text
    assert "Last pass: matched from the adjusted pose" in text


def test_pairs_of_nodes_near_a_position_are_found():
    explain = explainer(found=[closure(0, 5), closure(1, 4), closure(0, 4)])

    near = explain.near(0.2, 0.1)
    far = explain.near(8.0, 4.1)

    assert [(one.submap, one.node) for one in near] == [(0, 5)]
    assert far[0].node == 3
    assert far[0].closure is None
    assert len(explain.near(4.0, 4.0, limit=1)) == 1


@pytest.mark.parametrize("position", [(np.nan, 0.0), (0.0, np.inf)])
def test_a_position_that_is_not_finite_is_refused(position):
    with pytest.raises(InputError, match="give two finite numbers"):
        explainer(found=[closure(0, 5)]).near(*position)


def version_2_explainer(**parts):
    """The explainer of a map read from a file that holds closures, but no requests."""
    result = replace(hand_made_result(**parts), node_points=ALL_POINTS)
    constraints = replace(result.report.constraints, searched=7)
    return Explainer(replace(result, report=replace(result.report, constraints=constraints)))


@pytest.mark.parametrize("stage", ["found", "final"])
def test_requests_missing_in_a_file_are_not_invented(stage):
    explain = version_2_explainer(**{stage: [closure(0, 5)]})

    row, other, own = explain.row(0), explain.pair(1, 5), explain.pair(0, 0)

    assert "Requests and searches are not known" in row.text
    for invented in ("equested", "window radius", "It joined the graph"):
        assert invented not in row.text.replace("Requests", "") + other.text.replace("Requests", "")
    assert not {"window_m", "requested_at", "found_at"} & set(row.values)
    assert (other.status, other.reason) == ("unknown", "requests are not recorded")
    assert own.reason == "the node was inserted into this submap"


def test_an_unknown_correction_is_not_printed():
    one = closure(0, 5)
    matches = final_matches([one])
    matches.moved_m[:] = matches.moved_rad[:] = np.nan
    closures = record()
    closures.note_last_pass(np.zeros(0, dtype=np.int8), [matches])

    text = explainer(closures).row(0).text

    assert "Last pass: matched from the adjusted pose, residual 0.250: accepted." in text


def test_explanations_are_plain_data():
    explanation = explainer(found=[closure(0, 5)]).row(0)

    assert json.loads(json.dumps(explanation.to_dict()))["values"]["score"] == 0.7


def test_unknown_rows_and_pairs_are_refused():
    explain = explainer(found=[closure(0, 5)])
    with pytest.raises(InputError, match="has 1 rows"):
        explain.row(1)
    with pytest.raises(InputError, match="submaps 0 to 2 and nodes 0 to 5"):
        explain.pair(3, 0)
