# SPDX-License-Identifier: Apache-2.0
"""Scans and nodes as records of a journal: enough to make a map of them without the recording."""

from __future__ import annotations

import struct
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.sensor.packed_points import pack_points, unpack_points
from cartoloop.sensor.pose import Pose
from cartoloop.submaps.node import Node

_SCAN = struct.Struct("<4d")
_NODE = struct.Struct("<I4d2d6diIId")
_SUBMAP = struct.Struct("<I2d")
_NONE = -1
_UPPER = np.triu_indices(3)
_SYMMETRIC = np.array(((0, 1, 2), (1, 3, 4), (2, 4, 5)))


class ScanRecord(NamedTuple):
    """A mapped scan.

    Attributes
    ----------
    stamp : as recorded [s].
    tf_local_tracking : its pose before loop closure.
    """

    stamp: float
    tf_local_tracking: Pose


class NodeRecord(NamedTuple):
    """A node; the scan that it was is the next one in the journal.

    Attributes
    ----------
    number : its index.
    time : of the scan [s].
    tf_local_tracking : its pose before loop closure.
    origin : float64, shape (2,), place of the scanner [m], tracking frame.
    information : float64, shape (3, 3), of the match to the oldest of `submaps`, local axes.
    finished : index of the submap that it finished, or None.
    submaps : index and origin [m, local frame] of those that it was inserted into.
    points : float64, shape (n, 2), its returns [m], tracking frame, to a millimetre.
    """

    number: int
    time: float
    tf_local_tracking: Pose
    origin: FloatArray
    information: FloatArray
    finished: int | None
    submaps: tuple[tuple[int, float, float], ...]
    points: FloatArray

    def counted_from(self, first_node: int, first_submap: int) -> NodeRecord:
        """Return the node with other numbers, where nodes and submaps of other sessions precede."""
        if first_node == first_submap == 0:
            return self
        return self._replace(
            number=self.number - first_node,
            finished=None if self.finished is None else self.finished - first_submap,
            submaps=tuple((index - first_submap, x, y) for index, x, y in self.submaps),
        )


def scan_record(stamp: float, tf_local_tracking: Pose) -> bytes:
    """Return a mapped scan as a payload."""
    return _SCAN.pack(stamp, *tf_local_tracking)


def recorded_scan(payload: memoryview) -> ScanRecord:
    """Return a mapped scan.

    Raises
    ------
    struct.error
        The payload has another length.
    """
    stamp, *pose = _SCAN.unpack(payload)
    return ScanRecord(stamp, Pose(*pose))


def node_record(node: Node, tf_tracking_sensor: Pose) -> bytes:
    """Return a node as a payload."""
    unit, points = pack_points(node.points)
    head = _NODE.pack(
        node.index,
        node.time,
        *node.tf_local_tracking,
        *tf_tracking_sensor[:2],
        *node.information[_UPPER].tolist(),
        _NONE if node.finished is None else node.finished.index,
        len(node.submaps),
        len(node.points),
        unit,
    )
    submaps = [_SUBMAP.pack(each.index, *each.tf_local_submap[:2]) for each in node.submaps]
    return b"".join((head, *submaps, points))


def recorded_node(payload: memoryview) -> NodeRecord:
    """Return a node.

    Raises
    ------
    struct.error, ValueError
        The payload has another length.
    """
    index, time, x, y, theta, *others = _NODE.unpack_from(payload)
    finished, num_submaps, num_points, unit = others[8:]
    first, end = _NODE.size, _NODE.size + num_submaps * _SUBMAP.size
    return NodeRecord(
        index,
        time,
        Pose(x, y, theta),
        np.array(others[:2]),
        np.array(others[2:8])[_SYMMETRIC],
        None if finished == _NONE else finished,
        tuple(_SUBMAP.iter_unpack(payload[first:end])),
        unpack_points(num_points, unit, payload[end:]),
    )
