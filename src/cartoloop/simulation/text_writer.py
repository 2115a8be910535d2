# SPDX-License-Identifier: Apache-2.0
"""Text files of any length, written line by line, completely or not at all."""

from __future__ import annotations

import gzip
import io
from collections.abc import Iterable
from contextlib import ExitStack, suppress
from pathlib import Path

from cartoloop.errors import OutputError

COMPRESS_LEVEL = 6
"""Level of gzip compression: its default, a good trade between size and time."""


def write_text(path: Path, lines: Iterable[bytes]) -> None:
    """Write lines beside `path`, then put the finished file in its place.

    Parameters
    ----------
    path : of the file; gzip-compressed if it ends in ``.gz``.
    lines : ASCII, each with its end of line; written one by one, so that few are in memory.

    Raises
    ------
    OutputError
        When the file cannot be written; a file that was there before is kept.
    """
    unfinished = path.with_name(f"{path.name}.part")
    try:
        with ExitStack() as files:
            raw = files.enter_context(unfinished.open("wb"))
            target: io.BufferedIOBase = raw
            if path.suffix.lower() == ".gz":
                # Neither time nor name in the header: same recording, same bytes.
                target = files.enter_context(
                    gzip.GzipFile(
                        filename="", mode="wb", fileobj=raw, mtime=0, compresslevel=COMPRESS_LEVEL
                    )
                )
            for line in lines:
                target.write(line)
        unfinished.replace(path)
    except BaseException as error:
        with suppress(OSError):
            unfinished.unlink(missing_ok=True)
        if isinstance(error, OSError):
            reason = error.strerror or error
            raise OutputError(f"cannot write {path}: {reason}; choose another place") from error
        raise
