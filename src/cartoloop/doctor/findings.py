# SPDX-License-Identifier: Apache-2.0
"""Findings of an examination, worst first."""

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
    """A problem of a recording, or a fact worth knowing.

    Attributes
    ----------
    severity : ``error``: it cannot be mapped, or a part is lost; ``warning``: the map may suffer;
        ``info``: worth knowing, and handled.
    code : short name of the kind of finding, the same in all recordings.
    message : what is wrong; one line.
    remedy : what to do, or how it is handled, or "".
    where : topic, kind of line or sensor concerned, or "".
    count : how many times.
    time : stamp of the first (or worst) occurrence, as recorded [s]; None if it has no stamp.
    """

    severity: Severity
    code: str
    message: str
    remedy: str = ""
    where: str = ""
    count: int = 1
    time: float | None = None


def of_log(severity: ProblemSeverity) -> Severity:
    """Return the severity of a finding for that of a reader's problem."""
    return _OF_LOG[severity]


def worst_first(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return the findings by severity, otherwise in the order given."""
    return tuple(sorted(findings, key=lambda finding: SEVERITIES.index(finding.severity)))


def from_message(severity: Severity, code: str, text: str, where: str = "") -> Finding:
    """Return the finding of a message of the form ``what is wrong; what to do``."""
    what, _, remedy = text.partition("; ")
    return Finding(severity, code, what, remedy, where)


def first_of(known: float | None, stamp: float) -> float:
    """Return the stamp [s] of the first occurrence: `known` unless this is the first."""
    return stamp if known is None else known
