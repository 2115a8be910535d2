# SPDX-License-Identifier: Apache-2.0
"""Journals of others, opened as maps: refused in one line, whatever is in them."""

from __future__ import annotations

import random
import struct

import numpy as np
import pytest

from cartoloop.config import Config
from cartoloop.errors import InputError
from cartoloop.global_slam.graph_records import poses_record, submap_record
from cartoloop.journal.frames import FILE_NAME, PREAMBLE, Kind, frame_bytes, record_bytes
from cartoloop.map_file.journal_map import read_journal_map
from cartoloop.map_file.read import read_map
from cartoloop.map_file.run_header import RunHeader
from cartoloop.sensor.pose import IDENTITY, Pose
from cartoloop.submaps.finished_grid import FinishedGrid
from cartoloop.submaps.node import Node
from cartoloop.submaps.node_records import node_record, scan_record
from cartoloop.submaps.probability_grid import ProbabilityGrid
from cartoloop.submaps.submap import Submap

HEADER = RunHeader("map", "a.log", "0123456789abcdef", Config())
POINTS = np.array([(2.0, 0.0), (0.0, 1.5), (-1.0, -1.0)])
SUBMAPS = tuple(
    Submap(index, Pose(5.0 * index, 0.0, 0.0), ProbabilityGrid(0.05)) for index in (0, 1)
)
GRID = FinishedGrid(np.full((4, 6), 9, np.uint8), -1.0, -2.0, 0.05)


def node(number, submaps=(0,), points=POINTS):
    pose = Pose(0.1 * number, 0.0, 0.0)
    into = tuple(SUBMAPS[index] for index in submaps)
    made = Node(number, float(number), pose, points, into, np.eye(3), None)
    return Kind.NODE, node_record(made, IDENTITY)


def scan(number, pose=None):
    return Kind.SCAN, scan_record(float(number), pose or Pose(0.1 * number, 0.0, 0.0))


WHOLE = [
    *(
        record
        for number in range(3)
        for record in (node(number, (0, 1)[: 1 + number // 2]), scan(number))
    ),
    scan(3),
    (Kind.SUBMAP, submap_record(0, GRID, 0.6)),
    (Kind.POSES, poses_record(np.array([(0.0, 0.0, 0.0), (5.0, 0.5, 0.0)]))),
]


@pytest.fixture
def path(tmp_path):
    return tmp_path / FILE_NAME


def write(path, records, header=HEADER):
    content = [record_bytes(Kind.HEADER, header.to_json())]
    content += [record_bytes(kind, payload) for kind, payload in records]
    path.write_bytes(PREAMBLE + frame_bytes(content))


def test_a_journal_is_a_map(path):
    write(path, WHOLE)

    opened = read_map(path.parent)

    assert opened.stamps.tolist() == [0.0, 1.0, 2.0, 3.0]
    assert opened.node_scan_index.tolist() == [0, 1, 2]
    assert np.allclose(opened.local_trajectory[:, 0], (0.0, 0.1, 0.2, 0.3))
    assert opened.graph.submap_poses.tolist() == [[0.0, 0.0, 0.0], [5.0, 0.5, 0.0]]
    assert np.allclose(opened.node_points[0], POINTS)
    assert opened.submap_grids[0].packed == GRID.packed
    assert opened.submap_grids[1].size > 100
    assert (opened.report.input.name, opened.report.finished) == ("a.log", False)


def test_a_node_without_its_scan_is_left_out(path):
    write(path, [*WHOLE, node(3)])

    assert read_journal_map(path).graph.num_nodes == 3


def test_a_journal_without_scans_is_an_empty_map(path):
    write(path, [])

    assert len(read_journal_map(path).stamps) == 0


def test_a_session_of_another_map_counts_from_its_own(path):
    submap = Submap(40, Pose(5.0, 0.0, 0.0), ProbabilityGrid(0.05))
    made = Node(100, 0.0, IDENTITY, POINTS, (submap,), np.eye(3), None)
    records = [(Kind.NODE, node_record(made, IDENTITY)), scan(0), (Kind.SEARCHED, b"of the whole")]
    header = RunHeader(
        "live", "robot", "", Config(), continues=True, first_node=100, first_submap=40
    )
    write(path, records, header)

    opened = read_journal_map(path)

    assert (opened.graph.num_nodes, opened.graph.num_submaps) == (1, 1)


@pytest.mark.parametrize(
    "records",
    [
        [node(1), scan(0)],
        [node(0, (1,)), scan(0)],
        [node(0, ()), scan(0)],
        [node(0, points=1e7 * POINTS), scan(0)],
        [node(0), scan(0, Pose(np.nan, 0.0, 0.0))],
        [node(0), scan(0), (Kind.SUBMAP, submap_record(0, GRID, 0.6)[:-3])],
        [(Kind.SUBMAP, struct.pack("<Id2I3d", 0, 0.5, 2**31, 2**31, 0.0, 0.0, 0.05) + GRID.packed)],
        [(Kind.SUBMAP, struct.pack("<Id2I3d", 0, 0.5, 4, 6, 0.0, 0.0, 0.0) + GRID.packed)],
        [(Kind.POSES, struct.pack("<I", 2**32 - 1))],
        [(Kind.REQUESTS, struct.pack("<II", 3, 1) + bytes(52))],
        [(Kind.DROPPED, struct.pack("<Ii", 1, 7))],
        [(Kind.SEARCHED, bytes(13))],
        [(Kind.BELIEVED, struct.pack("<Ii", 1, 0) + bytes(136))],
        [(Kind.SCAN, b"short")],
        [(Kind.NODE, b"short")],
        [(Kind.CALIBRATION, b"[" * 100_000)],
    ],
)
def test_an_impossible_record_is_refused(path, records):
    write(path, records)

    with pytest.raises(
        InputError, match=r"journal\.cartoloop: is damaged .*map the recording again"
    ):
        read_journal_map(path)


def test_changed_bytes_never_do_more_than_be_refused(path):
    draw, refused = random.Random(3), 0
    for _ in range(300):
        records = [
            (kind, changed(payload, draw)) if draw.random() < 0.3 else (kind, payload)
            for kind, payload in WHOLE
        ]
        write(path, records)
        try:
            read_journal_map(path)
        except InputError as error:
            assert "\n" not in str(error)
            refused += 1

    assert 50 < refused < 300


def changed(payload, draw):
    content = bytearray(payload)
    for _ in range(draw.randint(1, 3)):
        content[draw.randrange(len(content))] = draw.choice((0, 1, 127, 128, 255))
    return bytes(content)


@pytest.mark.parametrize(
    "header", [b"", b"[]", b"{}", b"\xff", b'{"kind": "dance"}', b"[" * 100_000]
)
def test_a_damaged_header_is_refused(path, header):
    path.write_bytes(PREAMBLE + frame_bytes([record_bytes(Kind.HEADER, header)]))

    with pytest.raises(InputError, match="is damaged"):
        read_map(path)
