# SPDX-License-Identifier: Apache-2.0
"""What goes wrong with a source, told in one line each and never faster than one can read."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from threading import Lock
from time import monotonic

PERIOD_S = 5.0
"""Of one kind, no more than a line in so long; what happens meanwhile is counted [s]."""


class Notices:
    """Tells what happens: the first of a kind at once, then how many more there were.

    Parameters
    ----------
    tell : receives a line; may be called in any thread, one at a time.
    period : between two lines of one kind [s].
    now : a clock [s].

    Attributes
    ----------
    counts : how often each kind happened.
    skipped : the same of those by which something was lost.
    """

    def __init__(
        self,
        tell: Callable[[str], None],
        period: float = PERIOD_S,
        now: Callable[[], float] = monotonic,
    ) -> None:
        self.counts: Counter[str] = Counter()
        self.skipped: Counter[str] = Counter()
        self._tell = tell
        self._period = period
        self._now = now
        self._lock = Lock()
        self._next: dict[str, float] = {}
        self._untold: dict[str, tuple[int, str]] = {}

    def say(self, line: str) -> None:
        """Tell something that happens once."""
        with self._lock:
            self._tell(line)

    def note(self, kind: str, detail: str = "", count: int = 1) -> None:
        """Note that something happened, in a line of its own if that kind is not told too often.

        Parameters
        ----------
        kind : what it is counted under.
        detail : the same with what is particular; told in place of `kind`.
        count : how often it happened.
        """
        with self._lock:
            self.counts[kind] += count
            if self._now() < self._next.get(kind, 0.0):
                self._untold[kind] = (self._untold.get(kind, (0, ""))[0] + count, detail)
                return
            self._say(kind, detail, self._untold.pop(kind, (0, ""))[0] + count)

    def skip(self, kind: str, detail: str = "", count: int = 1) -> None:
        """Note that something was lost; as `note`."""
        self.skipped[kind] += count
        self.note(kind, detail, count)

    def tick(self, *, all_of_it: bool = False) -> None:
        """Tell what was held back and is due, or all of it."""
        if not self._untold:
            return
        with self._lock:
            now = self._now()
            for kind in [k for k in self._untold if all_of_it or now >= self._next.get(k, 0.0)]:
                count, detail = self._untold.pop(kind)
                self._say(kind, detail, count)

    def _say(self, kind: str, detail: str, count: int) -> None:
        self._next[kind] = self._now() + self._period
        total = self.counts[kind]
        times = "" if total == 1 else f" ({count} more, {total} in all)" if total > count else ""
        if total == count > 1:
            times = f" ({count} times)"
        self._tell(f"{detail or kind}{times}")
