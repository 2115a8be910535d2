# SPDX-License-Identifier: Apache-2.0
"""``python -m bench lifelong``: one building, driven through again and again."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bench.command_runs import run_command
from bench.environment import environment
from bench.record import Figure, Record, Row, read_record
from cartoloop.arrays import BoolArray, FloatArray
from cartoloop.evaluation.trajectories import Trajectory, read_tum
from cartoloop.evaluation.trajectory_error import TrajectoryError, evaluate_trajectory
from cartoloop.map_output.occupancy_map import OccupancyMap
from cartoloop.result import Result, load_map
from cartoloop.sensor.pose import Pose, compose, inverse, transform_points

DRAWN_WITHIN_M = 0.1
"""A wall is drawn where a cell is occupied this near to it [m]."""

APART_M = 0.3
"""Furniture of one drive counts where nothing stands as near as this on the other drive [m]."""

SETTLED_AFTER = 3
"""Size and cost are compared with those after this drive: the first ones see new rooms."""

ALONE = "error of this drive alone"
"""Figure of the map of one drive."""

_POINT_SPACING_M, _WALL_SPACING_M = 0.02, 0.1
"""Of the places on furniture, and of those on walls, where the map is looked at [m]."""

_STANDS_WITHIN_M = 0.02
"""A wall of the first drive stands if every drive has one this near [m]."""


@dataclass(frozen=True, slots=True)
class LifelongOptions:
    """What is measured.

    Attributes
    ----------
    drives : number of drives through the building.
    seed : of the building and all noise.
    lifelong : whether old submaps give way to new ones.
    keep : folder in which recordings, maps and figures stay; drives whose figures are there are
        not made again. None: nothing is kept.
    """

    drives: int
    seed: int
    lifelong: bool = True
    keep: Path | None = None


def run(options: LifelongOptions, progress: Callable[[str], None]) -> Record:
    """Return size, cost and error of the map after each drive, and what it shows of furniture.

    Notes
    -----
    Each drive is added by ``cartoloop map --onto`` in a process of its own. Processor time holds
    the start of the process, reading and saving.
    """
    with _folder(options) as folder:
        progress("warming up: compiling kernels where they are not yet")
        run_command("demo", "-o", folder / "demo")
        rows = [_drive(folder, drive, options, progress) for drive in range(1, options.drives + 1)]
        rows.append(_growth(rows))
        rows.append(_furniture(folder, options, progress))
    return Record("lifelong", tuple(rows), environment())


@contextmanager
def _folder(options: LifelongOptions) -> Iterator[Path]:
    """Yield the folder of these drives that is kept, or one that is removed."""
    if options.keep is not None:
        own = options.keep / f"seed-{options.seed}{'' if options.lifelong else '-all'}"
        own.mkdir(parents=True, exist_ok=True)
        yield own
        return
    with tempfile.TemporaryDirectory(prefix="cartoloop-lifelong-") as name:
        yield Path(name)


def _drive(
    folder: Path, drive: int, options: LifelongOptions, progress: Callable[[str], None]
) -> Row:
    """Return the figures of a drive: those that were kept, or of one that is made."""
    kept = folder / f"{drive}.json"
    if kept.is_file():
        row = read_record(kept).rows[0]
        if ALONE in row.figures:
            return row
        figures = row.figures | {ALONE: _error_alone(folder, drive, progress)}
        return replace(row, figures=figures)
    row = _new_drive(folder, drive, options, progress)
    kept.write_text(Record("lifelong", (row,)).to_json(), encoding="utf-8")
    return row


def _new_drive(
    folder: Path, drive: int, options: LifelongOptions, progress: Callable[[str], None]
) -> Row:
    """Add a drive to the map and return the figures."""
    log, out, before = folder / f"{drive}.log", folder / f"map-{drive}", folder / f"map-{drive - 1}"
    truth = folder / f"{drive}.tum"
    run_command(
        "simulate", "office", "--seed", str(options.seed), "--drive", str(drive),
        "-o", log, "--truth", truth,
    )  # fmt: skip
    onto: list[str | Path] = ["--onto", before] if drive > 1 else []
    if drive > 1 and options.lifelong:
        onto.append("--lifelong")
    cost = run_command("map", log, *onto, "-o", out)
    result = load_map(out)
    last = result.sessions[-1]
    num_new = result.graph.num_nodes - last.first_node
    error = _error(folder, out, drive)
    own = _error(folder, out, drive, last.stamp)
    progress(
        f"drive {drive}: {result.graph.num_submaps} submaps, {result.graph.num_nodes} nodes, "
        f"rmse {_rmse(error) * 100:.1f} cm, {cost.cpu_s:.0f} s"
    )
    figures = {
        "sessions": Figure.exact(len(result.sessions)),
        "submaps": Figure.exact(result.graph.num_submaps),
        "nodes": Figure.exact(result.graph.num_nodes),
        "file": Figure.exact((out / "map.cartoloop").stat().st_size / 1e6, "MB"),
        "peak memory": Figure(cost.peak_memory_mb, "MB"),
        "time a node": Figure(1e3 * cost.cpu_s / num_new, "ms"),
        "error": Figure.exact(100 * _rmse(error), "cm"),
        "error of this drive": Figure.exact(100 * _rmse(own), "cm"),
        ALONE: _error_alone(folder, drive, progress),
        "map frame moved": Figure.exact(100 * _moved(folder, error), "cm"),
    }
    apart = sum(session.part != 0 for session in result.sessions)
    return Row({"drive": str(drive)}, figures, f"{apart} sessions apart" if apart else "")


def _error_alone(folder: Path, drive: int, progress: Callable[[str], None]) -> Figure:
    """Return the error of the map of a drive alone."""
    error = _error(folder, _mapped_alone(folder, drive, progress), drive)
    return Figure.exact(100 * _rmse(error), "cm")


def _mapped_alone(folder: Path, drive: int, progress: Callable[[str], None]) -> Path:
    """Return the folder of the map of a drive alone, which is made where it is not whole."""
    out = folder / f"alone-{drive}"
    if not out.exists():
        progress(f"mapping drive {drive} alone")
        part = folder / f"alone-{drive}.part"
        shutil.rmtree(part, ignore_errors=True)
        run_command("map", folder / f"{drive}.log", "-o", part)
        part.rename(out)
    return out


def _growth(rows: Sequence[Row]) -> Row:
    """Return size and cost after the last drive over those once settled, and error over the first.

    Single runs are noisy, the times by the machine and the errors by the drive: the mean time of
    all later drives is compared, too, and their mean error with that of maps of each drive alone.
    """
    settled, last = rows[min(SETTLED_AFTER, len(rows)) - 1].figures, rows[-1].figures
    names = ("file", "peak memory", "time a node")
    figures = {name: Figure(last[name].value / settled[name].value) for name in names}
    times = [row.figures["time a node"].value for row in rows[SETTLED_AFTER - 1 :]]
    if times:
        figures["mean time a node"] = Figure(float(np.mean(times)) / times[0])
    first = rows[0].figures["error"].value
    figures["error over the first"] = Figure.exact(last["error"].value / first)
    later = [row.figures for row in rows[1:]]
    if later:
        in_map, alone = (
            float(np.mean([each[name].value for each in later]))
            for name in ("error of this drive", ALONE)
        )
        figures["mean error over drives alone"] = Figure.exact(in_map / alone)
    return Row({"drive": "last / third"}, figures)


def _rmse(error: TrajectoryError) -> float:
    """Return the root mean square of the distances [m]."""
    return float(np.sqrt(np.mean(error.absolute.translation**2)))


def _truth(folder: Path, drives: int) -> Trajectory:
    parts = [read_tum(folder / f"{drive}.tum") for drive in range(1, drives + 1)]
    return Trajectory(
        np.concatenate([part.stamps for part in parts]),
        np.concatenate([part.poses for part in parts]),
    )


def _error(folder: Path, out: Path, drives: int, since: float = 0.0) -> TrajectoryError:
    """Return the error of the scans of a map from a stamp on."""
    mapped = read_tum(out / "trajectory.tum")
    own = mapped.stamps >= since - 1e-3
    estimate = Trajectory(mapped.stamps[own], mapped.poses[own])
    return evaluate_trajectory(estimate, _truth(folder, drives))


def _moved(folder: Path, error: TrajectoryError) -> float:
    """Return how far the map frame is from where it was after the first drive [m]."""
    first = _error(folder, folder / "map-1", 1).tf_truth_estimate
    x, y, _ = compose(inverse(first), error.tf_truth_estimate)
    return float(np.hypot(x, y))


def _furniture(folder: Path, options: LifelongOptions, progress: Callable[[str], None]) -> Row:
    """Return how much of the furniture of the last drive the map shows, and of that of the first.

    What counts is what a map of that drive alone shows, and what stands alone: nothing else was
    near it on the other drive. Furniture of the first drive in places that no later drive saw stays
    on the map; it counts where the last drive that looked saw nothing in its place. There the map
    may still show what a drive in between saw: places where none drew anything count once more. The
    walls that stood on all drives show what it costs.
    """
    drives = options.drives
    first, last = (_Visit(folder, options.seed, drive, progress) for drive in (1, drives))
    final = load_map(folder / f"map-{drives}")
    tf_final = _error(folder, folder / f"map-{drives}", drives).tf_truth_estimate

    def shown(places: FloatArray) -> Figure:
        return Figure.exact(100 * float(_is_drawn(final, tf_final, places).mean()), "%")

    gone, walls = _points(first.furniture), _points(first.walls, _WALL_SPACING_M)
    gone = gone[last.is_clear(gone)]
    gone = gone[first.drew(gone)]
    again, seen_empty = gone[last.saw(gone)], np.zeros(len(gone), dtype=bool)
    left, undrawn = np.ones(len(gone), dtype=bool), np.ones(len(gone), dtype=bool)
    stands, drawn = np.ones(len(walls), dtype=bool), first.drew(walls)
    for drive in range(drives, 1, -1):
        visit = last if drive == drives else _Visit(folder, options.seed, drive, progress)
        looked = left & visit.saw(gone)
        seen_empty |= looked & visit.is_clear(gone)
        left &= ~looked
        undrawn &= ~visit.drew(gone)
        stands &= visit.has_walls(walls)
        drawn |= visit.drew(walls)
    new = _points(last.furniture)
    new = new[first.is_clear(new)]
    new = new[last.drew(new)]
    figures = {
        "furniture of the last drive shown": replace(shown(new), better="more"),
        "furniture of the first drive shown": shown(gone),
        "of that, where the last drive looked": shown(again),
        "where any later drive looked": shown(gone[seen_empty]),
        "and none drew anything since": shown(gone[seen_empty & undrawn]),
        "places any later drive looked at": Figure.exact(100 * float(seen_empty.mean()), "%"),
        "standing walls shown": replace(shown(walls[stands & drawn]), better="more"),
    }
    return Row({"drive": "furniture"}, figures)


class _Visit:
    """A drive mapped by itself, and what stood in the building then.

    Parameters
    ----------
    folder : with the recording of the drive and its truth.
    seed, drive : of the building.
    """

    def __init__(
        self, folder: Path, seed: int, drive: int, progress: Callable[[str], None]
    ) -> None:
        from cartoloop.simulation import make_world

        world, out = make_world("office", seed, drive), _mapped_alone(folder, drive, progress)
        self.furniture, self.walls = world.furniture, world.walls
        self._map = load_map(out)
        estimate, truth = read_tum(out / "trajectory.tum"), read_tum(folder / f"{drive}.tum")
        self._tf_truth_map = evaluate_trajectory(estimate, truth).tf_truth_estimate

    def is_clear(self, places: FloatArray) -> BoolArray:
        """Return where nothing stood near then."""
        clear: BoolArray = _distances(places, self.walls) > APART_M
        return clear

    def has_walls(self, places: FloatArray) -> BoolArray:
        """Return where a wall or furniture stood then."""
        stood: BoolArray = _distances(places, self.walls) < _STANDS_WITHIN_M
        return stood

    def drew(self, places: FloatArray) -> BoolArray:
        """Return which places the map of the drive shows as walls."""
        return _is_drawn(self._map, self._tf_truth_map, places)

    def saw(self, places: FloatArray) -> BoolArray:
        """Return which places were observed then."""
        return _is_seen(self._map, self._tf_truth_map, places)


def _points(segments: FloatArray, spacing: float = _POINT_SPACING_M) -> FloatArray:
    """Return places along segments, shape (n, 2) [m]."""
    counts = np.ceil(np.hypot(*(segments[:, 2:] - segments[:, :2]).T) / spacing)
    return np.concatenate(
        [
            np.linspace(segment[:2], segment[2:], max(int(count), 2))
            for segment, count in zip(segments, counts, strict=True)
        ]
    )


def _distances(points: FloatArray, segments: FloatArray) -> FloatArray:
    """Return the distance from each point to the nearest segment, shape (n,) [m]."""
    begin, along = segments[:, :2], segments[:, 2:] - segments[:, :2]
    length = np.maximum((along**2).sum(axis=1), 1e-12)
    found = np.empty(len(points))
    for first in range(0, len(points), 500):
        offset = points[first : first + 500, None] - begin
        share = np.clip((offset * along).sum(axis=2) / length, 0.0, 1.0)
        apart = np.linalg.norm(offset - share[..., None] * along, axis=2)
        found[first : first + 500] = apart.min(axis=1)
    return found


def _cells(
    result: Result, tf_truth_map: Pose, points: FloatArray
) -> tuple[OccupancyMap, FloatArray]:
    """Return the map, and places of the world as its rows and columns."""
    occupancy = result.occupancy_map()
    inside = transform_points(inverse(tf_truth_map), points)
    corner = np.array((occupancy.origin_x, occupancy.origin_y))
    return occupancy, np.floor((inside - corner) / occupancy.resolution)[:, ::-1]


def _near(
    result: Result, tf_truth_map: Pose, points: FloatArray, reach: int, above: float
) -> BoolArray:
    """Return which places have a cell of more than a probability within `reach` cells."""
    occupancy, cells = _cells(result, tf_truth_map, points)
    shape = np.array(occupancy.probability.shape)
    found = np.zeros(len(points), dtype=bool)
    for row in range(-reach, reach + 1):
        for col in range(-reach, reach + 1):
            place = (cells + np.array((row, col))).astype(np.int64)
            inside = ((place >= 0) & (place < shape)).all(axis=1)
            found[inside] |= occupancy.probability[tuple(place[inside].T)] > above
    return found


def _is_drawn(result: Result, tf_truth_map: Pose, points: FloatArray) -> BoolArray:
    """Return which places of the world are drawn as walls, shape (n,)."""
    reach = round(DRAWN_WITHIN_M / result.config.local_slam.submaps.resolution)
    occupied = result.config.map_output.occupied_thresh
    return _near(result, tf_truth_map, points, reach, occupied)


def _is_seen(result: Result, tf_truth_map: Pose, points: FloatArray) -> BoolArray:
    """Return which places of the world were observed, shape (n,)."""
    return _near(result, tf_truth_map, points, 0, -0.5)
