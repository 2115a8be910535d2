# SPDX-License-Identifier: Apache-2.0
"""A robot's day with faults: every scan is mapped or counted."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bench.soak.account import Account
from bench.soak.run import NETWORKS, SoakResult, soak


@pytest.mark.slow
@pytest.mark.parametrize("kind", NETWORKS)
def test_every_scan_of_a_bad_day_is_mapped_or_counted(kind, tmp_path):
    result = soak(kind, hours=0.06, num_faults=40, out=tmp_path)
    assert sum(result.faults.values()) in (39, 40)
    assert len(result.faults) == 7
    assert result.sent > 1000
    assert result.received == result.sent - result.lost
    assert result.unaccounted == 0, result.table()
    assert (tmp_path / "map.cartoloop").exists()


@pytest.mark.slow
def test_memory_in_use_stays_while_the_robot_stands(tmp_path):
    result = soak("tcp", hours=0.2, num_faults=60, out=tmp_path, drives_again=False)
    assert result.end.nodes < result.settled.nodes + 10  # a clock that jumps makes one
    assert result.end.scans - result.settled.scans > 2000
    assert not result.end.in_use_mb > result.settled.in_use_mb + 2.0, result.table()


def test_odometry_that_comes_late_accounts_for_no_scan():
    skipped = {"message skipped: no JSON": 2, "odometry out of order, not used": 3}
    day = SoakResult(sent=10, received=9, mapped=9, lost=1, bad_lines=2, skipped=skipped)
    assert (day.num_late, day.num_skipped, day.unaccounted) == (3, 2, 0)
    assert replace(day, bad_lines=5).unaccounted == 3


def sent(account, count):
    return [account.stamp(0.2 * number) for number in range(count)]


def test_scans_before_a_cut_are_lost_those_in_between_missing():
    account = Account(most=20)
    for stamp in sent(account, 10)[:7]:
        if stamp > 0.5:  # the first three do not come
            account.came(stamp)
    account.cut()
    account.connected()
    for stamp in sent(account, 5):  # the clock was set back
        account.came(stamp)

    assert (account.num_sent, account.num_came) == (15, 9)
    assert (account.num_lost, account.num_missing) == (3, 3)


def test_scans_of_a_connection_that_was_closed_cannot_be_lost():
    account = Account(most=10)
    for stamp in sent(account, 5)[:4]:
        account.came(stamp)
    account.connected()

    assert (account.num_lost, account.num_missing) == (0, 1)


def test_scans_of_two_connections_may_overtake_each_other():
    account = Account(most=10)
    first = sent(account, 4)
    account.cut()
    account.connected()
    second = sent(account, 2)
    for stamp in (second[0], first[0], second[1], first[1], first[1]):
        account.came(stamp)

    assert (account.num_came, account.num_lost, account.num_missing) == (4, 2, 0)


def test_a_scan_that_nobody_sent_is_noticed():
    with pytest.raises(ValueError, match="never sent"):
        Account(most=2).came(1.0)
