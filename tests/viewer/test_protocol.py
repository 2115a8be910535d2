# SPDX-License-Identifier: Apache-2.0
"""Messages lie where the protocol's page says, and arrays where typed arrays can look at them."""

from __future__ import annotations

import json
import math
import re
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest

from cartoloop.global_slam.pose_graph import ConstraintKind
from cartoloop.viewer import protocol
from cartoloop.viewer.protocol import ConstraintRows, MessageType, Texture

REFERENCE = Path(__file__).parents[2] / "docs/viewer-protocol.md"


def only(data):
    (message,) = protocol.messages(data)
    return message.payload


def test_bundled_messages_are_separated_and_aligned_to_8_bytes():
    data = protocol.json_message(MessageType.PONG, {"id": 1}) + protocol.message(
        MessageType.PICTURE, b"12345"
    )

    assert len(data) % 8 == 0
    assert list(protocol.messages(data)) == [
        (MessageType.PONG, b'{"id":1}'),
        (MessageType.PICTURE, b"12345"),
    ]


def test_data_that_ends_too_early_is_no_message():
    data = protocol.json_message(MessageType.PONG, {"id": 1})

    for end in (1, 9, len(data) - 1):
        with pytest.raises(ValueError, match="ends within"):
            list(protocol.messages(data[:end]))


def test_json_that_browsers_could_not_read_is_never_sent():
    with pytest.raises(ValueError, match="JSON"):
        protocol.json_message(MessageType.READINGS, {"time_s": math.nan})


@pytest.mark.parametrize(("finished", "flags"), [(True, 1), (False, 0)])
def test_submap(finished, flags):
    cells = np.arange(12, dtype=np.uint8).reshape(3, 4)

    data = protocol.submap_message(7, 9, Texture(cells, -1.5, 2.5, 0.05), finished=finished)

    payload = only(data)
    assert struct.unpack_from("<6I3d", payload) == (7, 9, flags, 3, 4, 0, -1.5, 2.5, 0.05)
    assert zlib.decompress(payload[48:]) == bytes(range(12))


def test_patch():
    cells = np.arange(6, dtype=np.uint8).reshape(2, 3)

    payload = only(protocol.patch_message(7, 3, 4, (10, 20), cells))

    assert struct.unpack_from("<8I", payload) == (7, 3, 4, 10, 20, 2, 3, 0)
    assert zlib.decompress(payload[32:]) == bytes(range(6))


def test_poses_and_times():
    poses = np.arange(15.0).reshape(5, 3)
    stamps = np.array([0.0, 0.5, 1.0, 1.5, 2.5])

    submaps = only(protocol.table_message(MessageType.SUBMAP_POSES, 5, 0, poses[:2]))
    nodes = only(protocol.table_message(MessageType.NODES, 6, 3, poses))
    times = only(protocol.table_message(MessageType.NODE_TIMES, 0, 3, stamps))

    assert struct.unpack("<4I6d", submaps) == (0, 2, 2, 5, *range(6))
    assert struct.unpack("<4I6d", nodes) == (3, 2, 5, 6, *range(9, 15))
    assert struct.unpack("<4I2d", times) == (3, 2, 5, 0, 1.5, 2.5)


def test_constraints():
    rows = ConstraintRows(
        np.array([1, 2], np.uint32),
        np.array([3, 4], np.uint32),
        np.arange(6, dtype=np.float32).reshape(2, 3),
        np.array([ConstraintKind.LOOP_CLOSURE, ConstraintKind.INTRA_SUBMAP]),
        np.array([7, -1], np.int32),
    )

    payload = only(protocol.constraints_message(2, 10, 12, rows))

    values = struct.unpack("<4I2I2I6f2B", payload)
    assert values[:8] == (10, 2, 12, 2, 1, 2, 3, 4)
    assert values[8:14] == tuple(range(6))
    assert values[14:] == (1, 0)


def test_scan():
    payload = only(protocol.scan_message(4, 100.5, (1.0, 2.0, 3.0), np.array([(5.0, 6.0)])))

    assert struct.unpack("<4d2I2f", payload) == (100.5, 1.0, 2.0, 3.0, 4, 1, 5.0, 6.0)


def test_all_types_are_in_the_reference_with_their_numbers():
    text = REFERENCE.read_text()

    for kind in MessageType:
        assert re.search(rf"\b{kind.value} {kind.name}\b", text), kind
    assert f"Version {protocol.PROTOCOL_VERSION}." in text
    assert json.loads(only(protocol.json_message(MessageType.COMPLETE, {}))) == {}
