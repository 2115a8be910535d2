# SPDX-License-Identifier: Apache-2.0
"""The pictures of the report, drawn into the folder of each map."""

from __future__ import annotations

from pathlib import Path

from cartoloop.evaluation.closure_plots import closures_plot
from cartoloop.evaluation.finished_run import read_run
from cartoloop.evaluation.lines import LinesError
from cartoloop.evaluation.lines_picture import draw_lines, write_picture
from cartoloop.evaluation.map_image import read_map
from cartoloop.evaluation.plots import ErrorSeries, TrajectoryLine, error_histogram, trajectory_plot
from cartoloop.evaluation.relations import RelationsError
from cartoloop.evaluation.trajectories import read_tum
from cartoloop.evaluation.trajectory_error import TrajectoryError
from cartoloop.map_output.save import write_file

PICTURES = {
    "map.png": "map",
    "trajectory.png": "trajectory",
    "errors.png": "errors",
    "closures.png": "loop closures and their residuals",
    "lines.png": "lines measured in the map",
}
"""Pictures of a map with their captions, in the order of the report."""


def draw_map_pictures(folder: Path) -> None:
    """Draw the loop closures of a map, and its trajectory before and after loop closure."""
    write_file(folder / "closures.png", closures_plot(read_run(folder)))
    lines = [
        TrajectoryLine("before loop closure", read_tum(folder / "local_trajectory.tum").poses),
        TrajectoryLine("cartoloop", read_tum(folder / "trajectory.tum").poses),
    ]
    write_file(folder / "trajectory.png", trajectory_plot(lines))


def draw_relations_errors(folder: Path, after: RelationsError, before: RelationsError) -> None:
    """Draw histograms of the errors of the relations."""
    series = [
        ErrorSeries("cartoloop", after.translations, after.rotations_deg),
        ErrorSeries("before loop closure", before.translations, before.rotations_deg),
    ]
    write_file(folder / "errors.png", error_histogram(series))


def draw_true_errors(folder: Path, after: TrajectoryError, before: TrajectoryError) -> None:
    """Draw histograms of the errors against the truth, and the trajectory over the true one."""
    series = [
        ErrorSeries(label, error.absolute.translation, error.absolute.rotation_deg)
        for label, error in (("cartoloop", after), ("before loop closure", before))
    ]
    write_file(folder / "errors.png", error_histogram(series))
    lines = [
        TrajectoryLine("truth", after.matched.truth, is_reference=True),
        TrajectoryLine("cartoloop", after.matched.estimate),
    ]
    write_file(folder / "trajectory.png", trajectory_plot(lines))


def draw_measured_lines(folder: Path, error: LinesError) -> None:
    """Draw the measured lines over the map."""
    write_picture(draw_lines(read_map(folder), error), folder / "lines.png")
