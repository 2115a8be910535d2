# SPDX-License-Identifier: Apache-2.0
"""The simulated worlds by name."""

from __future__ import annotations

from collections.abc import Callable
from difflib import get_close_matches

from cartoloop.errors import ConfigError
from cartoloop.simulation.campus import campus
from cartoloop.simulation.corridors import bare, corridor, ring
from cartoloop.simulation.flat import flat
from cartoloop.simulation.floor_plan import World
from cartoloop.simulation.hall import hall
from cartoloop.simulation.museum import museum
from cartoloop.simulation.office import office
from cartoloop.simulation.wings import wings
from cartoloop.simulation.yard import yard

WORLDS: dict[str, Callable[[int], World]] = {
    "office": office,
    "corridor": corridor,
    "ring": ring,
    "museum": museum,
    "flat": flat,
    "bare": bare,
    "hall": hall,
    "wings": wings,
    "campus": campus,
    "yard": yard,
}


LATER_DRIVES: dict[str, Callable[[int, int], World]] = {"office": office}
"""Worlds with later drives, by seed and number of the drive."""


def make_world(name: str, seed: int = 0, drive: int = 1) -> World:
    """Return the world of a name, made from a seed.

    Parameters
    ----------
    name : of the world.
    seed : of all that is random in it.
    drive : 1, or a later drive through the same building; see `office`.

    Raises
    ------
    ConfigError
        When there is no world of that name, or no such drive in it.
    """
    if name not in WORLDS:
        nearest = get_close_matches(name, WORLDS, n=1, cutoff=0.0)[0]
        raise ConfigError(
            f"no simulated world {name!r}: choose from {', '.join(WORLDS)} (nearest: {nearest})"
        )
    if drive == 1:
        return WORLDS[name](seed)
    if drive < 1 or name not in LATER_DRIVES:
        raise ConfigError(
            f"no drive {drive} through the simulated world {name!r}: later drives are through "
            f"{', '.join(LATER_DRIVES)}, numbered from 1 on"
        )
    return LATER_DRIVES[name](seed, drive)
