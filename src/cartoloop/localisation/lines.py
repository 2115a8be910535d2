# SPDX-License-Identifier: Apache-2.0
"""Answers as lines of JSON, and the pose that is kept on disk between two runs."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from cartoloop.arguments import as_pose
from cartoloop.errors import InputError, UsageError
from cartoloop.localisation.answer import Answer
from cartoloop.map_output.unfinished_file import unfinished_file
from cartoloop.sensor.pose import Pose

POSE_FILE_TYPE = "cartoloop pose"
"""What a file with a kept pose says that it is."""

_MAX_POSE_FILE_BYTES = 10_000


class KeptPose(NamedTuple):
    """A pose as it was when a run ended.

    Attributes
    ----------
    tf_map_tracking : of the robot.
    tf_odom_tracking : the odometry's pose then, None without odometry.
    """

    tf_map_tracking: Pose
    tf_odom_tracking: Pose | None


def answer_content(answer: Answer, latency: float | None = None) -> dict[str, Any]:
    """Return an answer as the content of a line of JSON, as ``cartoloop locate`` writes it.

    Parameters
    ----------
    latency : from the arrival of the scan to the answer [s]; None for recordings.
    """
    content: dict[str, Any] = {
        "type": "pose",
        "stamp": answer.stamp,
        "state": answer.state.value,
        "local": _rounded(answer.tf_local_tracking),
        "map": None if answer.tf_map_tracking is None else _rounded(answer.tf_map_tracking),
        "covariance": None
        if answer.covariance is None
        else [float(f"{value:.6g}") for value in answer.covariance.ravel().tolist()],
        "score": _number(answer.score),
        "runner_up": _number(answer.runner_up),
        "agreement": _number(answer.agreement),
        "places": [
            {
                "map": _rounded(place.tf_map_tracking),
                "probability": _number(place.probability),
                "score": _number(place.score),
            }
            for place in answer.places
        ],
    }
    if latency is not None:
        content["latency_ms"] = round(1e3 * latency, 3)
    return content


def write_pose_file(path: Path, kept: KeptPose) -> None:
    """Write a pose to begin with next time, completely or not at all.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    odom = kept.tf_odom_tracking
    content = {
        "type": POSE_FILE_TYPE,
        "map": _rounded(kept.tf_map_tracking),
        "odometry": None if odom is None else _rounded(odom),
    }
    with unfinished_file(path) as unfinished:
        unfinished.write_text(json.dumps(content) + "\n", encoding="utf-8")


def read_pose_file(path: Path) -> KeptPose | None:
    """Return the pose that was kept, None where there is no such file.

    Raises
    ------
    InputError
        It is no file of a pose.
    """
    try:
        with path.open("rb") as file:
            content = json.loads(file.read(_MAX_POSE_FILE_BYTES))
        if not isinstance(content, dict) or content.get("type") != POSE_FILE_TYPE:
            raise ValueError
        return KeptPose(
            Pose(*as_pose(content["map"], "a pose")),
            None
            if content.get("odometry") is None
            else Pose(*as_pose(content["odometry"], "a pose")),
        )
    except FileNotFoundError:
        return None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except (ValueError, KeyError, TypeError, UsageError, RecursionError) as error:
        raise InputError(
            f"{path}: is no pose that 'cartoloop locate --keep' wrote; give another name, or "
            "remove it if it is of no use"
        ) from error


def _rounded(pose: Sequence[float]) -> list[float]:
    return [round(value, 6) for value in pose]


def _number(value: float) -> float | None:
    return round(value, 4) if math.isfinite(value) else None
