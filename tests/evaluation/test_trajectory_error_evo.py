# SPDX-License-Identifier: Apache-2.0
"""ATE and RPE are those of the tool evo, which is run, never imported."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from cartoloop.evaluation.trajectories import read_tum
from cartoloop.evaluation.trajectory_error import evaluate_trajectory
from tests.limits import LIMIT_S

pytestmark = pytest.mark.slow

STATISTICS = ("rmse", "mean", "median", "std", "min", "max")


def command(name):
    found = shutil.which(name, path=str(Path(sys.executable).parent)) or shutil.which(name)
    if found is None:
        pytest.skip(f"{name} is not installed: pip install 'cartoloop[oracles]'")
    return found


def tum_lines(stamps, poses):
    return "".join(
        f"{stamp:.6f} {x:.9f} {y:.9f} 0 0 0 {np.sin(theta / 2):.9f} {np.cos(theta / 2):.9f}\n"
        for stamp, (x, y, theta) in zip(stamps, poses, strict=True)
    )


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A walk, and what an estimate with noise, drift, gaps and inexact stamps makes of it."""
    folder = tmp_path_factory.mktemp("walk")
    rng = np.random.default_rng(4)
    num = 400
    stamps = 1.7e9 + 0.1 * np.arange(num)
    speed = np.where(np.arange(num) % 100 < 80, 0.07, 0.0) * rng.uniform(0.5, 1.5, num)
    theta = np.cumsum(rng.normal(0.0, 0.05, num)) + 3.0
    truth = np.column_stack(
        (np.cumsum(speed * np.cos(theta)), np.cumsum(speed * np.sin(theta)), theta)
    )
    drift = np.cumsum(rng.normal(0.0, (0.003, 0.003, 0.002), (num, 3)), axis=0)
    estimate = truth + drift + rng.normal(0.0, (0.01, 0.01, 0.005), (num, 3))
    cos, sin = np.cos(0.7), np.sin(0.7)
    estimate[:, :2] = estimate[:, :2] @ np.array([[cos, sin], [-sin, cos]]) + (12.0, -3.0)
    estimate[:, 2] += 0.7
    estimate_stamps = stamps + rng.uniform(-0.012, 0.012, num)
    kept = rng.random(num) > 0.2
    kept[150:170] = False
    in_truth = rng.random(num) > 0.05
    (folder / "truth.tum").write_text(tum_lines(stamps[in_truth], truth[in_truth]))
    (folder / "estimate.tum").write_text(tum_lines(estimate_stamps[kept], estimate[kept]))
    return folder


def run_evo(name, truth, estimate, options, tmp_path):
    """Return the statistics that evo finds."""
    result = tmp_path / "result.zip"
    environment = {**os.environ, "HOME": str(tmp_path), "MPLCONFIGDIR": str(tmp_path / "mpl")}
    done = subprocess.run(
        [command(name), "tum", str(truth), str(estimate), *options, "--save_results", str(result)],
        env=environment,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        timeout=LIMIT_S,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    with zipfile.ZipFile(result) as archive:
        return json.loads(archive.read("stats.json"))


def assert_same(ours, evos):
    assert {name: ours[name] for name in STATISTICS} == pytest.approx(
        {name: evos[name] for name in STATISTICS}, abs=1e-6, rel=1e-6
    )


@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize(
    ("part", "options"), [("translation", []), ("rotation_deg", ["-r", "angle_deg"])]
)
def test_absolute_error_is_evos(files, tmp_path, part, options, swapped):
    names = ["truth.tum", "estimate.tum"]
    truth, estimate = (files / name for name in (reversed(names) if swapped else names))

    evos = run_evo("evo_ape", truth, estimate, ["-a", *options], tmp_path)

    error = evaluate_trajectory(read_tum(estimate), read_tum(truth))
    assert_same(error.to_dict()["ate"][part], evos)


def test_absolute_error_without_alignment_is_evos(files, tmp_path):
    truth, estimate = files / "truth.tum", files / "estimate.tum"

    evos = run_evo("evo_ape", truth, estimate, ["--t_max_diff", "0.004"], tmp_path)

    error = evaluate_trajectory(
        read_tum(estimate), read_tum(truth), aligned=False, max_difference=0.004
    )
    assert_same(error.to_dict()["ate"]["translation"], evos)


@pytest.mark.parametrize("part", ["translation", "rotation_deg"])
@pytest.mark.parametrize(
    ("ours", "evo_options"),
    [
        ({}, ["-d", "1", "-u", "m", "--all_pairs"]),
        ({"all_pairs": False}, ["-d", "1", "-u", "m"]),
        ({"delta": 5, "delta_unit": "frames"}, ["-d", "5", "-u", "f", "--all_pairs"]),
        (
            {"delta": 0.4, "pairs_from": "truth"},
            ["-d", "0.4", "-u", "m", "--all_pairs", "--pairs_from_reference"],
        ),
    ],
    ids=["metres", "consecutive", "frames", "along-truth"],
)
def test_relative_error_is_evos(files, tmp_path, part, ours, evo_options):
    truth, estimate = files / "truth.tum", files / "estimate.tum"
    options = evo_options + (["-r", "angle_deg"] if part == "rotation_deg" else [])

    evos = run_evo("evo_rpe", truth, estimate, options, tmp_path)

    error = evaluate_trajectory(read_tum(estimate), read_tum(truth), **ours)
    assert_same(error.to_dict()["rpe"][part], evos)
