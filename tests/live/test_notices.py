# SPDX-License-Identifier: Apache-2.0
"""Problems are reported at once, then counted, and none is lost."""

from __future__ import annotations

from cartoloop.live.notices import Notices


def test_floods_are_reported_in_few_lines():
    reported, clock = [], [0.0]
    notices = Notices(reported.append, period=5.0, now=lambda: clock[0])
    for k in range(1000):
        clock[0] = 0.01 * k
        notices.note("garbage", f"line {k} is garbage")
        notices.tick()
    notices.tick(all_of_it=True)

    assert reported == [
        "line 0 is garbage",
        "line 500 is garbage (500 more, 501 in all)",
        "line 999 is garbage (499 more, 1000 in all)",
    ]
    assert notices.counts == {"garbage": 1000}


def test_kinds_are_separate_and_reported_again_later():
    reported, clock = [], [0.0]
    notices = Notices(reported.append, period=5.0, now=lambda: clock[0])
    notices.note("one")
    notices.note("other", count=3)
    clock[0] = 6.0
    notices.tick()
    notices.note("one")

    assert reported == ["one", "other (3 times)", "one (1 more, 2 in all)"]
