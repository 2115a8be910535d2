# SPDX-License-Identifier: Apache-2.0
"""Name and picture of a saved map, for who cannot wait until all of it is read."""

from __future__ import annotations

import json
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

from cartoloop.errors import InputError
from cartoloop.foreign_database import open_database
from cartoloop.map_file.damage import damage_reported
from cartoloop.map_file.file_set import repair_file_set
from cartoloop.map_file.schema import APPLICATION_ID, FILE_NAME, READABLE_VERSIONS
from cartoloop.plain_text import one_line

PICTURE = "map.png"

_PNG = b"\x89PNG\r\n\x1a\n"
_MAX_PICTURE_BYTES = 2**26
"""A larger picture is not shown [bytes]."""


class FirstLook(NamedTuple):
    """What is known of a map at once.

    Attributes
    ----------
    name : of its recording; "" without one.
    picture : as a PNG.
    """

    name: str
    picture: bytes


def first_look(folder: Path) -> FirstLook | None:
    """Return the first look at the map in a folder; None where there is none.

    A map that cannot be read has none either: to read all of it says what is wrong.
    """
    repair_file_set(folder)
    file, picture = folder / FILE_NAME, folder / PICTURE
    try:
        if not file.is_file() or picture.stat().st_size > _MAX_PICTURE_BYTES:
            return None
        content = picture.read_bytes()
        with damage_reported(file), closing(open_database(file, ["about"])) as database:
            (application_id,) = database.execute("PRAGMA application_id").fetchone()
            (version,) = database.execute("PRAGMA user_version").fetchone()
            query = "SELECT value FROM about WHERE key = 'report'"
            name = json.loads(database.execute(query).fetchone()[0])["input"]["name"]
    except (OSError, InputError):
        return None
    if application_id != APPLICATION_ID or version not in READABLE_VERSIONS:
        return None
    return FirstLook(one_line(str(name)), content) if content.startswith(_PNG) else None
