# SPDX-License-Identifier: Apache-2.0
"""Find a robot in a finished map, and track it.

python examples/locate_a_robot.py
"""

from __future__ import annotations

import math

import cartoloop
from cartoloop.localisation.answer import State
from cartoloop.simulation import make_world, simulate


def main() -> float:
    """Map a simulated flat, drive through it again, and return the last error [m]."""
    world = make_world("flat", seed=1)
    first = simulate(world, seed=1, duration=120.0)
    mapper = cartoloop.Mapper()
    for event in first.events():
        mapper.add(event)

    # The robot starts again somewhere on its way; the localiser does not know where.
    localizer = cartoloop.Localizer(mapper.finish())
    again = simulate(world, seed=2, duration=120.0)
    start = again.stamps[len(again.stamps) // 3]
    state = None
    for event in again.events():
        if event.stamp < start:
            continue
        answer = localizer.add(event)
        if answer is not None and answer.state != state:
            state = answer.state
            print(f"{answer.stamp:.1f} s: {state} {answer.tf_map_tracking or ''}")  # noqa: T201

    answer = localizer.finish() or localizer.answer
    if answer is None or answer.state is not State.LOCATED or answer.tf_map_tracking is None:
        return math.inf
    # The map begins where the first drive began.
    tf_world_first = cartoloop.Pose(*first.true_poses[0].tolist())
    last = cartoloop.Pose(*again.true_poses[-1].tolist())
    cos, sin = math.cos(tf_world_first.theta), math.sin(tf_world_first.theta)
    x = tf_world_first.x + cos * answer.tf_map_tracking.x - sin * answer.tf_map_tracking.y
    y = tf_world_first.y + sin * answer.tf_map_tracking.x + cos * answer.tf_map_tracking.y
    error = math.dist((x, y), (last.x, last.y))
    print(f"{localizer.num_located} of {localizer.num_scans} located, {error:.3f} m wrong")  # noqa: T201
    return error


if __name__ == "__main__":
    main()
