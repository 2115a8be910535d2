# SPDX-License-Identifier: Apache-2.0
"""A later drive through a building: furniture was moved, doors were closed, the route differs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cartoloop.simulation.floor_plan import FloorPlan, Point, Room, shut_door
from cartoloop.simulation.furniture import Furniture, Item

SHARE_CHANGED = 0.25
"""Share of the furniture that is moved or removed from one drive to the next."""

SHARE_REMOVED = 0.3
"""Share of these that is removed."""

SHARE_BROUGHT_BACK = 0.5
"""Share of the removed furniture that stands somewhere again on the next drive."""

SHARE_OPEN_DOORS_CLOSED = 0.4
"""Share of the open doors of rooms that are never visited that is closed on a drive."""

SHARE_SKIPPED = 0.3
"""Share of the rooms on the route that a drive leaves out."""

WANDERING_M = 0.1
"""Largest displacement of a corner of the route in a corridor, along x and y [m]."""

NUM_TRIES = 20
"""Places that are tried for a piece of furniture before it stays where it was."""

CLEARANCE_M, GAP_M = 0.45, 0.1
"""Distances of moved furniture to the routes and to other furniture [m]."""

# What is drawn from each stream of random numbers, so that none changes another.
_ROUTE, _DOORS, _FURNITURE = 1, 2, 3


@dataclass(frozen=True, slots=True)
class Stop:
    """A part of a route: corners of its path [m], map frame.

    Attributes
    ----------
    path : the corners, in order.
    may_be_skipped : whether the straight path between the parts before and after it is free.
    """

    path: tuple[Point, ...]
    may_be_skipped: bool = False

    @classmethod
    def at(cls, x: float, y: float) -> Stop:
        """Return a stop that is one place [m]."""
        return cls(((x, y),))


def vary_route(stops: Sequence[Stop], seed: int, drive: int) -> list[Stop]:
    """Return the stops of a later drive on a route that ends where it begins.

    Parameters
    ----------
    stops : of the first drive.
    seed, drive : of the world.
    """
    rng = np.random.default_rng((seed, _ROUTE, drive))
    kept = [stop for stop in stops if not (stop.may_be_skipped and rng.random() < SHARE_SKIPPED)]
    places = [number for number, stop in enumerate(kept) if len(stop.path) == 1]
    first = int(rng.choice(places))
    varied = [_displaced(rng, stop) for stop in (*kept[first:], *kept[: first + 1])]
    if rng.random() < 0.5:
        return varied
    return [Stop(stop.path[::-1], stop.may_be_skipped) for stop in reversed(varied)]


def close_doors(plan: FloorPlan, rooms: Sequence[Room], seed: int, drive: int) -> None:
    """Close some of the open doors of rooms whose doors are not always open.

    Parameters
    ----------
    plan : the floor.
    rooms : whose doors may be closed.
    seed, drive : of the world.
    """
    rng = np.random.default_rng((seed, _DOORS, drive))
    for room in rooms:
        if rng.random() < SHARE_OPEN_DOORS_CLOSED and not room.door.closed:
            shut_door(plan, room)


def rearrange(furniture: Furniture, seed: int, drive: int) -> None:
    """Move furniture as it was moved between the first drive and a later one.

    What stands where on a drive depends on the drive before it.

    Parameters
    ----------
    furniture : as it stands on the first drive.
    seed, drive : of the world.
    """
    removed: list[Item] = []
    for number in range(2, drive + 1):
        rng = np.random.default_rng((seed, _FURNITURE, number))
        back = [item for item in removed if rng.random() < SHARE_BROUGHT_BACK]
        for item in list(furniture.items):
            if rng.random() < SHARE_CHANGED:
                furniture.take_away(item)
                if rng.random() < SHARE_REMOVED:
                    removed.append(item)
                elif not _put_elsewhere(furniture, rng, item):
                    furniture.put(item)
        for item in back:
            if _put_elsewhere(furniture, rng, item):
                removed.remove(item)


def _put_elsewhere(furniture: Furniture, rng: np.random.Generator, item: Item) -> bool:
    """Put an item at a random free place of its area; return whether one was found."""
    x_min, y_min, x_max, y_max = item.bounds
    left, bottom, right, top = item.area
    for _ in range(NUM_TRIES):
        x = rng.uniform(left, max(right - (x_max - x_min), left))
        y = rng.uniform(bottom, max(top - (y_max - y_min), bottom))
        moved = item.moved(x - x_min, y - y_min)
        if furniture.is_free(moved.bounds, CLEARANCE_M, GAP_M):
            furniture.put(moved)
            return True
    return False


def _displaced(rng: np.random.Generator, stop: Stop) -> Stop:
    """Return a stop in a corridor a little aside: nobody drives on rails."""
    if len(stop.path) > 1:
        return stop
    ((x, y),) = stop.path
    aside = rng.uniform(-WANDERING_M, WANDERING_M, 2)
    return Stop.at(x + float(aside[0]), y + float(aside[1]))
