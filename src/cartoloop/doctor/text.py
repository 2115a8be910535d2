# SPDX-License-Identifier: Apache-2.0
"""An examination as text: what is in the recording, what would be made of it, what is wrong."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Iterator, Sequence

from cartoloop.doctor.clouds import CloudWatch
from cartoloop.doctor.contents import Contents, Stream
from cartoloop.doctor.examination import Examination, Scanner
from cartoloop.doctor.findings import SEVERITIES, Finding, Severity

Paint = Callable[[Severity, str], str]
"""Returns a text in the colour of a severity."""

MIN_WIDTH, MAX_WIDTH = 60, 110
_MAX_TRANSFORMS = 20


def render(examination: Examination, width: int = 100, paint: Paint = lambda _, text: text) -> str:
    """Return an examination as text.

    Parameters
    ----------
    width : of the lines, as far as names allow.
    paint : colours the severities.
    """
    width = min(max(width, MIN_WIDTH), MAX_WIDTH)
    parts = [_title(examination)]
    if examination.contents.streams:
        parts.append(["contents", *_streams(examination.contents, width)])
    if examination.contents.transforms:
        parts.append(["transforms", *_transforms(examination.contents)])
    parts += [[f"scanner {s.name}", *_indented(_scanner(s))] for s in examination.scanners]
    if examination.odometry is not None:
        parts.append(["odometry", *_indented(_odometry(examination))])
    if examination.imu is not None:
        parts.append(["imu", *_indented(_imu(examination))])
    if examination.choices:
        rows = [(c.what, c.value, c.why) for c in examination.choices]
        parts.append(["mapped with", *_table(rows, width)])
    parts.append(list(_findings(examination.findings, width, paint)))
    parts.append([_verdict(examination, paint)])
    return "\n\n".join("\n".join(part) for part in parts)


def _title(examination: Examination) -> list[str]:
    title = f"{examination.path.name}  {examination.contents.kind}"
    if not examination.scanners:
        return [title]
    num_scans = sum(scanner.watch.count for scanner in examination.scanners)
    title += f", {num_scans} scans, {_duration(examination.duration)}"
    if examination.odometry is not None:
        title += f", {examination.odometry.way:.0f} m by the odometry"
    return [title]


def _duration(seconds: float) -> str:
    if seconds < 120.0:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s"


def _streams(contents: Contents, width: int) -> Iterator[str]:
    looked_at = [s for s in contents.streams if s.role != "other"]
    rows = [
        (
            stream.name,
            stream.type.rsplit("/", 1)[-1],
            str(stream.count),
            f"{stream.times.rate:.3g} Hz" if stream.times else "",
            _use(stream),
        )
        for stream in looked_at
    ]
    yield from _table(rows, width, right=(2, 3))
    others = [f"{s.name} ({s.count})" for s in contents.streams if s.role == "other"]
    if others:
        text = "not used: " + ", ".join(others)
        yield from textwrap.wrap(text, width, initial_indent="  ", subsequent_indent="    ")


def _use(stream: Stream) -> str:
    frames = f" [{', '.join(stream.frames)}]" if stream.frames else ""
    if stream.role == "tf":
        return "transforms"
    return ("used: " if stream.used else "not used: ") + (stream.reason or "no need") + frames


def _transforms(contents: Contents) -> Iterator[str]:
    rows = []
    for t in contents.transforms[:_MAX_TRANSFORMS]:
        angles = ", ".join(f"{math.degrees(a) + 0.0:.1f}" for a in (t.roll, t.pitch, t.yaw))
        place = f"x {t.x:.3f}, y {t.y:.3f}, z {t.z:.3f} m, roll, pitch, yaw {angles} deg"
        moves = f", moves by up to {t.moved_m:.2f} m, {math.degrees(t.moved_rad):.0f} deg"
        still = t.moved_m < 1e-3 and t.moved_rad < 1e-3
        rows.append((f"{t.parent} -> {t.child}", t.origin, place + ("" if still else moves)))
    yield from _table(rows, MAX_WIDTH)
    if len(contents.transforms) > _MAX_TRANSFORMS:
        yield f"  and {len(contents.transforms) - _MAX_TRANSFORMS} more"


def _scanner(scanner: Scanner) -> list[str]:
    watch, profile = scanner.watch, scanner.profile
    if isinstance(watch, CloudWatch):
        return [
            f"points     {watch.num_points / max(watch.count, 1):.0f} a cloud",
            f"sweep      {1e3 * watch.sweep:.0f} ms" if watch.sweep else "sweep      no times",
        ]
    lines = profile.describe().splitlines()[:-1] if profile is not None else []
    values, total = watch.values, max(watch.values.total, 1)
    shares = {
        "measured": values.measured,
        "no return": values.no_return,
        "too near or 0": values.too_near,
        "NaN": values.nan,
        "negative": values.negative,
    }
    told = ", ".join(f"{100 * n / total:.3g}% {what}" for what, n in shares.items() if n)
    lines.append(f"beams are  {told}")
    if watch.geometry is not None:
        x, y, yaw = watch.geometry.tf_tracking_sensor
        lines.append(f"mounted    x {x:.3f}, y {y:.3f} m, yaw {math.degrees(yaw) + 0.0:.1f} deg")
    return lines


def _odometry(examination: Examination) -> list[str]:
    odometry, calibration = examination.odometry, examination.calibration
    if odometry is None:
        return []
    lines = [
        f"way        {odometry.way:.1f} m, turns of {math.degrees(odometry.turned):.0f} deg in all",
        f"fastest    {odometry.fastest:.2f} m/s, {math.degrees(odometry.fastest_turn):.0f} deg/s",
    ]
    if calibration is None:
        return lines
    model = calibration.model
    tried = f"{calibration.num_matched} of {calibration.num_scans} scans matched"
    if model.is_known:
        lines.append(
            f"to scans   {model.time_offset:+.2f} s, turns x {model.rotation_scale:.3f}, "
            f"distances x {model.translation_scale:.3f} ({tried})"
        )
    else:
        lines.append(f"to scans   too little motion to tell ({tried})")
    return lines


def _imu(examination: Examination) -> list[str]:
    imu = examination.imu
    if imu is None:
        return []
    return [
        f"gravity    {imu.mean_size:.2f} m/s^2 on average ({imu.lowest:.2f} to {imu.highest:.2f}), "
        f"{math.degrees(imu.tilt):.1f} deg off the z axis",
        f"fastest    {math.degrees(imu.fastest_turn):.0f} deg/s",
    ]


def _findings(findings: Sequence[Finding], width: int, paint: Paint) -> Iterator[str]:
    if not findings:
        yield "findings: none"
        return
    counts = {s: sum(f.severity == s for f in findings) for s in SEVERITIES}
    told = ((n, s if n == 1 or s == "info" else f"{s}s") for s, n in counts.items() if n)
    yield "findings: " + ", ".join(f"{n} {what}" for n, what in told)
    indent = " " * 11
    for finding in findings:
        is_named = finding.where in finding.message  # as the empty name is, too
        where = "" if is_named else f"{finding.where}: "
        when = f" (stamp {finding.time:.6f})" if finding.time is not None else ""
        text = textwrap.wrap(where + finding.message + when, width - len(indent))
        remedy = textwrap.wrap(finding.remedy, width - len(indent) - 3) if finding.remedy else []
        yield f"  {paint(finding.severity, f'{finding.severity:9}')}{text[0]}"
        yield from (indent + line for line in text[1:])
        for number, line in enumerate(remedy):
            yield indent + ("-> " if number == 0 else "   ") + line


def _verdict(examination: Examination, paint: Paint) -> str:
    if not examination.can_be_mapped:
        return paint("error", "it cannot be mapped")
    return f"it can be mapped: cartoloop map {examination.path} -o OUT"


def _indented(lines: Sequence[str]) -> list[str]:
    return [f"  {line}" for line in lines]


def _table(rows: Sequence[Sequence[str]], width: int, right: Sequence[int] = ()) -> Iterator[str]:
    """Yield aligned rows; the last column is wrapped."""
    if not rows:
        return
    num = len(rows[0]) - 1
    widths = [max(len(row[column]) for row in rows) for column in range(num)]
    start = 2 + sum(widths) + 2 * num
    for row in rows:
        cells = [
            row[c].rjust(widths[c]) if c in right else row[c].ljust(widths[c]) for c in range(num)
        ]
        text = textwrap.wrap(row[num], max(width - start, 30)) or [""]
        yield ("  " + "  ".join([*cells, text[0]])).rstrip()
        yield from (" " * start + line for line in text[1:])
