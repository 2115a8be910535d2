# SPDX-License-Identifier: Apache-2.0
"""Real recordings; skipped where they are absent, for none of them goes into the repository."""

import math
import os
from pathlib import Path

import numpy as np
import pytest

from cartoloop.readers import open_log
from cartoloop.sensor.events import LaserScan

pytestmark = pytest.mark.data

DATA = Path(os.environ.get("CARTOLOOP_DATA", Path(__file__).parents[2] / "../shared/data"))

# name: scans, beams, no return [m], range_max [m], rate [Hz], duration [s], odometry path [m]
LOGS = {
    "radish/aces": (7374, 180, 50.0, 49.75, 5.40, 1366, 325),
    "radish/intel": (13631, 180, 81.83, 81.42, 5.06, 2691, 508),
    "radish/mit-killian": (17480, 180, 51.06, 50.8, 2.28, 7677, 1911),
    "radish/mit-csail": (1988, 361, 81.91, 81.5, 4.69, 424, 374),
    "radish/fr079": (4934, 360, 81.91, 81.5, 4.65, 1061, 393),
    "radish-sparse/acapulco": (861, 181, 51.15, 49.75, 0.63, 1387, 825),
    "radish-sparse/edmonton": (340, 180, 51.15, 50.9, 0.48, 739, 333),
    "radish-sparse/fhw": (488, 180, 51.05, 50.8, 0.46, 2189, 404),
}


@pytest.mark.parametrize("name", LOGS)
def test_a_real_log_is_read_whole_and_its_scanner_known(name):
    path = DATA / f"{name}.clf.gz"
    if not path.exists():
        pytest.skip(f"{path} is absent: set CARTOLOOP_DATA to the folder of the recordings")
    num_scans, beams, no_return, range_max, rate, duration, length = LOGS[name]
    log = open_log(path)
    events = list(log)
    scans = [event for event in events if isinstance(event, LaserScan)]
    profile = log.profile
    assert len(scans) == log.num_scans == num_scans
    assert log.skipped == {}
    assert profile.num_beams == beams
    assert profile.angular_resolution == pytest.approx(math.radians(0.5 if beams > 300 else 1.0))
    assert profile.no_return == pytest.approx(no_return, abs=0.02)
    assert profile.range_max == pytest.approx(range_max, abs=0.2)
    assert profile.rate == pytest.approx(rate, abs=0.01)
    assert 0.003 < profile.range_noise < 0.06
    assert log.duration == pytest.approx(duration, abs=2.0)
    times = np.array([event.time for event in events])
    assert (np.diff(times) >= 0.0).all()
    assert (np.diff([scan.time for scan in scans]) > 0.0).all()
    path_xy = np.array([e.tf_odom_tracking[:2] for e in events if not isinstance(e, LaserScan)])
    assert np.hypot(*np.diff(path_xy, axis=0).T).sum() == pytest.approx(length, rel=0.01)


def test_times_of_intel_are_even_and_in_file_order():
    path = DATA / "radish/intel.clf.gz"
    if not path.exists():
        pytest.skip(f"{path} is absent: set CARTOLOOP_DATA to the folder of the recordings")
    log = open_log(path)
    scans = [event for event in log if isinstance(event, LaserScan)]
    assert log.time_report.num_backwards == 885
    assert log.time_report.largest_backwards == pytest.approx(0.897, abs=1e-3)
    assert np.diff([scan.time for scan in scans]) == pytest.approx([0.1974] * 13630, abs=0.006)
    stamps = np.array([scan.stamp for scan in scans])
    assert int((np.diff(stamps) < 0.0).sum()) == 885
