# SPDX-License-Identifier: Apache-2.0
"""What differs from the map is reported: furniture and doors, and neither people nor errors."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from PIL import Image

from cartoloop.errors import UsageError
from cartoloop.localisation.answer import Answer, State
from cartoloop.localisation.changes.areas import Kind
from cartoloop.localisation.changes.output import content, save_changes, table
from cartoloop.localisation.changes.watch import ChangeWatch
from cartoloop.localisation.localizer import Localizer
from cartoloop.map_output.colours import APPEARED_COLOUR, DISAPPEARED_COLOUR
from cartoloop.sensor.pose import IDENTITY, Pose, compose
from tests.localisation.rooms import ROOM, START, drive, events, known_map, points

OUTLINE, PILLAR = ROOM
MOVED = ((6.5, 3.6), (7.1, 3.6), (7.1, 4.1), (6.5, 4.1))
AFTER = (OUTLINE, MOVED)

ROOMS = (
    (
        (1, 1), (9, 1), (9, 4.9), (5.5, 4.9), (5.5, 5.1), (9, 5.1), (9, 8), (1, 8), (1, 5.1),
        (4.5, 5.1), (4.5, 4.9), (1, 4.9),
    ),
)  # fmt: skip
"""Two rooms with an open door between them."""

DOOR = ((4.5, 4.97), (5.5, 4.97), (5.5, 5.03), (4.5, 5.03))


def poses_around(start=START):
    """Return poses of a drive along a small circle."""
    return drive(start, 60, step=0.06, turn=0.11)


def seen(before, after, poses=None, origin=IDENTITY):
    """Return the changes that a drive in a room shows, given a map of it as it was."""
    poses = poses or poses_around()
    localizer = Localizer(known_map(before, origin=origin), at=poses[0], watch_changes=True)
    for event in events(after, poses):
        localizer.add(event)
    localizer.finish()
    assert localizer.answer.state is State.LOCATED
    return localizer.changes()


@pytest.fixture(scope="module")
def moved():
    return seen(ROOM, AFTER)


def middle(polygon):
    return np.mean(polygon, axis=0)


def test_a_box_that_was_moved_is_one_area_gone_and_one_new(moved):
    assert [len(moved.of(kind)) for kind in Kind] == [1, 1]
    for kind, polygon in ((Kind.APPEARED, MOVED), (Kind.DISAPPEARED, PILLAR)):
        (area,) = moved.of(kind)
        assert math.dist((area.x, area.y), middle(polygon)) < 0.35
        x_min, y_min, x_max, y_max = area.box
        assert (np.min(polygon, axis=0) - 0.16 <= (x_min, y_min)).all()
        assert (np.max(polygon, axis=0) + 0.16 >= (x_max, y_max)).all()
        assert max(x_max - x_min, y_max - y_min) > 0.3
        assert 0.03 <= area.size < 0.4
        assert area.num_scans >= 4
        assert area.confidence > 0.7
        assert 0.0 <= area.first_stamp < area.last_stamp <= 6.0


def test_areas_are_in_the_map_frame_however_the_image_lies():
    changes = seen(ROOM, AFTER, origin=Pose(-1.0, -2.5, 0.3))

    (appeared,) = changes.of(Kind.APPEARED)
    assert math.dist((appeared.x, appeared.y), middle(MOVED)) < 0.35


def test_nothing_has_changed_where_nothing_has():
    assert seen(ROOM, ROOM).areas == ()


@pytest.mark.parametrize(
    ("before", "after", "kind"),
    [(ROOMS, (*ROOMS, DOOR), Kind.APPEARED), ((*ROOMS, DOOR), ROOMS, Kind.DISAPPEARED)],
)
def test_a_door_that_was_closed_or_opened_is_reported(before, after, kind):
    (door,) = seen(before, after, poses_around(Pose(4.2, 2.4, 1.0))).areas

    assert door.kind is kind
    assert (door.x, door.y) == pytest.approx((5.0, 5.0), abs=0.2)
    assert 0.5 < door.box[2] - door.box[0] < 1.1


def test_a_person_who_walks_through_is_not_reported():
    localizer = Localizer(known_map(ROOM), at=START, watch_changes=True)
    for k, pose in enumerate(poses_around()):
        x, y = 6.5, 1.2 + 0.08 * k  # 0.8 m/s
        person = ((x, y), (x + 0.3, y), (x + 0.3, y + 0.3), (x, y + 0.3))
        _, scan = events((*ROOM, person), [pose], k)
        localizer.add(scan)

    changes = localizer.changes()
    assert changes.num_scans > 20
    assert changes.areas == ()


def answer_at(pose, stamp):
    covariance = np.diag(np.square((0.02, 0.02, math.radians(0.3))))
    return Answer(stamp, State.LOCATED, pose, covariance, pose, 0.9, 0.2, 0.95)


def test_errors_of_the_pose_are_no_changes():
    rng = np.random.default_rng(0)
    watch = ChangeWatch(known_map(ROOM))
    for k, pose in enumerate(5 * poses_around()):
        wrong = rng.normal(0.0, (0.02, 0.02, math.radians(0.3)))
        watch.add(answer_at(compose(pose, Pose(*wrong)), 0.2 * k), points(ROOM, pose), IDENTITY)

    changes = watch.changes()

    assert changes.num_scans > 100
    assert changes.areas == ()


def test_a_lasting_error_of_the_pose_is_no_change():
    watch = ChangeWatch(known_map(ROOM))
    for k, pose in enumerate(2 * poses_around()):
        wrong = compose(pose._replace(x=pose.x + 0.02), Pose(0.0, 0.0, math.radians(0.3)))
        watch.add(answer_at(wrong, 0.2 * k), points(ROOM, pose), IDENTITY)

    assert watch.changes().areas == ()


def test_scans_before_a_robot_is_lost_do_not_count():
    watch = ChangeWatch(known_map(ROOM))
    poses = poses_around()[:40]  # 2.4 m: less than it takes to notice
    for k, pose in enumerate(poses):
        watch.add(answer_at(pose, 0.5 * k), points(AFTER, pose), IDENTITY)
    lost = Answer(
        20.0, State.LOST, None, None, IDENTITY, math.nan, math.nan, math.nan
    )  # fmt: skip
    watch.add(lost, points(AFTER, poses[-1]), IDENTITY)

    assert watch.changes().num_scans == 0


def test_a_robot_that_stands_still_does_not_repeat_itself():
    watch = ChangeWatch(known_map(ROOM))
    for k in range(40):
        watch.add(answer_at(START, 0.1 * k), points(AFTER, START), IDENTITY)

    assert watch.changes().num_scans == 4


def test_areas_are_listed_by_size_with_all_facts(moved, tmp_path):
    save_changes(moved, tmp_path / "new")

    listed = json.loads((tmp_path / "new" / "changes.json").read_text())
    assert listed == content(moved)
    assert listed["compared_scans"] == moved.num_scans
    sizes = [area["size_m2"] for area in listed["areas"]]
    assert sizes == sorted(sizes, reverse=True)
    assert min(sizes) >= listed["min_size_m2"]
    assert set(listed["areas"][0]) == {
        "number", "kind", "x", "y", "size_m2", "box", "scans", "first_stamp", "last_stamp",
        "confidence",
    }  # fmt: skip
    assert [row.split()[1] for row in table(moved).splitlines()[2:]] == [
        area["kind"] for area in listed["areas"]
    ]


def test_the_picture_shows_both_kinds_of_areas(moved, tmp_path):
    save_changes(moved, tmp_path)

    picture = np.asarray(Image.open(tmp_path / "changes.png"))
    for colour in (APPEARED_COLOUR, DISAPPEARED_COLOUR):
        assert (picture == colour).all(axis=2).sum() > 500


def test_the_same_drive_yields_the_same_files(moved, tmp_path):
    save_changes(moved, tmp_path / "first")
    save_changes(seen(ROOM, AFTER), tmp_path / "second")

    for name in ("changes.json", "changes.png"):
        first, second = (tmp_path / folder / name for folder in ("first", "second"))
        assert first.read_bytes() == second.read_bytes()


def test_changes_that_were_not_watched_are_refused():
    with pytest.raises(UsageError, match="watch_changes"):
        Localizer(known_map(ROOM)).changes()
