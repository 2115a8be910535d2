# SPDX-License-Identifier: Apache-2.0
"""A call of a kernel to be timed, and the size of its problem."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from bench.record import Case


@dataclass(frozen=True, slots=True)
class Workload:
    """Something to time.

    Attributes
    ----------
    kernel : name of the step.
    modules : modules of ``cartoloop.kernels`` that it exercises.
    case : the size of the problem.
    call : does it once.
    items : number of `item` that a call handles, for the time of one.
    """

    kernel: str
    modules: tuple[str, ...]
    case: Case
    call: Callable[[], object]
    items: int
    item: str
