# SPDX-License-Identifier: Apache-2.0
"""Finding a wall's face in a map image, as a person with a drawing tool would."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import FloatArray
from cartoloop.evaluation.map_image import MapImage

_HALF_BAND_M = 0.15
_MAX_RAYS_ASIDE = 20
_LAYER_PIXELS = 2.0
_FREE_WITHIN_PIXELS = 3.0
_SAMPLES_PER_PIXEL = 20
_RECENTRINGS = 3


def wall_distance(
    map_image: MapImage, middle: FloatArray, along: FloatArray, near: float, far: float
) -> float | None:
    """Return the distance of the first wall met [m], None if there is none.

    Parameters
    ----------
    map_image : the map.
    middle : float64 (2,), where to start, in free space [m, map frame].
    along : float64 (2,), unit vector of the direction.
    near, far : between which distances the wall is [m].

    Notes
    -----
    A band of parallel rays is followed, 0.15 m to either side. Along a ray, each occupied pixel
    with free space at most three pixels before it begins a face. The wall is where more than half
    of the rays first agree on a face, at their median: what fewer of them meet, as specks and door
    posts, is passed by.

    The tape measures from face to face, and a scan's hits lie on the face, which is the middle of
    the pixels that they darken, not their inner edge: the middle is the centre of mass of the
    occupancy above one half (which unknown pixels have in maps of probabilities). Only the first
    two pixels count, for what is darker behind them is no more of this face: the other side of
    the same wall, or its filling.
    """
    pixel = map_image.resolution
    half_band = max(_HALF_BAND_M, 1.5 * pixel)  # of three pixels, one is no majority
    num_aside = min(math.ceil(2.0 * half_band / pixel), _MAX_RAYS_ASIDE)
    offsets = np.linspace(-half_band, half_band, 2 * num_aside + 1)
    step = pixel / _SAMPLES_PER_PIXEL
    margin = _FREE_WITHIN_PIXELS * pixel
    distances = np.arange(near - margin, far + margin, step) + step / 2.0
    across = np.array((-along[1], along[0]))
    points = (
        middle
        + distances[np.newaxis, :, np.newaxis] * along
        + offsets[:, np.newaxis, np.newaxis] * across
    )
    occupancy = map_image.sample(points.reshape(-1, 2)).reshape(points.shape[:2])
    faces = [_faces(ray, distances, map_image, near, far) for ray in occupancy]
    # An oblique wall is met at different distances, up to 45 degrees.
    tolerances = np.abs(offsets) + 2.0 * pixel
    for candidate in np.sort(np.concatenate(faces)).tolist():
        if len(agreeing := _agreeing(faces, tolerances, candidate)) > num_aside:
            wall = _middle(agreeing)
            # The first to be agreed on is the near side of an oblique wall: once more from there.
            for _ in range(_RECENTRINGS):
                wall = _middle(_agreeing(faces, tolerances, wall))
            return wall
    return None


def _agreeing(faces: list[FloatArray], tolerances: FloatArray, distance: float) -> list[float]:
    """Return the face [m] nearest to `distance` on each ray that has one within its tolerance."""
    nearest = [
        float(on_ray[np.argmin(np.abs(on_ray - distance))]) if len(on_ray) else math.inf
        for on_ray in faces
    ]
    return [
        face
        for face, tolerance in zip(nearest, tolerances.tolist(), strict=True)
        if abs(face - distance) <= tolerance
    ]


def _middle(faces: list[float]) -> float:
    """Return the median as one of the faces, which therefore agrees with itself."""
    return sorted(faces)[len(faces) // 2]


def _faces(
    occupancy: NDArray[np.float32],
    distances: FloatArray,
    map_image: MapImage,
    near: float,
    far: float,
) -> FloatArray:
    """Return the distances of all faces [m] along a ray from near to far."""
    faces: list[float] = []
    occupied = occupancy > map_image.occupied_thresh
    free = (occupancy >= 0.0) & (occupancy < map_image.free_thresh)
    ground = min(0.5, map_image.occupied_thresh)
    weight = np.maximum(occupancy - ground, 0.0).astype(np.float64)
    layer = round(_LAYER_PIXELS * _SAMPLES_PER_PIXEL)
    lookback = round(_FREE_WITHIN_PIXELS * _SAMPLES_PER_PIXEL)
    for first in (np.flatnonzero(occupied[1:] & ~occupied[:-1]) + 1).tolist():
        if not np.any(free[max(0, first - lookback) : first]):
            continue
        # Grey pixels before the first occupied one belong to it.
        light_before = np.flatnonzero(weight[:first] == 0.0)
        begin = int(light_before[-1]) + 1 if len(light_before) else 0
        light_behind = np.flatnonzero(weight[first : begin + layer] == 0.0)
        end = first + int(light_behind[0]) if len(light_behind) else begin + layer
        face = float(np.average(distances[begin:end], weights=weight[begin:end]))
        if near <= face <= far:
            faces.append(face)
    return np.array(faces)
