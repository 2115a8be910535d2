# SPDX-License-Identifier: Apache-2.0
"""``cartoloop info``: the facts of a finished map."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from cartoloop.map_output.map_facts import MapFacts
    from cartoloop.report import Report


@dataclass(frozen=True, kw_only=True)
class InfoOptions:
    """Options of ``cartoloop info``."""

    out: Annotated[
        Path, typer.Argument(metavar="OUT", help="Folder of a finished map, or its map.cartoloop.")
    ]
    as_json: Annotated[
        bool, typer.Option("--json", help="Print JSON: metres, seconds, degrees, bytes.")
    ] = False


def info_command(options: InfoOptions) -> None:
    """Show the facts of a finished map: size, way, sensor, verdict, files."""
    import json

    from cartoloop.cli.mapping import compilation_notice
    from cartoloop.cli.opened_map import open_map
    from cartoloop.map_output.map_facts import map_facts

    result = open_map(options.out)
    with compilation_notice():
        facts = map_facts(result)
    stamps = result.stamps.tolist()
    span = (stamps[0], stamps[-1]) if stamps else None
    if options.as_json:
        typer.echo(json.dumps(document(facts, result.report, options.out, span), indent=2))
    else:
        typer.echo(text(facts, result.report, options.out))


def text(facts: MapFacts, report: Report, out: Path) -> str:
    """Return the facts for the terminal, a line each."""
    from cartoloop.cli.progress import format_duration

    shown = dict(facts.described())
    extent = facts.extent
    if extent is not None:
        shown["extent"] += (
            f", x {extent.left:.1f} to {extent.right:.1f} m, "
            f"y {extent.bottom:.1f} to {extent.top:.1f} m"
        )
    shown["verdict"] = report.quality.summary() if facts.finished else shown["verdict"]
    skipped = ", ".join(f"{count} {reason}" for reason, count in sorted(report.skipped.items()))
    rows = {
        "recording": facts.name or "live",
        **shown,
        "duration": f"{format_duration(facts.duration_s)}, {facts.scans} scans",
        "sensor": "; ".join(_sensors(report)) or "not recorded in this file",
        "loop closures": str(facts.loop_closures),
        "edits": "; ".join(report.extra.get("edits", [])) or "none",
        "skipped": skipped or "nothing",
        "made by": f"cartoloop {report.version}, parameters {report.config_hash or 'unknown'}",
        "files": ", ".join(f"{name} ({_size(size)})" for name, size in _files(out).items()),
    }
    return "\n".join(f"{name:<19}{value}" for name, value in rows.items())


def document(
    facts: MapFacts, report: Report, out: Path, span: tuple[float, float] | None
) -> dict[str, Any]:
    """Return the facts as JSON holds them; `span`: first and last stamp [s]."""
    from dataclasses import asdict

    return asdict(facts) | {
        "stamps": span,
        "nodes": report.nodes,
        "submaps": report.submaps,
        "places": [asdict(place) for place in report.quality.places],
        "sensors": report.extra.get("sensors", []),
        "has_odometry": "odometry" in report.extra,
        "has_imu": "imu" in report.extra,
        "edits": report.extra.get("edits", []),
        "skipped": report.skipped,
        "version": report.version,
        "config_hash": report.config_hash,
        "files": _files(out),
    }


def _sensors(report: Report) -> list[str]:
    """Return a few words about each scanner, then about what else was recorded."""
    words = []
    for sensor in report.extra.get("sensors", []):
        name = f"{sensor['name']}: " if sensor["name"] else ""
        end = sensor["range_max_m"]
        ranges = "" if end is None else f", up to {end:.4g} m"
        if sensor["beams"] is None:
            words.append(f"{name}point clouds{ranges}")
        else:
            view = sensor["field_of_view_deg"]
            words.append(f"{name}{sensor['beams']} beams over {view:.4g} deg{ranges}")
    return words + [what for what in ("odometry", "imu") if words and what in report.extra]


def _files(out: Path) -> dict[str, int]:
    """Return the sizes of the files of a map [bytes], by name."""
    files = sorted(out.iterdir()) if out.is_dir() else [out]
    shown = [file for file in files if file.is_file() and not file.name.startswith(".")]
    return {file.name: file.stat().st_size for file in shown}


def _size(size: int) -> str:
    return f"{size / 1e6:.1f} MB" if size >= 1e6 else f"{max(1, round(size / 1e3))} kB"
