# SPDX-License-Identifier: Apache-2.0
"""What the doctor says: findings, worst first."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from cartoloop.readers.log import ProblemSeverity

Severity = Literal["error", "warning", "info"]

SEVERITIES: tuple[Severity, ...] = ("error", "warning", "info")

_OF_LOG: dict[ProblemSeverity, Severity] = {"error": "error", "warning": "warning", "note": "info"}


@dataclass(frozen=True, slots=True)
class Finding:
    """Something wrong or worth knowing.

    Attributes
    ----------
    severity : ``error``: it cannot be mapped, or a part is lost; ``warning``: the map may suffer;
        ``info``: worth knowing, and dealt with.
    code : short name of the kind of finding, the same in all recordings.
    message : what is wrong; one line.
    remedy : what to do, or what is done about it, or "".
    where : topic, kind of line or sensor that it is about, or "".
    count : how many times.
    time : stamp of the first (or worst) time, as recorded [s]; None where there is no one moment.
    """

    severity: Severity
    code: str
    message: str
    remedy: str = ""
    where: str = ""
    count: int = 1
    time: float | None = None


def of_log(severity: ProblemSeverity) -> Severity:
    """Return the doctor's word for a severity of the readers."""
    return _OF_LOG[severity]


def worst_first(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return the findings by severity, else as they came."""
    return tuple(sorted(findings, key=lambda finding: SEVERITIES.index(finding.severity)))


def from_message(severity: Severity, code: str, text: str, where: str = "") -> Finding:
    """Return the finding of a message of the form ``what is wrong; what to do``."""
    what, _, remedy = text.partition("; ")
    return Finding(severity, code, what, remedy, where)


def first_of(known: float | None, stamp: float) -> float:
    """Return the stamp [s] of the first of several moments, `known` if there was one before."""
    return stamp if known is None else known
