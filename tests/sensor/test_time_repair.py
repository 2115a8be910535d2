# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from cartoloop.sensor.ordered_times import (
    late_bursts,
    longest_ordered,
    spread_late,
    spread_repeats,
    strictly_increasing,
)
from cartoloop.sensor.time_repair import (
    repair_times,
    times_between,
)

NAN = float("nan")
any_stamp = st.one_of(
    st.floats(0.0, 100.0), st.floats(0.0, 2e9), st.integers(0, 5).map(float), st.just(NAN)
)
any_stamps = st.integers(0, 60).flatmap(lambda n: arrays(np.float64, n, elements=any_stamp))


@settings(deadline=None, max_examples=300)
@given(stamps=any_stamps)
def test_times_are_finite_and_increase_for_any_stamps(stamps):
    times, report = repair_times(stamps)
    assert times.shape == stamps.shape
    assert np.isfinite(times).all()
    assert (np.diff(times) > 0.0).all()
    assert report.num_stamps == len(stamps)
    assert report.num_missing == np.isnan(stamps).sum()
    assert report.describe()


@settings(deadline=None, max_examples=100)
@given(steps=st.lists(st.floats(1e-3, 1000.0), min_size=0, max_size=60), start=st.floats(0, 2e9))
def test_ordered_stamps_are_the_times_bit_for_bit(steps, start):
    stamps = start + np.cumsum([0.0, *steps])
    times, report = repair_times(stamps)
    if np.diff(stamps).max(initial=0.0) < 3600.0 and not late_bursts(stamps):
        assert times.tolist() == stamps.tolist()
        assert report.is_sound


def test_the_report_of_a_sound_log_is_clean():
    assert repair_times(np.arange(5.0))[1].describe() == "5 stamps, all in order"


def test_backward_bursts_are_spread_at_the_mean_rate():
    rng = np.random.default_rng(3)
    true = 0.2 * np.arange(5000)
    stamps = 9.7e8 + true + rng.exponential(0.3, len(true))
    times, report = repair_times(stamps)
    assert report.num_backwards > 500
    assert report.period == pytest.approx(0.2, rel=1e-3)
    assert np.diff(times) == pytest.approx(np.full(4999, 0.2), rel=0.02)
    assert np.ptp(times - true) < 0.25


def given_late(true, begin, end):
    """Return stamps of arrival: messages of a delay arrive together at its end."""
    waited = (true >= begin) & (true < end)
    return np.maximum.accumulate(np.where(waited, end + 5e-4 * np.cumsum(waited), true))


@settings(deadline=None, max_examples=100)
@given(
    begin=st.floats(2.0, 8.0),
    delay=st.floats(0.7, 3.0),
    seed=st.integers(0, 2**32 - 1),
    jitter=st.floats(0.0, 0.05),
)
def test_stamps_of_arrival_are_spread_over_the_delay(begin, delay, seed, jitter):
    rng = np.random.default_rng(seed)
    true = 0.2 * np.arange(100) + rng.uniform(0.0, jitter, 100)
    stamps = given_late(true, begin, begin + delay)
    times, report = repair_times(stamps)
    late = np.abs(times - stamps) > 0.25  # the last one may not be late
    assert abs(report.num_late - delay / 0.2) <= 2.0
    assert np.abs(times - true).max() < 0.3
    assert np.all(np.diff(times) > 0.1 - jitter)
    assert np.all((true[late] >= begin) & (true[late] < begin + delay))
    assert "given late, in bursts" in report.describe()


def test_scans_missing_in_a_regular_recording_move_no_other():
    stamps = np.delete(0.2 * np.arange(200), slice(60, 80))
    assert spread_late(stamps).tolist() == stamps.tolist()


def test_single_bursts_of_irregular_stamps_are_not_spread():
    rng = np.random.default_rng(5)
    stamps = np.cumsum(rng.lognormal(0.0, 2.0, 80))
    assert 0 < len(late_bursts(stamps)) < 10
    assert spread_late(stamps).tolist() == stamps.tolist()


def test_stamps_that_are_often_late_follow_the_mean_rate():
    rng = np.random.default_rng(6)
    true = 0.2 * np.arange(3000)
    stamps = np.maximum.accumulate(true + rng.exponential(0.1, len(true)))
    times, report = repair_times(stamps)
    assert report.num_backwards == 0
    assert report.num_late > 100
    assert np.ptp(times - true) < 0.1


@pytest.mark.parametrize("step", [1e-4, 1e-3, 8e-3])
def test_stamps_of_batches_follow_the_mean_rate(step):
    true = 0.2 * np.arange(1000) + 0.05
    batch = np.floor(true)
    stamps = batch + step * (np.arange(1000) - np.searchsorted(batch, batch))
    times, report = repair_times(stamps)
    assert report.num_late > 700
    assert np.ptp(times - true) < 0.1
    assert np.diff(times) == pytest.approx(np.full(999, 0.2), rel=0.1)


