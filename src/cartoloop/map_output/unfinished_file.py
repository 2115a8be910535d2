# SPDX-License-Identifier: Apache-2.0
"""Files that are written completely or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from cartoloop.errors import OutputError


@contextmanager
def unfinished_file(path: Path) -> Iterator[Path]:
    """Yield the name of a file to be written, which becomes `path` when the body is done.

    If the body fails, it is removed, and an existing file at `path` is kept.

    Raises
    ------
    OutputError
        The file system does not allow it.
    """
    unfinished = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        try:
            unfinished.unlink(missing_ok=True)
            yield unfinished
            unfinished.replace(path)
        except BaseException:
            unfinished.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror}") from error
