# SPDX-License-Identifier: Apache-2.0
"""The recording that the benchmarks of live mapping and of the view replay."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path


def museum_or(log: Path | None, folder: Path, seed: int, progress: Callable[[str], None]) -> Path:
    """Return the given recording, or that of a museum, simulated into a folder.

    Raises
    ------
    InputError
        The given file is not a recording.
    """
    if log is not None:
        from cartoloop.readers import open_log

        open_log(log)
        return log
    from cartoloop.simulation import make_world, simulate
    from cartoloop.simulation.lidar import make_lidar

    progress("simulating the museum")
    path = folder / "museum.log"
    simulate(make_world("museum", seed), make_lidar("backpack"), seed=seed).write_carmen(path)
    return path