def test_fast_messages_with_long_pauses_are_no_batches():
    steps = np.where(np.arange(2000) % 100 == 99, 0.3, 0.01)
    stamps = np.cumsum(steps)
    assert repair_times(stamps)[0].tolist() == stamps.tolist()


def test_bursty_stretches_keep_the_gap_between_them():
    rng = np.random.default_rng(4)
    true = 0.2 * np.arange(2000) + 36000.0 * (np.arange(2000) >= 1200)
    times, report = repair_times(true + rng.uniform(0.0, 0.7, len(true)))
    assert report.gaps == (1200,)
    assert report.gap_lengths == pytest.approx((36000.2,), abs=0.5)
    assert np.delete(np.diff(times), 1199) == pytest.approx(np.full(1998, 0.2), rel=0.05)


def test_a_pause_among_bursty_stamps_is_kept():
    rng = np.random.default_rng(6)
    true = 0.2 * np.arange(2000) + 3.0 * (np.arange(2000) >= 1234)
    times, report = repair_times(true + rng.exponential(0.3, len(true)))
    assert report.num_backwards > 200
    assert np.diff(times)[1233] == pytest.approx(3.2, abs=0.5)
    assert np.delete(np.diff(times), 1233) == pytest.approx(np.full(1998, 0.2), rel=0.05)


def test_a_delay_that_bursty_stamps_catch_up_is_no_pause():
    rng = np.random.default_rng(7)
    true = 0.2 * np.arange(2000)
    stamps = true + rng.exponential(0.3, len(true))
    queued = slice(1000, 1016)
    stamps[queued] = true[1016] + 0.01 * np.arange(16)
    times, _ = repair_times(stamps)
    assert np.diff(times).max() < 0.25


def test_a_few_unordered_stamps_do_not_change_the_others():
    stamps = 0.2 * np.arange(1000)
    stamps[500] -= 0.5
    stamps[700] += 3.0
    times, report = repair_times(stamps)
    assert (report.num_backwards, report.num_repaired) == (2, 2)
    assert times == pytest.approx(0.2 * np.arange(1000))


@pytest.mark.parametrize("wild", [1e6, -1e6, 0.0, 36000.0])
@pytest.mark.parametrize("places", [(0,), (1,), (20,), (39,), (20, 21), (5, 25)])
def test_wild_stamps_are_outvoted_by_their_neighbours(wild, places):
    stamps = 9.7e8 + 0.2 * np.arange(40)
    stamps[list(places)] = wild if wild == 0.0 else 9.7e8 + wild
    times, report = repair_times(stamps)
    assert report.num_wild == len(places)
    assert times == pytest.approx(9.7e8 + 0.2 * np.arange(40), abs=1e-5)
    assert report.gaps == report.resets == ()


def test_a_gap_that_later_stamps_agree_with_is_kept():
    stamps = 0.2 * np.arange(40) + 36000.0 * (np.arange(40) >= 15)
    times, report = repair_times(stamps)
    assert times.tolist() == stamps.tolist()
    assert report.gaps == (15,)
    assert "1 gaps (up to 3.6e+04 s)" in report.describe()


def test_a_few_scans_between_two_gaps_are_not_wild():
    stamps = np.array([*range(20), *range(300, 303), *range(700, 720)], dtype=float)
    stamps[10] = 9.5 - 1.0
    times, report = repair_times(stamps)
    assert report.num_wild == 0
    assert times[20:23].tolist() == [300.0, 301.0, 302.0]


def test_a_reset_clock_continues_one_period_later():
    stamps = np.concatenate([1000.0 + 0.2 * np.arange(30), 0.2 * np.arange(30)])
    times, report = repair_times(stamps)
    assert report.resets == (30,)
    assert np.diff(times) == pytest.approx(np.full(59, 0.2))


def test_a_clock_that_returns_is_used_again():
    stamps = 1000.0 + 0.2 * np.arange(90)
    stamps[30:60] -= 1000.0
    times, report = repair_times(stamps)
    assert times == pytest.approx(1000.0 + 0.2 * np.arange(90))
    assert report.resets == (30,)


def test_repeated_stamps_are_spread_towards_the_next():
    times, report = repair_times(np.array([0.0, 1.0, 1.0, 1.0, 1.0, 2.0, 3.0]))
    assert times == pytest.approx([0.0, 1.0, 1.25, 1.5, 1.75, 2.0, 3.0])
    assert report.num_repeated == 3


def test_repeated_stamps_before_a_pause_keep_the_usual_period():
    assert spread_repeats(np.array([0.0, 1.0, 1.0, 9.0, 9.0]), 1.0) == pytest.approx(
        [0, 1, 2, 9, 10]
    )


