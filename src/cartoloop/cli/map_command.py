# SPDX-License-Identifier: Apache-2.0
"""``cartoloop map``: a recording to a floor plan."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cartoloop.cli.options import (
    ConfigOption,
    DrawOption,
    EchoOption,
    ImuTopicOption,
    LaserPoseOption,
    OdomTopicOption,
    ScanTopicOption,
    SetOption,
    ThreadsOption,
    UrdfOption,
    parse_layers,
    read_options,
    settings_with_threads,
)
from cartoloop.cli.view_command import (
    HostOption,
    PortOption,
    SpeedOption,
    ViewOption,
    open_view,
    require_view,
    wait_for_stop,
)
from cartoloop.readers.formats import format_names

_LOG_HELP = (
    "Recording; several are parts of one, in order. Its format is recognised by its content: "
    f"{', '.join(format_names())}, or a format of an installed package."
)


def map_command(
    logs: Annotated[
        list[Path],
        typer.Argument(metavar="LOG", help=_LOG_HELP),
    ],
    out: Annotated[Path, typer.Option("-o", "--out", metavar="OUT", help="Folder for the map.")],
    settings: SetOption = None,
    config: ConfigOption = None,
    threads: ThreadsOption = None,
    draw: DrawOption = "trajectory",
    scan_topics: ScanTopicOption = None,
    odom_topic: OdomTopicOption = None,
    imu_topic: ImuTopicOption = None,
    urdf: UrdfOption = None,
    laser_pose: LaserPoseOption = None,
    echo: EchoOption = "first",
    view: ViewOption = False,
    host: HostOption = None,
    port: PortOption = None,
    speed: SpeedOption = None,
) -> None:
    """Map a recording: a text log, a ROS 1 bag or a ROS 2 recording."""
    layers = parse_layers(draw)
    require_view(view, host=host, port=port, speed=speed)
    options = read_options(scan_topics, odom_topic, imu_topic, urdf, laser_pose, echo)

    from cartoloop.config_file import load_config

    loaded = load_config(config, settings_with_threads(settings, threads))

    from cartoloop.cli.mapping import compilation_told, map_recording
    from cartoloop.readers import open_logs

    with compilation_told():
        log = open_logs(logs, options)
    typer.echo(log.description)
    if not view:
        map_recording(log, loaded, out, layers)
        return
    shown = open_view(log, loaded.config, host, port, speed)
    try:
        map_recording(log, loaded, out, layers, shown)
        if shown.failure is not None:
            typer.echo(f"warning: the view failed: {shown.failure}", err=True)
        else:
            wait_for_stop(f"view           {shown.url}")
    finally:
        shown.close()
