# SPDX-License-Identifier: Apache-2.0
"""A localisation in a room, step by step, with its view."""

from __future__ import annotations

from contextlib import contextmanager

from cartoloop.localisation.localizer import Localizer
from cartoloop.viewer.locate_view import LocateView
from tests.localisation.rooms import drive, events, known_map


class Locating:
    """A robot that drives in a room, and the view of where it is.

    Parameters
    ----------
    polygons : walls of the room of the map.
    start : where the drive begins.
    inside : walls of the room in which it really drives; the same by default.
    """

    def __init__(self, polygons, start, inside=None, **options):
        self.localizer = Localizer(known_map(polygons))
        self.view = LocateView(self.localizer, "room", port=0, **options)
        self.poses = drive(start, 400, step=0.05, turn=0.04)
        self._events = events(inside or polygons, self.poses)
        self.answers = []

    @property
    def url(self):
        return self.view.url

    def go(self, num_scans):
        """Drive on for some scans, and return the last answer."""
        until = len(self.answers) + num_scans
        while len(self.answers) < until:
            answer = self.localizer.add(next(self._events))
            if answer is not None:
                self.answers.append(answer)
                self.view.after_answer(answer)
        return self.answers[-1]

    @property
    def pose(self):
        """Where the robot is."""
        return self.poses[len(self.answers) - 1]


def go(one, page, num_scans):
    """Drive on, until a page in a browser has seen the last answer; return that."""
    answer = one.go(num_scans)
    while page.state["localisation"]["stamp"] != answer.stamp:
        one.view.idle()
        page.page.wait_for_timeout(20)
    page.settle()
    return answer


@contextmanager
def locating(polygons, start, **options):
    """Yield a localisation with its view, which must not fail."""
    one = Locating(polygons, start, **options)
    try:
        yield one
    finally:
        one.view.close()
    assert one.view.failure is None