def test_missing_stamps_are_between_their_neighbours():
    times, report = repair_times(np.array([NAN, 1.0, NAN, NAN, 4.0, 5.0, NAN]))
    assert times == pytest.approx([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0], abs=0.3)
    assert times[2:4] == pytest.approx([2.0, 3.0])
    assert report.num_missing == 4


def test_missing_stamps_at_a_gap_are_on_one_side_of_it():
    stamps = 0.2 * np.arange(40) + 36000.0 * (np.arange(40) >= 20)
    stamps[19:21] = NAN
    times, _ = repair_times(stamps)
    assert times[18:22] == pytest.approx([3.6, 3.8, 4.0, 36004.2])


def test_without_any_stamp_the_nominal_period_holds():
    assert repair_times(np.full(3, NAN), 0.5)[0].tolist() == [0.0, 0.5, 1.0]
    assert repair_times(np.empty(0))[0].tolist() == []


@settings(deadline=None)
@given(values=st.lists(st.integers(0, 6), max_size=8))
def test_longest_ordered_is_the_longest_of_all(values):
    kept = longest_ordered(np.array(values, dtype=float))
    chosen = [values[i] for i in kept]
    assert chosen == sorted(chosen)
    assert (np.diff(kept) > 0).all()
    best = 0
    for subset in range(1 << len(values)):
        picked = [v for i, v in enumerate(values) if subset >> i & 1]
        best = max(best, len(picked) if picked == sorted(picked) else 0)
    assert len(chosen) == best


def test_only_times_that_do_not_increase_are_changed():
    lifted = strictly_increasing(np.array([1e9, 1e9, 1e9 - 1.0, 1e9 + 5.0]))
    assert lifted[0] == 1e9
    assert lifted[3] == 1e9 + 5.0
    assert lifted == pytest.approx([1e9, 1e9, 1e9, 1e9 + 5.0], abs=1e-5)


def between(odom, scan_times, scan_stamps=None, order=None):
    """Times of odometry lines among scans; `order` lists "o" and "s" as in the file."""
    order = np.array(list(order))
    return times_between(
        np.array(odom, dtype=float),
        np.flatnonzero(order == "o"),
        np.array(scan_times if scan_stamps is None else scan_stamps, dtype=float),
        np.array(scan_times, dtype=float),
        np.flatnonzero(order == "s"),
    ).tolist()


def test_sound_odometry_keeps_its_exact_stamps():
    odom = [0.1, 0.9, 1.3, 1.7, 2.5]
    assert between(odom, [1.0, 2.0], order="oosooso") == odom


def test_odometry_follows_the_shift_of_a_reset_clock():
    assert between([0.25, 0.5], [10.0, 11.0], [0.0, 1.0], order="soos") == [10.25, 10.5]


def test_odometry_never_passes_the_scans_around_it():
    assert between([0.9, 2.5], [1.0, 2.0], order="soos") == [1.0, 2.0]


def test_odometry_with_the_stamp_of_a_scan_gets_its_time():
    assert between([5.3], [1.0, 2.0], [7.1, 5.3], order="sos") == [2.0]
    assert between([7.1], [1.0, 2.0], [7.1, 5.3], order="sos") == [1.0]


def test_odometry_between_repaired_scans_is_spread():
    assert between([9.0, 8.0, 7.0], [0.0, 4.0], [1.0, 0.5], order="sooos") == [1.0, 2.0, 3.0]


def test_one_wild_odometry_stamp_does_not_change_the_others():
    odom = [1.0, 2.0, 99.0, 4.0, 5.0]
    assert between(odom, [0.0, 6.0], order="sooooos") == [1.0, 2.0, 3.0, 4.0, 5.0]
    assert between([1e9, 8.0], [0.0, 6.0], order="ssoo") == [7.0, 8.0]
    assert between([NAN, -1e9, 5.0], [6.0], order="ooos") == [5.0, 5.0, 5.0]


@settings(deadline=None, max_examples=200)
@given(data=st.data())
def test_all_times_together_never_run_backwards(data):
    order = data.draw(st.lists(st.sampled_from("os"), min_size=1, max_size=30))
    order.append("s")
    stamps = np.array([data.draw(any_stamp) for _ in order])
    is_scan = np.array(order) == "s"
    times = np.empty(len(order))
    times[is_scan], _ = repair_times(stamps[is_scan])
    times[~is_scan] = times_between(
        stamps[~is_scan],
        np.flatnonzero(~is_scan),
        stamps[is_scan],
        times[is_scan],
        np.flatnonzero(is_scan),
    )
    assert np.isfinite(times).all()
    assert (np.diff(times) >= 0.0).all()
