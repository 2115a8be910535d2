# SPDX-License-Identifier: Apache-2.0
"""All that the beams of a level simulated scanner meet: walls, panes of glass, people."""

from __future__ import annotations

import math

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.simulation.difficulties import Difficulties, Stream, random_stream
from cartoloop.simulation.floor_plan import World
from cartoloop.simulation.glass import GlazedWalls, glazed, seen_through
from cartoloop.simulation.lidar import Lidar, true_ranges, walls_within
from cartoloop.simulation.motion import Motion
from cartoloop.simulation.people import People


class Surroundings:
    """What one scanner of a recording can see.

    Scans must be asked for in order of time, each once.

    Parameters
    ----------
    world : its walls.
    difficulties : glass and people among them.
    motion : of the robot.
    seed : of the recording.
    scanner : number of the scanner.
    """

    def __init__(
        self, world: World, difficulties: Difficulties, motion: Motion, seed: int, scanner: int
    ) -> None:
        self._walls = GlazedWalls(world.walls, np.empty((0, 4)))
        self._people: People | None = None
        if difficulties.glass > 0.0:
            places = random_stream(seed, Stream.GLASS)
            self._walls = glazed(world.walls, difficulties.glass, places)
        if difficulties.people > 0:
            walks = random_stream(seed, Stream.PEOPLE)
            self._people = People(motion, difficulties.people, walks)
        self._glass_beams = random_stream(seed, Stream.GLASS_BEAMS, scanner)

    def ranges(self, poses: FloatArray, times: FloatArray, lidar: Lidar) -> FloatArray:
        """Return the exact range along each beam.

        Parameters
        ----------
        poses : float64, shape (n, 3), the robot's x [m], y [m], theta [rad], map frame.
        times : float64, shape (n,), when the scans are taken [s].
        lidar : the scanner.

        Returns
        -------
        float64, shape (n, num_beams) [m]; inf where nothing comes back.
        """
        # The scanner may be mounted beside the origin of the tracking frame.
        reach = lidar.range_max + math.hypot(*lidar.tf_tracking_sensor[:2])
        found = true_ranges(walls_within(self._walls.solid, poses, reach), poses, lidar)
        if len(self._walls.glass):
            found = seen_through(found, self._walls.glass, poses, lidar, self._glass_beams)
        if self._people is not None:
            found = np.minimum(found, self._people.ranges(poses, times, lidar))
        return found
