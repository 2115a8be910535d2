# SPDX-License-Identifier: Apache-2.0
"""Problems of a source: one line each, not faster than a user can read."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from threading import Lock
from time import monotonic

from cartoloop.plain_text import one_line

PERIOD_S = 5.0
"""Time between two lines of one kind [s]; occurrences in between are counted."""


class Notices:
    """Reports events to the user: the first of a kind at once, then the number of further ones.

    Parameters
    ----------
    report : receives a line; called in any thread, in one at a time.
    period : between two lines of one kind [s].
    now : a clock [s].

    Attributes
    ----------
    counts : number of events by kind.
    skipped : the same, of events that lost data.
    """

    def __init__(
        self,
        report: Callable[[str], None],
        period: float = PERIOD_S,
        now: Callable[[], float] = monotonic,
    ) -> None:
        self.counts: Counter[str] = Counter()
        self.skipped: Counter[str] = Counter()
        self._report = report
        self._period = period
        self._now = now
        self._lock = Lock()
        self._next: dict[str, float] = {}
        self._unreported: dict[str, tuple[int, str]] = {}

    def say(self, line: str) -> None:
        """Report an event that happens once."""
        with self._lock:
            self._report(one_line(line))

    def note(self, kind: str, detail: str = "", count: int = 1) -> None:
        """Count an event, and report it in a line unless its kind was reported just before.

        Parameters
        ----------
        kind : its category in the counts.
        detail : the line to report in place of `kind`.
        count : number of occurrences.
        """
        with self._lock:
            self.counts[kind] += count
            if self._now() < self._next.get(kind, 0.0):
                self._unreported[kind] = (self._unreported.get(kind, (0, ""))[0] + count, detail)
                return
            self._say(kind, detail, self._unreported.pop(kind, (0, ""))[0] + count)

    def skip(self, kind: str, detail: str = "", count: int = 1) -> None:
        """Count an event that lost data; as `note`."""
        self.skipped[kind] += count
        self.note(kind, detail, count)

    def tick(self, *, all_of_it: bool = False) -> None:
        """Report the lines that were held back and are due, or all of them."""
        if not self._unreported:
            return
        with self._lock:
            now = self._now()
            for kind in [k for k in self._unreported if all_of_it or now >= self._next.get(k, 0.0)]:
                count, detail = self._unreported.pop(kind)
                self._say(kind, detail, count)

    def _say(self, kind: str, detail: str, count: int) -> None:
        self._next[kind] = self._now() + self._period
        total = self.counts[kind]
        times = "" if total == 1 else f" ({count} more, {total} in all)" if total > count else ""
        if total == count > 1:
            times = f" ({count} times)"
        self._report(one_line(f"{detail or kind}{times}"))
