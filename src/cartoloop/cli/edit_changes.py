# SPDX-License-Identifier: Apache-2.0
"""``cartoloop edit OUT ...``: the commands that change a map."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cartoloop.cli.edit_group import DryRunOption, OutArgument
from cartoloop.cli.options import parse_pose_deg
from cartoloop.errors import ConfigError

if TYPE_CHECKING:
    from cartoloop.map_editing.change import Change
    from cartoloop.map_editing.editor import Editor
    from cartoloop.result import Result


def drop_command(
    out: OutArgument,
    closures: Annotated[
        list[int], typer.Argument(metavar="CLOSURE", help="Rows of closures.csv, from 0.")
    ],
    dry_run: DryRunOption = False,
) -> None:
    """Remove loop closures from the map."""
    _change(out, lambda editor: editor.drop_closures(*closures), dry_run=dry_run)


def add_command(
    out: OutArgument,
    submap: Annotated[int, typer.Argument(metavar="SUBMAP", help="Number of the submap.")],
    node: Annotated[int, typer.Argument(metavar="NODE", help="Number of the node.")],
    near: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,DEG",
            help="About where the node is in the map, with the submap where it is now [m, deg]; "
            "by default where it is now.",
        ),
    ] = None,
    in_submap: Annotated[
        bool, typer.Option("--in-submap", help="--near is in the frame of the submap.")
    ] = False,
    window: Annotated[
        tuple[float, float],
        typer.Option(metavar="M DEG", help="Radius and angle around it to search [m, deg]."),
    ] = (1.0, 15.0),
    dry_run: DryRunOption = False,
) -> None:
    """Add a loop closure: a node is matched to a submap near a rough pose.

    What does not fit as well as the closures that mapping finds is refused.
    """
    pose = parse_pose_deg(near, "--near")
    window_m, window_deg = window

    def change(editor: Editor[Result]) -> Change:
        return editor.add_closure(
            submap, node, pose, in_submap=in_submap, window_m=window_m, window_deg=window_deg
        )

    _change(out, change, dry_run=dry_run)


def pin_command(
    out: OutArgument,
    node: Annotated[int | None, typer.Option(metavar="N", help="Node to hold.")] = None,
    submap: Annotated[int | None, typer.Option(metavar="N", help="Submap to hold.")] = None,
    at: Annotated[
        str | None,
        typer.Option(metavar="X,Y,DEG", help="Pose [m, deg]; by default where it is now."),
    ] = None,
    dry_run: DryRunOption = False,
) -> None:
    """Hold a node or a submap at a pose; the first moves the whole map, further ones bend it."""
    if (node is None) == (submap is None):
        raise ConfigError("give one of --node N and --submap N")
    pose = parse_pose_deg(at, "--at")

    def change(editor: Editor[Result]) -> Change:
        if node is not None:
            return editor.pin_node(node, pose)
        return editor.pin_submap(-1 if submap is None else submap, pose)

    _change(out, change, dry_run=dry_run)


def control_points_command(
    out: OutArgument,
    file: Annotated[
        Path | None,
        typer.Argument(
            metavar="FILE", help="Lines 'x y X Y': in the map, and as surveyed [m]; # comments."
        ),
    ] = None,
    points: Annotated[
        list[str] | None,
        typer.Option("--point", metavar="X,Y=X,Y", help="One such point; can be repeated."),
    ] = None,
    dry_run: DryRunOption = False,
) -> None:
    """Move the whole map to two or more surveyed points, and print the residuals.

    It is moved and turned, but neither bent nor scaled.
    """
    rows = [_point(text) for text in points or []]
    if file is not None:
        from cartoloop.evaluation.text_table import read_table

        rows += read_table(file, "x y X Y")[0].tolist()
    if len(rows) < 2:
        raise ConfigError("give two or more points, as a FILE or with --point X,Y=X,Y")
    _change(out, lambda editor: editor.set_control_points(rows), dry_run=dry_run)


def align_command(out: OutArgument, dry_run: DryRunOption = False) -> None:
    """Turn the map about its origin so that most walls lie along its axes."""
    _change(out, lambda editor: editor.align(), dry_run=dry_run)


def forget_command(
    out: OutArgument,
    from_stamp: Annotated[
        float | None, typer.Option("--from", metavar="STAMP", help="First stamp of a span [s].")
    ] = None,
    to_stamp: Annotated[
        float | None, typer.Option("--to", metavar="STAMP", help="Last stamp of a span [s].")
    ] = None,
    area: Annotated[
        tuple[float, float, float, float] | None,
        typer.Option(metavar="X0 Y0 X1 Y1", help="Two corners of an area of the map [m]."),
    ] = None,
    session: Annotated[
        int | None,
        typer.Option(metavar="N", help="Only the scans of this session, or all of it."),
    ] = None,
    dry_run: DryRunOption = False,
) -> None:
    """Leave out the scans of a span of time or of a session, or what was seen in an area."""
    is_span = from_stamp is not None or to_stamp is not None
    if (is_span or session is not None) == (area is not None):
        raise ConfigError(
            "give either --from STAMP and --to STAMP, --session N, or --area X0 Y0 X1 Y1"
        )
    if is_span and (from_stamp is None or to_stamp is None):
        raise ConfigError("give both --from STAMP and --to STAMP")

    def change(editor: Editor[Result]) -> Change:
        if area is not None:
            return editor.forget_area(*area)
        if from_stamp is not None and to_stamp is not None:
            return editor.forget_time(from_stamp, to_stamp, session)
        return editor.forget_session(-1 if session is None else session)

    _change(out, change, dry_run=dry_run)


def split_command(
    out: OutArgument,
    session: Annotated[int, typer.Argument(metavar="SESSION", help="Number of the session.")],
    at: Annotated[float, typer.Option(metavar="STAMP", help="Where the second one begins [s].")],
    name: Annotated[str | None, typer.Option(metavar="NAME", help="Of the second session.")] = None,
    dry_run: DryRunOption = False,
) -> None:
    """Split a session in two."""
    _change(out, lambda editor: editor.split_session(session, at, name), dry_run=dry_run)


def rename_command(
    out: OutArgument,
    session: Annotated[int, typer.Argument(metavar="SESSION", help="Number of the session.")],
    name: Annotated[str, typer.Argument(metavar="NAME", help="The new name.")],
    dry_run: DryRunOption = False,
) -> None:
    """Give a session another name."""
    _change(out, lambda editor: editor.rename_session(session, name), dry_run=dry_run)


def undo_command(
    out: OutArgument,
    edit: Annotated[
        int | None,
        typer.Argument(metavar="[EDIT]", help="Number of the edit; by default the last one."),
    ] = None,
    dry_run: DryRunOption = False,
) -> None:
    """Undo an edit, whatever was edited after it."""
    _change(out, lambda editor: editor.undo(edit), dry_run=dry_run)


def redo_command(
    out: OutArgument,
    edit: Annotated[int, typer.Argument(metavar="EDIT", help="Number of the edit.")],
    dry_run: DryRunOption = False,
) -> None:
    """Put an edit that was undone in force again, at its place among the others."""
    _change(out, lambda editor: editor.redo(edit), dry_run=dry_run)


def _change(out: Path, change: Callable[[Editor[Result]], Change], *, dry_run: bool) -> None:
    """Edit a map, print what has changed, and save it."""
    from cartoloop.cli.mapping import compilation_notice
    from cartoloop.result import edit

    with compilation_notice():
        editor = edit(out)
        typer.echo(change(editor).text)
        if dry_run:
            typer.echo("nothing was changed (--dry-run)", err=True)
            return
        editor.save()
    typer.echo(f"  verdict {editor.map.report.quality.summary()}")


def _point(text: str) -> list[float]:
    try:
        place, surveyed = text.split("=")
        x, y = map(float, place.split(","))
        to_x, to_y = map(float, surveyed.split(","))
    except ValueError:
        raise typer.BadParameter(
            f"'{text}' is not X,Y=X,Y, like 0,0=103.2,-7.5 (m)", param_hint="--point"
        ) from None
    return [x, y, to_x, to_y]
