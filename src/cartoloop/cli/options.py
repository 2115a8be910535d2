# SPDX-License-Identifier: Apache-2.0
"""Options that several commands share."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from cartoloop.map_output.picture import Layer
    from cartoloop.readers.read_options import ReadOptions
    from cartoloop.sensor.pose import Pose

SetOption = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Set a parameter; see 'config show'."),
]
ConfigOption = Annotated[
    Path | None, typer.Option("--config", metavar="FILE", help="Take parameters from a TOML file.")
]
ThreadsOption = Annotated[
    int | None,
    typer.Option(min=1, help="Background threads; the result does not depend on them."),
]
DrawOption = Annotated[
    str, typer.Option(help="What to draw over map.png: trajectory, closures, or none.")
]

ScanTopicOption = Annotated[
    list[str] | None,
    typer.Option(
        "--scan-topic", metavar="TOPIC", help="Scanner of a bag to use; may be given repeatedly."
    ),
]
OdomTopicOption = Annotated[
    str | None,
    typer.Option("--odom-topic", metavar="TOPIC", help="Odometry of a bag to use, or none."),
]
ImuTopicOption = Annotated[
    str | None, typer.Option("--imu-topic", metavar="TOPIC", help="IMU of a bag to use, or none.")
]
UrdfOption = Annotated[
    Path | None,
    typer.Option(
        "--urdf", metavar="FILE", help="Where the robot's sensors sit, if a bag omits it."
    ),
]
LaserPoseOption = Annotated[
    str | None,
    typer.Option(
        "--laser-pose",
        metavar="X,Y,YAW",
        help="Where the scanner sits on the robot (m, rad), whatever is recorded.",
    ),
]
EchoOption = Annotated[
    str, typer.Option("--echo", help="Echo of scanners that send several: first or strongest.")
]


def read_options(
    scan_topics: list[str] | None,
    odom_topic: str | None,
    imu_topic: str | None,
    urdf: Path | None,
    laser_pose: str | None,
    echo: str,
) -> ReadOptions:
    """Return what the user says about a recording.

    Raises
    ------
    typer.BadParameter
        An option has no such value.
    """
    from cartoloop.readers.read_options import ReadOptions

    if echo not in ("first", "strongest"):
        raise typer.BadParameter(
            f"there is no echo '{echo}'; choose first or strongest", param_hint="--echo"
        )
    return ReadOptions(
        scan_topics=tuple(scan_topics or ()),
        odom_topic=odom_topic,
        imu_topic=imu_topic,
        urdf=urdf,
        laser_pose=_parse_pose(laser_pose),
        echo="first" if echo == "first" else "strongest",
    )


def _parse_pose(text: str | None) -> Pose | None:
    if text is None:
        return None
    from cartoloop.sensor.pose import Pose

    try:
        values = [float(word) for word in text.split(",")]
    except ValueError:
        values = []
    if len(values) != 3 or not all(map(math.isfinite, values)):
        raise typer.BadParameter(
            f"'{text}' is not X,Y,YAW, like 0.2,0,3.14 (m, rad)", param_hint="--laser-pose"
        )
    return Pose(*values)


def settings_with_threads(settings: list[str] | None, threads: int | None) -> list[str]:
    """Return the settings, that of the threads among them."""
    given = [] if threads is None else [f"global_slam.num_threads={threads}"]
    return [*(settings or []), *given]


def parse_layers(text: str) -> tuple[Layer, ...]:
    """Return the layers named in a list with commas, the lowest first.

    Raises
    ------
    typer.BadParameter
        There is no layer of such a name.
    """
    from cartoloop.map_output.picture import LAYERS

    names = {name.strip() for name in text.split(",")} - {"none", ""}
    if unknown := sorted(names.difference(LAYERS)):
        raise typer.BadParameter(
            f"cannot draw '{unknown[0]}'; choose from {', '.join(LAYERS)}, none",
            param_hint="--draw",
        )
    return tuple(layer for layer in LAYERS if layer in names)
