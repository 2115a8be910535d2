# SPDX-License-Identifier: Apache-2.0
"""Each edit does what it says, and undoing it gives back what was before."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.errors import InputError, UsageError
from cartoloop.map_editing.apply import apply_edits
from cartoloop.map_editing.editor import Editor
from cartoloop.map_file.write import map_bytes
from cartoloop.sensor.pose import Pose, compose_all, transform_points
from cartoloop.submaps.finished_grid import FinishedGrid
from tests.map_editing.edited_map import editor, finished_map, poses_of
from tests.map_output.small_result import small_result

EDITS = {
    "drop": lambda one: one.drop_closures(_in_graph(one)),
    "pin": lambda one: one.pin_node(_some(one.map.graph.num_nodes)),
    "pin at": lambda one: one.pin_submap(_some(one.map.graph.num_submaps), (1.0, -2.0, 0.3)),
    "points": lambda one: one.set_control_points([(0, 0, 5, 1), (8, 0, 5, 9.2), (8, 4, 1, 9)]),
    "align": lambda one: one.align(),
    "time": lambda one: one.forget_time(one.map.stamps[-1], one.map.stamps[-1]),
    "area": lambda one: one.forget_area(0.0, 0.0, 1.0, 1.0),
    "split": lambda one: one.split_session(0, one.map.stamps[1]),
    "rename": lambda one: one.rename_session(0, "morning"),
}


def _in_graph(one):
    rows = one.map.graph.closure_rows
    return int(rows[rows >= 0][0])


def _some(count):
    return count // 2


def assert_as_mapped(one):
    original = finished_map()
    assert np.array_equal(poses_of(one.map), poses_of(original))
    assert one.map.original is None
    assert np.array_equal(one.map.stamps, original.stamps)
    assert one.map.sessions == original.sessions
    for ours, theirs in zip(one.map.submap_grids, original.submap_grids, strict=True):
        assert np.array_equal(ours.cells, theirs.cells)


@pytest.mark.parametrize("name", EDITS)
def test_undoing_an_edit_gives_back_the_map(name):
    one = editor()
    EDITS[name](one)
    edited = poses_of(one.map)
    assert len(one.edits) == 1
    assert one.map.original is one.original

    one.undo()
    assert_as_mapped(one)

    one.redo(0)
    assert np.array_equal(poses_of(one.map), edited)


def _undo_any(one, choice):
    in_force = [i for i, edit in enumerate(one.edits) if not edit.is_undone]
    undone = [i for i, edit in enumerate(one.edits) if edit.is_undone]
    if choice % 2 and undone:
        one.redo(undone[choice % len(undone)])
    elif in_force:
        one.undo(in_force[choice % len(in_force)])


@settings(max_examples=25, deadline=None)
@given(
    st.lists(st.sampled_from([*EDITS, *range(6)]), min_size=1, max_size=8),
    st.randoms(use_true_random=False),
)
def test_undoing_all_in_any_order_gives_back_the_map(steps, rng):
    one = editor()
    for step in steps:
        try:
            if isinstance(step, int):
                _undo_any(one, step)
            else:
                EDITS[step](one)
        except (InputError, IndexError):
            continue  # nothing left to drop or to forget
    in_force = [number for number, edit in enumerate(one.edits) if not edit.is_undone]
    rng.shuffle(in_force)
    for number in in_force:
        one.undo(number)

    assert_as_mapped(one)


@settings(max_examples=15, deadline=None)
@given(st.lists(st.sampled_from(list(EDITS)), min_size=1, max_size=5))
def test_an_edited_map_is_loaded_as_it_was_edited(steps):
    one = editor()
    for step in steps:
        try:
            EDITS[step](one)
        except (InputError, IndexError):
            continue

    again = Editor(one.original)

    assert np.array_equal(poses_of(again.map), poses_of(one.map))
    assert map_bytes(again.map) == map_bytes(one.map)


def test_a_dropped_closure_has_no_effect_any_more():
    one = editor()
    change = one.drop_closures(2)
    row = one.closures(statuses=["removed"])[0]

    assert (row.number, row.reason, row.is_in_graph) == (2, "edit", False)
    assert change.closures == -1
    assert change.moved_m > 0.01
    assert one.map.graph.num_loop_closures == 3


def test_a_dropped_closure_is_not_dropped_again():
    one = editor()
    one.drop_closures(2)

    with pytest.raises(InputError, match=r"closure 2: is not in the graph \(removed: edit\)"):
        one.drop_closures(2)
    with pytest.raises(InputError, match=r"closure 4: is not in the graph \(contradicted"):
        one.drop_closures(4)
    with pytest.raises(InputError, match="closure 17: the record has 5 rows"):
        one.drop_closures(17)
    assert len(one.edits) == 1


@pytest.mark.parametrize("row", [-1, 10_000])
def test_a_closure_outside_the_record_is_refused(row):
    with pytest.raises(InputError, match="counted from 0"):
        editor().drop_closures(row)


def test_the_report_counts_the_scans_that_are_left():
    one = editor()
    before = one.map.report.input
    one.forget_time(one.map.stamps[-1], one.map.stamps[-1])
    after = one.map.report.input
    assert after.scans == before.scans - 1
    assert after.duration_s == pytest.approx(np.ptp(one.map.stamps))


def test_the_first_pin_moves_the_whole_map():
    one = editor()
    before = one.map.graph.node_poses.copy()
    one.pin_node(2, (-3.0, 7.0, -2.0))
    after = one.map.graph.node_poses

    np.testing.assert_allclose(after[2], (-3.0, 7.0, -2.0), atol=1e-12)
    apart = np.hypot(*(before[0, :2] - before[4, :2]))
    assert np.hypot(*(after[0, :2] - after[4, :2])) == pytest.approx(apart)


def test_further_pins_bend_the_map():
    one = editor()
    x, y, theta = one.map.graph.node_poses[3]
    one.pin_node(0)
    one.pin_node(3, (x + 0.5, y, theta))

    np.testing.assert_allclose(one.map.graph.node_poses[3], (x + 0.5, y, theta), atol=1e-12)
    np.testing.assert_allclose(one.map.graph.node_poses[0], (0, 0, 0), atol=1e-12)
    assert one.map.graph.fixed_nodes == (0, 3)
    assert one.map.graph.fixed_submaps == ()


def test_control_points_move_the_map_and_leave_residuals():
    one = editor()
    tf = Pose(30.0, -4.0, 1.2)
    places = one.map.graph.node_poses[[0, 2, 3], :2] + (0.3, -0.2)
    noise = np.array([(0.02, 0.0), (-0.01, 0.01), (0.0, -0.02)])
    surveyed = transform_points(tf, places) + noise
    before = one.map.graph.node_poses.copy()
    change = one.set_control_points(np.column_stack((places, surveyed)))

    moved = compose_all(np.array(change.fit.tf_surveyed_map), before)
    np.testing.assert_allclose(one.map.graph.node_poses, moved, atol=1e-9)
    np.testing.assert_allclose(change.fit.tf_surveyed_map, tf, atol=0.05)
    assert change.fit.distances.max() < 0.03
    assert "residuals: root mean square 0.0" in change.text


def test_control_points_do_not_scale_the_map():
    change = editor().set_control_points([(0, 0, 0, 0), (8, 0, 10, 0)])

    assert change.fit.scale == pytest.approx(1.25)
    np.testing.assert_allclose(change.fit.distances, (1.0, 1.0))
    assert "the map is 20.00% smaller than the survey" in change.text


@pytest.mark.parametrize("points", [[(0, 0, 0, 0), (8, 0, 8.3, 0)], [(0, 0, 0, 0), (1, 0, 1.1, 0)]])
def test_points_that_fit_are_not_called_mistyped(points):
    assert editor().set_control_points(points).warnings == ()


@pytest.mark.parametrize(
    "points",
    [
        [(0, 0, 0, 0), (8, 0, 18, 0)],  # 18 for 8
        [(0, 0, 0, 0), (8, 0, 8, 0), (8, 4, 8, 14)],  # 14 for 4
        [(0, 0, 0, 0), (100, 0, 108, 0)],
    ],
)
def test_points_that_are_mistyped_are_warned_of(points):
    [warning] = editor().set_control_points(points).warnings

    assert "one may be mistyped" in warning


def test_the_point_that_fits_worst_is_named():
    points = [(0, 0, 0, 0), (8, 0, 8, 0), (8, 4, 8, 14), (0, 4, 0, 4), (4, 2, 4, 2)]

    change = editor().set_control_points(points)

    assert "warning: the points do not fit the map" in change.text
    assert "point 3 fits worst" in change.text


@pytest.mark.parametrize("east", [3_500_000.25, 10_000_000.0, -9_876_543.5])
def test_points_of_a_survey_are_far_from_the_origin(east):
    one = editor()
    before = one.map.graph.node_poses.copy()
    points = [(0, 0, east, 9_999_900.0), (8, 0, east, 9_999_908.0)]
    fit = one.set_control_points(points).fit
    x, y, _ = one.map.graph.node_poses[3].tolist()
    one.pin_node(3, (x, y, 0.0))
    one.undo(1)

    np.testing.assert_allclose(fit.distances, 0.0, atol=1e-8)
    turned = compose_all(np.array((east, 9_999_900.0, math.pi / 2)), before)
    np.testing.assert_allclose(one.map.graph.node_poses, turned, atol=1e-8)
    assert apply_edits(one.original).map.graph.num_nodes == len(before)


def test_pins_that_tear_the_path_are_warned_of():
    one = editor()
    x, y, theta = one.map.graph.node_poses[0].tolist()
    assert one.pin_node(0, (x, y, theta)).warnings == ()
    assert one.pin_node(1, (x + 40.0, y, theta)).warnings[0].startswith("the path is torn")
    assert one.undo(1).warnings == ()


def test_a_second_torn_place_is_named_by_itself():
    one = editor()
    x, y, theta = one.map.graph.node_poses[0].tolist()
    one.pin_node(0, (x, y, theta))
    [first] = one.pin_node(1, (x + 40.0, y, theta)).warnings
    x, y, theta = one.map.graph.node_poses[-2].tolist()
    one.pin_node(one.map.graph.num_nodes - 2, (x, y, theta))

    warnings = one.pin_node(one.map.graph.num_nodes - 1, (x + 20.0, y, theta)).warnings

    assert warnings and first not in warnings


def test_a_point_too_far_away_is_named():
    points = [(0, 0, 5e5, 5e6), (8, 0, 32_500_000.0, 5e6)]

    with pytest.raises(UsageError, match=r"point 2 is 8\.0 0\.0 32500000\.0 .*beyond 10,000 km"):
        editor().set_control_points(points)


def test_alignment_after_control_points_is_warned_of():
    one = editor()
    assert one.align().warnings == ()
    one.set_control_points([(0, 0, 5, 1), (8, 0, 5, 9)])
    change = one.align()

    assert "turned away from the survey" in change.text
    assert one.undo(2).warnings == ()
    one.undo(0)
    assert one.redo(0).warnings == ()  # the points are fitted after it


def test_control_points_follow_edits_made_before_them():
    one = editor()
    one.drop_closures(2)
    places = one.map.graph.node_poses[[1, 4], :2]
    one.set_control_points(np.column_stack((places, [(100.0, 0.0), (100.0, 4.0)])))
    one.undo(0)
    fit = one._applied.fits[1]

    assert fit.distances.max() < 0.1  # of the nodes where they are now
    assert np.hypot(*(one.map.graph.node_poses[1, :2] - (100.0, 0.0))) < 0.1


def _heading(one):
    """Direction of the map within a quarter of a turn."""
    return one.map.graph.node_poses[0, 2] % (math.pi / 2)


def test_aligning_twice_turns_once():
    one = editor()
    one.pin_node(0, (0.0, 0.0, math.radians(20.0)))
    one.align()

    assert one.align().moved_rad < math.radians(1.0)  # of walls 3 m long


def test_walls_stay_aligned_when_an_earlier_edit_is_undone():
    one, other = editor(), editor()
    one.pin_node(0, (0.0, 0.0, math.radians(20.0)))
    one.align()
    one.undo(0)
    other.align()

    assert _heading(one) == pytest.approx(_heading(other), abs=math.radians(1.0))


def test_a_forgotten_span_leaves_no_scan_and_no_node():
    one = editor()
    change = one.forget_time(103.0, 104.0)
    result = one.map

    assert result.stamps.tolist() == [100.0, 101.0, 102.0, 105.0]
    assert result.graph.num_nodes == len(result.node_points) == 4
    assert result.node_scan_index.tolist() == [0, 1, 2, 3]
    assert (change.scans, change.nodes) == (-2, -2)
    left = one.original.graph.node_poses[[0, 1, 2, 5]]
    np.testing.assert_array_equal(result.graph.node_poses, left)
    assert result.report.nodes == 4


def test_a_submap_of_forgotten_scans_alone_is_left_out():
    one = editor()
    one.forget_time(103.0, 105.0)  # all nodes of submap 2

    assert one.map.graph.num_submaps == len(one.map.submap_grids) == 2


def test_cells_nearer_to_forgotten_nodes_are_unknown():
    one = editor()
    one.forget_time(101.0, 101.0)  # node 1 at x 4 of submap 0; node 0 is kept
    before, after = one.original.submap_grids[0], one.map.submap_grids[0]
    known = after.cells > 0
    x = before.origin_x + np.arange(before.shape[1]) * before.resolution

    assert (before.cells > 0).all()
    assert known[:, x < 1.9].all()
    assert not known[:, x > 2.1].any()


def test_numbers_mean_what_is_shown_after_forgetting():
    one = editor()
    one.forget_time(100.0, 100.0)
    row = next(row for row in one.closures() if row.is_in_graph)
    one.drop_closures(row.number)

    assert one.edits[1].arguments["pairs"] == [[row.submap, row.node + 1]]
    one.undo(0)
    removed = one.closures(statuses=["removed"])[0]
    assert (removed.submap, removed.node) == (row.submap, row.node + 1)


def test_a_forgotten_area_is_unknown_in_the_map():
    one = editor()
    before = one.map.occupancy_map()
    change = one.forget_area(0.5, 0.3, 1.5, 1.2)
    after = one.map.occupancy_map()

    assert _at(before, 1.0, 0.7) >= 0.0
    assert _at(after, 1.0, 0.7) < 0.0
    assert _at(after, 0.3, 0.7) >= 0.0
    assert change.returns < 0
    for node, points in enumerate(one.map.node_points):
        placed = transform_points(Pose(*one.map.graph.node_poses[node]), points)
        inside = ((placed > (0.5, 0.3)) & (placed < (1.5, 1.2))).all(axis=1)
        assert not inside.any()


def test_an_area_without_anything_is_not_stored():
    one = editor()
    one.forget_area(0.5, 0.3, 1.5, 1.2)
    with pytest.raises(InputError, match=r"its path lies from x 0\.0 to 8\.0 m"):
        one.forget_area(0.6, 0.4, 1.4, 1.1)
    assert len(one.edits) == 1


def test_an_area_with_returns_alone_is_forgotten():
    bare = finished_map()
    unknown = [
        FinishedGrid(np.zeros_like(grid.cells), grid.origin_x, grid.origin_y, grid.resolution)
        for grid in bare.submap_grids
    ]
    one = Editor(replace(bare, submap_grids=unknown))

    assert one.forget_area(0.5, 0.3, 1.5, 1.2).returns < 0


def _at(occupancy_map, x, y):
    row = int((y - occupancy_map.origin_y) / occupancy_map.resolution)
    col = int((x - occupancy_map.origin_x) / occupancy_map.resolution)
    return occupancy_map.probability[row, col]


def test_a_forgotten_area_moves_with_the_map():
    one = editor()
    one.set_control_points([(0, 0, 10, 0), (8, 0, 18, 0)])
    one.forget_area(10.5, 0.3, 11.5, 1.2)
    one.undo(0)

    assert _at(one.map.occupancy_map(), 1.0, 0.7) < 0.0


def test_a_session_is_split_and_named():
    one = editor()
    one.split_session(0, 102.5, "afternoon")
    one.rename_session(0, "morning")
    first, second = one.map.sessions

    assert (first.name, second.name) == ("morning", "afternoon")
    assert (second.first_scan, second.first_node, second.first_submap) == (3, 3, 2)
    assert second.stamp == 103.0
    assert np.array_equal(poses_of(one.map), poses_of(one.original))


def test_a_session_without_scans_is_left_out():
    one = editor()
    one.split_session(0, 102.5, "afternoon")
    one.forget_time(100.0, 102.0)
    [session] = one.map.sessions

    assert (session.name, session.first_scan, session.first_submap) == ("afternoon", 0, 0)
    one.rename_session(0, "evening")
    one.undo(1)
    assert [session.name for session in one.map.sessions] == ["a.log", "evening"]


def twice_recorded():
    """An editor of a map of two sessions, three scans each, with the same stamps."""
    one = editor()
    one.split_session(0, 102.5, "again")
    result = replace(one.map, original=None, edits=())
    return Editor(replace(result, stamps=np.tile((100.0, 101.0, 102.0), 2)))


def test_a_span_of_one_session_is_forgotten():
    one = twice_recorded()
    change = one.forget_time(100.0, 101.0, 1)

    assert change.scans == -2
    assert one.map.stamps.tolist() == [100.0, 101.0, 102.0, 102.0]
    assert one.described() == [
        "forget the scans from 100.000 to 101.000 of the session that begins with scan 3"
    ]
    assert one.forget_time(100.0, 101.0).scans == -2


def test_a_whole_session_is_forgotten():
    one = twice_recorded()
    one.forget_session(0)

    assert [session.name for session in one.map.sessions] == ["again"]
    assert one.map.stamps.tolist() == [100.0, 101.0, 102.0]
    assert one.edits[0].arguments["scans"] == [0, 3]


def test_the_session_of_a_span_stays_the_same():
    one = twice_recorded()
    one.forget_time(100.0, 100.0, 0)
    one.forget_session(1)
    one.undo(0)

    assert one.map.stamps.tolist() == [100.0, 101.0, 102.0]
    assert [session.name for session in one.map.sessions] == ["a.log"]


@pytest.mark.parametrize(
    ("edit", "says"),
    [
        (lambda one: one.pin_node(6), "node 6: the map has nodes 0 to 5"),
        (lambda one: one.pin_submap(-1), "submap -1: the map has submaps 0 to 2"),
        (lambda one: one.undo(), "there is no edit to undo"),
        (lambda one: one.undo(3), "edit 3: the map has no edits"),
        (lambda one: one.forget_time(0, 1), r"no scan has a stamp from 0\.000 to 1\.000"),
        (lambda one: one.forget_time(0, 200), "nothing would be left"),
        (lambda one: one.forget_time(0, 1, 0), "no scan of session 0 has a stamp from 0"),
        (lambda one: one.forget_time(100, 101, 1), "session 1: the map has sessions 0 to 0"),
        (lambda one: one.forget_session(0), "nothing would be left"),
        (lambda one: one.forget_session(1), "session 1: the map has sessions 0 to 0"),
        (lambda one: one.forget_area(50, 50, 51, 51), "shows nothing from x 50 to 51 m, y 50"),
        (lambda one: one.split_session(0, 99.0), r"is of 100\.000 to 105\.000: give a stamp"),
        (lambda one: one.split_session(1, 99.0), "session 1: the map has sessions 0 to 0"),
        (lambda one: one.set_control_points([(0, 0, 1, 1), (0, 0, 2, 2)]), "lie within 0.1 m"),
        (lambda one: one.add_closure(0, 0), "was inserted into this submap"),
        (lambda one: one.add_closure(0, 5), "is closure 0, which is in the graph"),
    ],
)
def test_what_cannot_be_edited_is_refused(edit, says):
    one = editor()
    with pytest.raises(InputError, match=says):
        edit(one)
    assert one.edits == ()


@pytest.mark.parametrize(
    "edit",
    [
        lambda one: one.drop_closures(),
        lambda one: one.drop_closures("a"),
        lambda one: one.pin_node(0, (0.0, math.nan, 0.0)),
        lambda one: one.pin_node(0, (0.0, 1e9, 0.0)),
        lambda one: one.set_control_points([(0, 0, 1, 1)]),
        lambda one: one.forget_area(0, 0, 0, 1),
        lambda one: one.forget_time(5, 4),
        lambda one: one.rename_session(0, "two\nlines"),
        lambda one: one.closures(statuses=["good"]),
        lambda one: one.save(),
    ],
)
def test_impossible_arguments_are_refused(edit):
    one = editor()
    one.pin_node(0)
    with pytest.raises(UsageError):
        edit(one)


def test_a_map_that_was_stopped_is_not_edited():
    with pytest.raises(InputError, match="mapping was stopped before its end"):
        Editor(small_result())
