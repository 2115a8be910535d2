# SPDX-License-Identifier: Apache-2.0
"""Options that several commands share."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cartoloop.cli.completion import complete_echo, complete_key, complete_layers

if TYPE_CHECKING:
    from cartoloop.config_file import LoadedConfig
    from cartoloop.live.message_loop import MessageOptions
    from cartoloop.live.source import Source
    from cartoloop.map_output.picture import Layer
    from cartoloop.readers.read_options import ReadOptions
    from cartoloop.sensor.pose import Pose

CONFIGURATION = "Configuration"
RECORDING = "Recording"
MESSAGES = "Messages"
VIEW = "View"
"""Groups of options in the help."""

SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        autocompletion=complete_key,
        help="Set a parameter; may be repeated. 'config show' lists all.",
        rich_help_panel=CONFIGURATION,
    ),
]
ConfigOption = Annotated[
    Path | None,
    typer.Option(
        "--config",
        metavar="FILE",
        help="Read parameters from a TOML file.",
        rich_help_panel=CONFIGURATION,
    ),
]
ThreadsOption = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        min=1,
        help="Background threads for loop closure; the result does not depend on it.",
        rich_help_panel=CONFIGURATION,
    ),
]
ScanTopicOption = Annotated[
    list[str] | None,
    typer.Option(
        "--scan-topic",
        metavar="TOPIC",
        help="Scanner topic of a bag to use; may be repeated.",
        rich_help_panel=RECORDING,
    ),
]
OdomTopicOption = Annotated[
    str | None,
    typer.Option(
        "--odom-topic",
        metavar="TOPIC",
        help="Odometry topic of a bag to use, or none.",
        rich_help_panel=RECORDING,
    ),
]
ImuTopicOption = Annotated[
    str | None,
    typer.Option(
        "--imu-topic",
        metavar="TOPIC",
        help="IMU topic of a bag to use, or none.",
        rich_help_panel=RECORDING,
    ),
]
LaserPoseOption = Annotated[
    str | None,
    typer.Option(
        "--laser-pose",
        metavar="X,Y,YAW",
        help="Pose of the scanner on the robot [m, m, rad], instead of the recorded one.",
        rich_help_panel=RECORDING,
    ),
]


@dataclass(frozen=True, kw_only=True)
class ConfigOptions:
    """Options that give the configuration."""

    settings: SetOption = None
    config: ConfigOption = None
    threads: ThreadsOption = None

    def load(self) -> LoadedConfig:
        """Return the configuration.

        Raises
        ------
        ConfigError
            A key is unknown, or a value impossible.
        """
        from cartoloop.config_file import load_config

        return load_config(self.config, settings_with_threads(self.settings, self.threads))


@dataclass(frozen=True, kw_only=True)
class SensorOptions:
    """Options that choose the sensors of a recording or a robot."""

    scan_topics: ScanTopicOption = None
    odom_topic: OdomTopicOption = None
    imu_topic: ImuTopicOption = None
    laser_pose: LaserPoseOption = None


@dataclass(frozen=True, kw_only=True)
class LiveSourceOptions(SensorOptions):
    """Options for the messages of a live source."""

    source_host: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Accept messages of other machines, too: listen at 0.0.0.0, or at one address of "
            "this machine.",
            rich_help_panel=MESSAGES,
        ),
    ] = None
    max_delay_ms: Annotated[
        float,
        typer.Option(
            metavar="MS",
            min=0.0,
            max=10_000.0,
            help="How long a scan waits for late odometry [ms].",
            rich_help_panel=MESSAGES,
        ),
    ] = 50.0
    end_after: Annotated[
        float | None,
        typer.Option(
            min=0.1,
            metavar="SECONDS",
            help="End when no message has arrived for this time [s].",
            rich_help_panel=MESSAGES,
        ),
    ] = None
    no_drop: Annotated[
        bool,
        typer.Option(
            "--no-drop",
            help="Hold up the source instead of dropping scans.",
            rich_help_panel=MESSAGES,
        ),
    ] = False

    def make_source(self, address: str) -> Source:
        """Return the source of an address, not opened yet.

        Raises
        ------
        InputError
            There is no such source.
        """
        from cartoloop.live.address import SourceOptions, make_source

        topics = tuple(self.scan_topics or ())
        return make_source(
            address, SourceOptions(self.source_host, topics, self.odom_topic, self.imu_topic)
        )

    def message_options(self) -> MessageOptions:
        """Return how the messages are treated.

        Raises
        ------
        typer.BadParameter
            The pose of the scanner is none.
        """
        from cartoloop.live.message_loop import MessageOptions

        return MessageOptions(
            max_delay=1e-3 * self.max_delay_ms,
            end_after=self.end_after,
            waits=self.no_drop,
            laser_pose=parse_pose(self.laser_pose),
        )


@dataclass(frozen=True, kw_only=True)
class ReadingOptions(SensorOptions):
    """Options for reading a recording."""

    urdf: Annotated[
        Path | None,
        typer.Option(
            "--urdf",
            metavar="FILE",
            help="Robot description with the sensors' mounting, if a bag has none.",
            rich_help_panel=RECORDING,
        ),
    ] = None
    echo: Annotated[
        str,
        typer.Option(
            "--echo",
            metavar="NAME",
            autocompletion=complete_echo,
            help="Which echo of multi-echo scanners to use: first or strongest.",
            rich_help_panel=RECORDING,
        ),
    ] = "first"

    def read_options(self) -> ReadOptions:
        """Return the options for the readers.

        Raises
        ------
        typer.BadParameter
            An option has no such value.
        """
        from cartoloop.readers.read_options import ReadOptions

        if self.echo not in ("first", "strongest"):
            raise typer.BadParameter(
                f"there is no echo '{self.echo}'; choose first or strongest", param_hint="--echo"
            )
        return ReadOptions(
            scan_topics=tuple(self.scan_topics or ()),
            odom_topic=self.odom_topic,
            imu_topic=self.imu_topic,
            urdf=self.urdf,
            laser_pose=parse_pose(self.laser_pose),
            echo="first" if self.echo == "first" else "strongest",
        )


StrictOption = Annotated[
    bool, typer.Option("--strict", help="End with status 3 unless the map is good.")
]


OverwriteOption = Annotated[
    bool, typer.Option("--overwrite", help="Replace the map of another recording in the folder.")
]


@dataclass(frozen=True, kw_only=True)
class PictureLayers:
    """Options for the picture of the map."""

    draw: Annotated[
        str,
        typer.Option(
            metavar="LAYERS",
            autocompletion=complete_layers,
            help="Drawn over map.png: trajectory, closures, quality (with commas), or none.",
        ),
    ] = "trajectory,quality"

    @property
    def layers(self) -> tuple[Layer, ...]:
        """The layers to draw, the lowest first.

        Raises
        ------
        typer.BadParameter
            There is no layer of such a name.
        """
        from cartoloop.map_output.picture import LAYERS

        names = {name.strip() for name in self.draw.split(",")} - {"none", ""}
        if unknown := sorted(names.difference(LAYERS)):
            raise typer.BadParameter(
                f"cannot draw '{unknown[0]}'; choose from {', '.join(LAYERS)}, none",
                param_hint="--draw",
            )
        return tuple(layer for layer in LAYERS if layer in names)


@dataclass(frozen=True, kw_only=True)
class PictureOptions(PictureLayers):
    """Options for the picture of the map, the verdict on it, and the map that it replaces."""

    strict: StrictOption = False
    overwrite: OverwriteOption = False


@dataclass(frozen=True, kw_only=True)
class OutputOptions(PictureOptions):
    """Options for the output folder and the picture of the map."""

    out: Annotated[
        Path, typer.Option("-o", "--out", metavar="OUT", help="Folder for the map; is created.")
    ]


def parse_pose(text: str | None) -> Pose | None:
    """Return the pose of --laser-pose.

    Raises
    ------
    typer.BadParameter
        It is not three numbers.
    """
    if text is None:
        return None
    from cartoloop.sensor.pose import Pose

    x, y, yaw = _three_numbers(text, "X,Y,YAW, like 0.2,0,3.14 (m, rad)", "--laser-pose")
    if abs(yaw) > math.tau:
        raise typer.BadParameter(
            f"a yaw of {yaw:g} rad is more than a turn: give radians, like 3.14, not degrees",
            param_hint="--laser-pose",
        )
    return Pose(x, y, yaw)


def parse_pose_deg(text: str | None, option: str) -> Pose | None:
    """Return a pose in the map, as an option gives it: X,Y,DEG.

    Raises
    ------
    typer.BadParameter
        It is not three numbers.
    """
    if text is None:
        return None
    from cartoloop.sensor.pose import Pose, wrap_angle

    x, y, heading_deg = _three_numbers(text, "X,Y,DEG, like 4.5,-2,90 (m, m, degrees)", option)
    return Pose(x, y, wrap_angle(math.radians(heading_deg)))


def _three_numbers(text: str, form: str, option: str) -> tuple[float, float, float]:
    """Return three numbers with commas between them.

    Raises
    ------
    typer.BadParameter
        The text has not this form.
    """
    try:
        first, second, third = (float(word) for word in text.split(","))
    except ValueError:
        first = second = third = math.nan
    if not all(map(math.isfinite, (first, second, third))):
        raise typer.BadParameter(f"'{text}' is not {form}", param_hint=option)
    return first, second, third


def settings_with_threads(settings: list[str] | None, threads: int | None) -> list[str]:
    """Return the settings, with that of the threads."""
    given = [] if threads is None else [f"global_slam.num_threads={threads}"]
    return [*(settings or []), *given]


def folder_of_map(path: Path | None) -> Path | None:
    """Return the folder of a map that is given by its folder or its file."""
    return path.parent if path is not None and path.is_file() else path
