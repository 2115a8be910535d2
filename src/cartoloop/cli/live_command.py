# SPDX-License-Identifier: Apache-2.0
"""``cartoloop live``: a floor plan while the robot drives."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cartoloop.cli.options import (
    ConfigOption,
    DrawOption,
    ImuTopicOption,
    LaserPoseOption,
    OdomTopicOption,
    ScanTopicOption,
    SetOption,
    ThreadsOption,
    parse_layers,
    read_options,
    settings_with_threads,
)
from cartoloop.cli.view_command import PortOption, ViewOption, require_view


def live_command(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE",
            help="- (standard input), tcp://127.0.0.1:PORT, ws://127.0.0.1:PORT, ros2:, or a "
            "CARMEN log that is being written.",
        ),
    ],
    out: Annotated[Path, typer.Option("-o", "--out", metavar="OUT", help="Folder for the map.")],
    settings: SetOption = None,
    config: ConfigOption = None,
    threads: ThreadsOption = None,
    draw: DrawOption = "trajectory",
    host: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Listen to other machines, too: 0.0.0.0, or one address of this machine.",
        ),
    ] = None,
    poses: Annotated[
        str | None,
        typer.Option(metavar="FILE", help="Write the pose of each scan at once, as JSON; - shows."),
    ] = None,
    max_delay_ms: Annotated[
        float,
        typer.Option(min=0.0, max=10_000.0, help="A scan waits so long for late odometry."),
    ] = 50.0,
    end_after: Annotated[
        float | None,
        typer.Option(min=0.1, metavar="SECONDS", help="End when nothing has come for so long."),
    ] = None,
    no_drop: Annotated[
        bool,
        typer.Option("--no-drop", help="Hold up the source instead of dropping scans."),
    ] = False,
    scan_topics: ScanTopicOption = None,
    odom_topic: OdomTopicOption = None,
    imu_topic: ImuTopicOption = None,
    laser_pose: LaserPoseOption = None,
    view: ViewOption = False,
    view_host: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Serve the view to other machines, too."),
    ] = None,
    port: PortOption = None,
) -> None:
    """Map what a robot sends while it drives; docs/live.md tells what it has to send."""
    layers = parse_layers(draw)
    require_view(view, view_host=view_host, port=port)
    options = read_options(scan_topics, odom_topic, imu_topic, None, laser_pose, "first")

    from cartoloop.config_file import load_config

    loaded = load_config(config, settings_with_threads(settings, threads))

    from cartoloop.cli.live_mapping import LiveOptions, map_live
    from cartoloop.live.address import SourceOptions, make_source

    found = make_source(
        source,
        SourceOptions(host, tuple(scan_topics or ()), odom_topic, imu_topic),
    )
    map_live(
        found,
        loaded,
        out,
        LiveOptions(
            layers=layers,
            poses=poses,
            max_delay=1e-3 * max_delay_ms,
            end_after=end_after,
            waits=no_drop,
            laser_pose=options.laser_pose,
            view=view,
            view_host=view_host,
            view_port=port,
        ),
    )
