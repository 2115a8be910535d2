# SPDX-License-Identifier: Apache-2.0
"""What the doctor says of real recordings, checked by hand; skipped where they are absent."""

import os
from functools import cache
from pathlib import Path

import pytest

from cartoloop import doctor

pytestmark = pytest.mark.data

examine = cache(doctor.examine)

DATA = Path(os.environ.get("CARTOLOOP_DATA", Path(__file__).parents[2] / "../shared/data"))

# path: scans, duration [s], way of the odometry [m], its offset [s], findings and their counts
RECORDINGS = {
    "bags/b0-2014-07-21-12-42-53-short.bag": (
        345, 10, None, None,
        ["missing_transform 1", "missing_transform 1", "missing_transform 1", "no_odometry 1"],
    ),
    "bags/b0-2014-07-21-12-42-53-tiny.bag": (
        222, 6, None, None, ["missing_transform 1", "missing_transform 1", "no_odometry 1"],
    ),
    "bags/guardian_3.bag": (
        1036, 104, 9.1, 0.06, ["blind_beams 34", "odometry_offset 2079", "odometry_scale 2079"],
    ),
    "bags/guardian_controller_2.bag": (
        1028, 103, 21.3, 0.0, ["blind_beams 54", "odometry_scale 2060"],
    ),
    "other/exp1.dat.gz": (
        756, 75, 46.0, 0.15,
        [
            "blind_beams 79", "no_return_is_zero 1", "odometry_offset 756", "repeated_scans 4",
        ],
    ),
    "other/exp2.dat.gz": (
        641, 63, 44.5, 0.16,
        [
            "blind_beams 66",
            "no_return_is_zero 1",
            "odometry_offset 641",
            "repeated_scans 4",
        ],
    ),
    "other/loop5.log.gz": (
        551, 110, 56.1, 0.06, ["odometry_offset 551", "stamps_missing 551"],
    ),
    "radish/aces.clf.gz": (7374, 1366, 325.2, -0.09, ["gap 2", "odometry_offset 7374"]),
    "radish/fr079.clf.gz": (
        4934, 1061, 392.9, 0.13, ["gap 1", "odometry_offset 4934", "odometry_veer 4934"],
    ),
    "radish/intel.clf.gz": (
        13631, 2692, 508.4, 0.09,
        ["odometry_offset 13627", "stamps_out_of_order 1171"],
    ),
    "radish/mit-csail.clf.gz": (
        1988, 424, 373.6, 0.13,
        ["odometry_offset 1988", "odometry_scale 1988", "odometry_veer 1988"],
    ),
    "radish/mit-killian.clf.gz": (
        17480, 7677, 1910.8, 0.64, ["odometry_offset 17480", "odometry_veer 17480"],
    ),
    "radish-sparse/acapulco.clf.gz": (
        861, 1387, 824.7, 0.08, ["gap 11", "odometry_offset 11281", "sparse_scans 861"],
    ),
    "radish-sparse/edmonton.clf.gz": (
        340, 739, 332.5, 0.05, ["gap 239", "sparse_scans 340"],
    ),
    "radish-sparse/fhw.clf.gz": (
        488, 2189, 404.4, 0.06,
        ["gap 24", "odometry_offset 13447", "odometry_veer 13447", "sparse_scans 488"],
    ),
}  # fmt: skip

# Few of its turns are matched well: with 5 mm of noise on the ranges the offset that is found
# varies from 0.02 to 0.07 s, around the least one that is reported.
UNDETERMINED = {"radish-sparse/edmonton.clf.gz": "odometry_offset 6008"}


@pytest.mark.parametrize("name", RECORDINGS)
def test_findings(name):
    path = DATA / name
    if not path.exists():
        pytest.skip(f"{path} is absent: set CARTOLOOP_DATA to the folder of the recordings")
    num_scans, duration, way, offset, expected = RECORDINGS[name]

    examination = examine(path)

    assert examination.can_be_mapped
    assert examination.scanners[0].watch.count == num_scans
    assert examination.duration == pytest.approx(duration, abs=1.0)
    findings = sorted(f"{f.code} {f.count}" for f in examination.findings)
    assert [each for each in findings if each != UNDETERMINED.get(name)] == expected
    assert {f.severity for f in examination.findings} <= {"warning", "info"}
    if way is None:
        assert examination.odometry is None
        return
    assert examination.odometry.path_length == pytest.approx(way, abs=0.1)
    # Found by matching: a change of the matcher moves it a little.
    assert examination.calibration.model.time_offset == pytest.approx(offset, abs=0.03)


def test_the_first_backward_stamp_of_intel_is_reported():
    path = DATA / "radish/intel.clf.gz"
    if not path.exists():
        pytest.skip(f"{path} is absent: set CARTOLOOP_DATA to the folder of the recordings")

    finding = examine(path).findings[0]

    assert finding.code == "stamps_out_of_order"
    assert "885 run backwards (by up to 0.897 s), 286 repeat" in finding.message
    assert finding.time == pytest.approx(976052862.222313)
