# SPDX-License-Identifier: Apache-2.0
"""The one place of Numba options and of the kernel cache.

Numba's own cache does not notice a change in a callee that lives in another file, and silently
runs stale code. Kernels are therefore cached in the user's cache folder under a key made of a
hash of the sources of all kernels, the compiler's version and the processor.
"""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])

_config: Any = numba.config  # its attributes are made at run time


def _user_cache_folder() -> Path:
    """Return the folder for cached data that the operating system gives the user."""
    if configured := os.environ.get("CARTOLOOP_CACHE_DIR"):
        return Path(configured)
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", Path.home())) / "cartoloop"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "cartoloop"
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "cartoloop"


@lru_cache(maxsize=1)
def kernel_cache_folder() -> Path:
    """Return where the compiled kernels of exactly these sources are kept."""
    digest = hashlib.sha256(f"{numba.__version__} {sys.version}".encode())
    for source in sorted(Path(__file__).parent.joinpath("kernels").glob("*.py")):
        digest.update(source.name.encode())
        digest.update(source.read_bytes())
    bounds_check = "-checked" if _config.BOUNDSCHECK else ""
    return _user_cache_folder() / "kernels" / (digest.hexdigest()[:16] + bounds_check)


def kernel(function: F) -> F:
    """Compile `function` on its first call, without the GIL, cached on disk.

    No typed signatures (they compile at import), no fast-math (results must not depend on the
    compiler's mood), no parallel loops (threads belong to the caller).
    """
    previous = _config.CACHE_DIR
    _config.CACHE_DIR = str(kernel_cache_folder())
    try:
        compiled = numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    finally:
        _config.CACHE_DIR = previous
    return cast(F, compiled)
