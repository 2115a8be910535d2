# SPDX-License-Identifier: Apache-2.0
"""Lines about the sessions of a map, and the exit status where some are apart."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import typer

from cartoloop.session import MAIN_PART

if TYPE_CHECKING:
    from cartoloop.map_data import MapData

APART_STATUS = 4
"""Exit status where a session found no place in the map."""


def show_sessions(result: MapData) -> None:
    """Print what was joined and what is apart, if the map is of several sessions."""
    if lines := session_lines(result):
        typer.echo("\n".join(lines))


def require_joined(result: MapData) -> None:
    """End the program with :data:`APART_STATUS` if a session is apart from the others."""
    if any(session.part != MAIN_PART for session in result.sessions):
        raise typer.Exit(APART_STATUS)


def session_lines(result: MapData) -> list[str]:
    """Return lines for the terminal: which sessions are joined, which not and why, what gave way.

    None of a map of one session.
    """
    lines = _part_lines(result) if len(result.sessions) > 1 else []
    if removed := result.report.extra.get("lifelong"):
        lines.append(
            f"{'seen again':<15}{removed['removed_submaps']} submaps and "
            f"{removed['removed_nodes']} nodes of before removed, {removed['faded_cells']} cells "
            "faded"
        )
    return lines


def _part_lines(result: MapData) -> list[str]:
    names = [session.name or f"session {i}" for i, session in enumerate(result.sessions)]
    apart = [i for i, session in enumerate(result.sessions) if session.part != MAIN_PART]
    count = len(names) - len(apart)
    lines = [f"{'sessions':<15}{count} of {len(names)} in one map"]
    for join in result.report.extra.get("joins", []):
        one, other = (_listed([names[i] for i in group]) for group in join["sessions"])
        if join["joined"]:
            lines.append(f"{'joined':<15}{other} to {one}: {_evidence(join)}")
        else:
            lines.append(f"{'apart':<15}{other} from {one}: {join['why_not']}")
    return lines


def _evidence(join: dict[str, Any]) -> str:
    return (
        f"{join['agreeing_scans']} scans agree, with an evidence of {join['evidence']:.2f} "
        f"(other places {join['rival_evidence']:.2f}); compared along {join['overlap_m']:.0f} m, "
        f"{join['contradicted_m']:.0f} m contradicted"
    )


def _listed(names: list[str]) -> str:
    shown = ", ".join(names[:3])
    return f"{shown} and {len(names) - 3} more" if len(names) > 3 else shown
