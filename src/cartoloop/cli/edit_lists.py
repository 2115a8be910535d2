# SPDX-License-Identifier: Apache-2.0
"""``cartoloop edit OUT list`` and ``closures``: what was edited, and what can be."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from cartoloop.cli.completion import complete_status
from cartoloop.cli.edit_group import OutArgument

if TYPE_CHECKING:
    from cartoloop.map_editing.closure_list import ClosureRow

JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON.")]


def list_command(out: OutArgument, as_json: JsonOption = False) -> None:
    """List the edits of a map with their numbers, and its sessions."""
    import json

    from cartoloop.result import edit

    editor = edit(out)
    edits = [
        {
            "edit": number,
            "what": what,
            "is_undone": one.is_undone,
            "kind": one.kind,
            "arguments": dict(one.arguments),
        }
        for number, (one, what) in enumerate(zip(editor.edits, editor.described(), strict=True))
    ]
    sessions: list[dict[str, Any]] = [
        {"session": number, "name": one.name, "stamp": one.stamp, "part": one.part}
        for number, one in enumerate(editor.map.sessions)
    ]
    if as_json:
        typer.echo(json.dumps({"edits": edits, "sessions": sessions}, indent=2))
        return
    for row in edits:
        undone = " (undone)" if row["is_undone"] else ""
        typer.echo(f"edit {row['edit']}: {row['what']}{undone}")
    if not edits:
        typer.echo("no edits")
    for row in sessions:
        apart = f", part {row['part']}, apart" if row["part"] else ""
        typer.echo(f"session {row['session']}: {row['name']}, from {row['stamp']:.3f}{apart}")


def closures_command(
    out: OutArgument,
    statuses: Annotated[
        list[str] | None,
        typer.Option(
            "--status",
            metavar="WORD",
            autocompletion=complete_status,
            help="Only those with this fate, such as final; can be repeated.",
        ),
    ] = None,
    submap: Annotated[
        int | None, typer.Option(metavar="N", help="Only those of this submap.")
    ] = None,
    node: Annotated[int | None, typer.Option(metavar="N", help="Only those of this node.")] = None,
    worst: Annotated[
        int | None,
        typer.Option(min=1, metavar="N", help="Only the N in the map that it disagrees with most."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """List the loop closures with fate and reason; 'cartoloop explain' explains one."""
    import json
    from dataclasses import asdict

    from cartoloop.map_editing.closure_list import closure_rows
    from cartoloop.result import load_map

    rows = closure_rows(
        load_map(out), statuses=statuses or (), submap=submap, node=node, worst=worst
    )
    if as_json:
        typer.echo(json.dumps([asdict(row) for row in rows], indent=2))
        return
    typer.echo(_HEADING)
    if rows:
        typer.echo("\n".join(map(_line, rows)))


_HEADING = (
    f"{'closure':>7} {'submap':>6} {'node':>6} {'score':>6} {'off by':>8} {'':>9} {'weight':>6}  "
    "fate"
)


def _line(row: ClosureRow) -> str:
    score = "" if row.score is None else f"{row.score:.3f}"
    metres = "" if row.residual_m is None else f"{row.residual_m:.3f} m"
    degrees = "" if row.residual_deg is None else f"{row.residual_deg:.2f} deg"
    weight = "" if row.weight is None else f"{row.weight:.2f}"
    fate = row.status.replace("_", " ")
    if row.reason:
        fate += f": {row.reason.replace('_', ' ')}"
    return (
        f"{row.number:>7} {row.submap:>6} {row.node:>6} {score:>6} {metres:>8} {degrees:>9} "
        f"{weight:>6}  {fate}"
    )
