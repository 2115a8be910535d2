# SPDX-License-Identifier: Apache-2.0
"""An examination as text: contents, what would be mapped with what, findings."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from io import StringIO
from typing import TYPE_CHECKING

from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from cartoloop.doctor.clouds import CloudWatch
from cartoloop.doctor.findings import SEVERITIES, Finding, Severity
from cartoloop.plain_text import one_line

if TYPE_CHECKING:
    from cartoloop.doctor.contents import Contents, Stream
    from cartoloop.doctor.examination import Examination, Scanner
    from cartoloop.readers.ros.inventory import TransformSummary

MIN_WIDTH, MAX_WIDTH = 60, 110
"""Limits of the width [characters]: narrower tables cannot be read, nor longer lines."""

MIN_LAST_COLUMN = 30
"""Width [characters] to which the last column of a table is wrapped at least."""

MAX_TRANSFORMS = 20
"""Transforms that are listed; a robot with arms has hundreds."""

STYLES: dict[Severity, str] = {"error": "red", "warning": "yellow", "info": "cyan"}

Rows = Sequence[tuple[str, ...]]


def render(examination: Examination, width: int = 100, colours: bool = False) -> str:
    """Return an examination as text.

    Parameters
    ----------
    width : of the lines [characters], clipped to `MIN_WIDTH` and `MAX_WIDTH`.
    colours : whether severities are coloured, for terminals.
    """
    console = Console(
        file=StringIO(),
        width=min(max(width, MIN_WIDTH), MAX_WIDTH),
        force_terminal=colours,
        color_system="standard" if colours else None,
        highlight=False,
        markup=False,
        emoji=False,
        legacy_windows=False,
    )
    with console.capture() as captured:
        console.print(_title(examination))
        for heading, rows in _sections(examination):
            console.print(f"\n{heading}")
            console.print(_table(rows))
        console.print()
        _print_findings(console, examination.findings)
        console.print()
        if not examination.can_be_mapped:
            console.print(Text("it cannot be mapped", STYLES["error"]))
    lines = [line.rstrip() for line in captured.get().splitlines()]
    if examination.can_be_mapped:  # not wrapped, so that it can be copied
        lines.append(f"it can be mapped: cartoloop map {one_line(str(examination.path))} -o OUT")
    return "\n".join(lines)


def _sections(examination: Examination) -> Iterator[tuple[str, Rows]]:
    """Yield the heading and the rows of each section that has any."""
    contents = examination.contents
    if contents.streams:
        yield "contents", _streams(contents)
    if contents.transforms:
        rows = [_transform(t) for t in contents.transforms[:MAX_TRANSFORMS]]
        if len(contents.transforms) > MAX_TRANSFORMS:
            rows.append((f"and {len(contents.transforms) - MAX_TRANSFORMS} more", "", ""))
        yield "transforms", rows
    for scanner in examination.scanners:
        yield f"scanner {scanner.name}", _scanner(scanner)
    if examination.odometry is not None:
        yield "odometry", _odometry(examination)
    if examination.imu is not None:
        yield "imu", _imu(examination)
    if examination.choices:
        yield "mapped with", [(c.what, c.value, c.why) for c in examination.choices]


def _title(examination: Examination) -> str:
    title = f"{one_line(examination.path.name)}  {examination.contents.kind}"
    if not examination.scanners:
        return title
    num_scans = sum(scanner.watch.count for scanner in examination.scanners)
    title += f", {num_scans} scans, {_duration(examination.duration)}"
    if examination.odometry is not None:
        title += f", {examination.odometry.path_length:.0f} m by the odometry"
    return title


def _duration(seconds: float) -> str:
    if seconds < 120.0:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s"


def _streams(contents: Contents) -> Rows:
    rows = [
        (
            stream.name,
            stream.type.rsplit("/", 1)[-1],
            str(stream.count),
            f"{stream.times.rate:.3g} Hz" if stream.times else "",
            _use(stream),
        )
        for stream in contents.streams
        if stream.role != "other"
    ]
    others = [f"{s.name} ({s.count})" for s in contents.streams if s.role == "other"]
    if others:
        rows.append(("others", "", "", "", "not used: " + ", ".join(others)))
    return rows


def _use(stream: Stream) -> str:
    frames = f" [{', '.join(stream.frames)}]" if stream.frames else ""
    if stream.role == "tf":
        return "transforms"
    return ("used: " if stream.used else "not used: ") + (stream.reason or "not required") + frames


def _transform(transform: TransformSummary) -> tuple[str, str, str]:
    t = transform
    angles = ", ".join(f"{math.degrees(a) + 0.0:.1f}" for a in (t.roll, t.pitch, t.yaw))
    pose = f"x {t.x:.3f}, y {t.y:.3f}, z {t.z:.3f} m, roll, pitch, yaw {angles} deg"
    if t.moved_m >= 1e-3 or t.moved_rad >= 1e-3:
        pose += f", moves by up to {t.moved_m:.2f} m, {math.degrees(t.moved_rad):.0f} deg"
    return f"{t.parent} -> {t.child}", t.origin, pose


def _scanner(scanner: Scanner) -> Rows:
    watch, profile = scanner.watch, scanner.profile
    if isinstance(watch, CloudWatch):
        return [
            ("points", f"{watch.num_points / max(watch.count, 1):.0f} per cloud"),
            ("sweep", f"{1e3 * watch.sweep:.0f} ms" if watch.sweep else "no times"),
        ]
    rows: list[tuple[str, ...]] = []
    if profile is not None:
        for line in profile.describe().splitlines()[:-1]:
            name, _, value = line.partition(" ")
            rows.append((name, value.strip()))
    values, total = watch.values, max(watch.values.total, 1)
    shares = {
        "measured": values.measured,
        "no return": values.no_return,
        "too near or 0": values.too_near,
        "NaN": values.nan,
        "negative": values.negative,
    }
    shown = [f"{100 * n / total:.3g}% {what}" for what, n in shares.items() if n]
    rows.append(("values", ", ".join(shown)))
    if watch.geometry is not None:
        x, y, yaw = watch.geometry.tf_tracking_sensor
        rows.append(("mounting", f"x {x:.3f}, y {y:.3f} m, yaw {math.degrees(yaw) + 0.0:.1f} deg"))
    return rows


def _odometry(examination: Examination) -> Rows:
    odometry, calibration = examination.odometry, examination.calibration
    if odometry is None:
        return []
    path = f"{odometry.path_length:.1f} m, {math.degrees(odometry.turned):.0f} deg turned in total"
    speed = f"{odometry.fastest:.2f} m/s, {math.degrees(odometry.fastest_turn):.0f} deg/s"
    rows = [("path", path), ("max speed", speed)]
    if calibration is None:
        return rows
    model = calibration.model
    matched = f"{calibration.num_matched} of {calibration.num_scans} scans matched"
    relation = f"too little motion for an estimate ({matched})"
    if model.is_known:
        relation = (
            f"{model.time_offset:+.2f} s, turns x {model.rotation_scale:.3f}, "
            f"distances x {model.translation_scale:.3f} ({matched})"
        )
    return [*rows, ("to scans", relation)]


def _imu(examination: Examination) -> Rows:
    imu = examination.imu
    if imu is None:
        return []
    gravity = (
        f"{imu.mean_size:.2f} m/s^2 on average ({imu.lowest:.2f} to {imu.highest:.2f}), "
        f"{math.degrees(imu.tilt):.1f} deg off the z axis"
    )
    return [("gravity", gravity), ("max turn", f"{math.degrees(imu.fastest_turn):.0f} deg/s")]


def _table(rows: Rows) -> Padding:
    """Return aligned rows, indented; the last column is wrapped."""
    table = Table.grid(padding=(0, 2, 0, 0))
    for column in range(len(rows[0]) - 1):
        is_number = all(row[column][:1].isdigit() or not row[column] for row in rows)
        table.add_column(no_wrap=True, justify="right" if is_number else "left")
    table.add_column(overflow="fold", min_width=MIN_LAST_COLUMN)
    for row in rows:
        table.add_row(*map(Text, row))
    return Padding(table, (0, 0, 0, 2), expand=False)


def _print_findings(console: Console, findings: Iterable[Finding]) -> None:
    """Print each finding with its severity, and what to do about it."""
    table = Table.grid(padding=(0, 2, 0, 0))
    counts = dict.fromkeys(SEVERITIES, 0)
    for finding in findings:
        counts[finding.severity] += 1
        is_named = finding.where in finding.message  # as the empty name is, too
        where = "" if is_named else f"{finding.where}: "
        when = f" (stamp {finding.time:.6f})" if finding.time is not None else ""
        severity = Text(finding.severity, STYLES[finding.severity])
        table.add_row(severity, Text(where + finding.message + when))
        if finding.remedy:
            remedy = Table.grid(padding=(0, 1, 0, 0))
            remedy.add_row("->", Text(finding.remedy))
            table.add_row("", remedy)
    shown = [
        f"{n} {severity if n == 1 or severity == 'info' else f'{severity}s'}"
        for severity, n in counts.items()
        if n
    ]
    console.print(f"findings: {', '.join(shown) or 'none'}")
    if shown:
        console.print(Padding(table, (0, 0, 0, 2), expand=False))
