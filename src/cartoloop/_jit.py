# SPDX-License-Identifier: Apache-2.0
"""The one place of Numba options and of the kernel cache.

Numba's own cache does not notice a change in a callee in another file, and silently runs stale
code. Kernels are therefore cached in the user's cache folder, and nowhere else, under a key made of
a hash of the sources of all kernels, the compiler's version and the processor.

Numba's cache also initializes the compiler whenever it loads a kernel, for 0.3 s and 45 MB, though
most runs compile nothing. `_KernelCache` leaves that to the first kernel that is missing. A damaged
file or a full disk costs no more than compiling again: the files end with a checksum
(`_CheckedFiles`), because machine code with one wrong bit may crash the process.

`_KernelCache`, `_CheckedFiles` and `_without_literals` rely on parts of Numba that are not its
public interface.
They are used only with versions that they were tested with (`TESTED_NUMBA`); with any other version
Numba caches in its own way, in the same folder: slower to start, with the same results.
"""

from __future__ import annotations

import hashlib
import io
import os
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cache, cached_property, lru_cache
from pathlib import Path
from time import perf_counter
from typing import Any, TypeVar, cast

import llvmlite.binding as llvm
import numba
from numba.core import caching, compiler, event, runtime, types

from cartoloop.runtime.kernel_folder import KernelLocks, user_cache_folder

TESTED_NUMBA = ((0, 60), (0, 68))
"""First and last version of Numba whose internals are known; `pyproject.toml` has the same."""

_KERNEL_BYTES = 1 << 20
"""More than any kernel takes on the disk [bytes]."""

_CHECKSUM_BYTES = 16
"""At the end of each file of the cache [bytes]."""

_WAIT = "cartoloop:wait"
"""Event: another process compiles a kernel that this one needs."""

F = TypeVar("F", bound=Callable[..., Any])

# Numba is not typed, and creates attributes at run time.
_config: Any = numba.config
_runtime: Any = runtime
_njit: Any = numba.njit
_unliteral: Any = types.unliteral


@lru_cache(maxsize=1)
def kernel_cache_folder() -> Path:
    """Return the folder of the compiled kernels of exactly these sources."""
    digest = hashlib.sha256(f"{numba.__version__} {sys.version}".encode())
    own = Path(__file__)  # the options of the compiler
    for source in (own, *sorted(own.parent.joinpath("kernels").rglob("*.py"))):
        digest.update(source.relative_to(own.parent).as_posix().encode())
        digest.update(source.read_bytes())
    bounds_check = "-checked" if _config.BOUNDSCHECK else ""
    return user_cache_folder() / "kernels" / (digest.hexdigest()[:16] + bounds_check)


def inlined_kernel(function: F) -> F:
    """Compile `function` into each kernel that calls it, as if it were written there.

    Numba counts references to arrays around a call that the compiler does not inline by itself.
    """
    return _compiled(function, inline="always")


def borrowing_kernel(function: F) -> F:
    """Compile `function`, which makes no arrays and only uses those of its caller, as a kernel.

    Numba counts references to arrays in each kernel that is called, with atomic operations for
    which threads that share an array wait. This one does not count: its caller holds the arrays.
    """
    return _compiled(function, _nrt=False)


def kernel(function: F) -> F:
    """Compile `function` on its first call, without the GIL, cached on disk.

    No typed signatures (they compile at import), no fast-math (results must not depend on the
    compiler), no parallel loops (threads belong to the caller), no C entry points, which are not
    used and take an eighth of the time to compile.
    """
    return _compiled(function)


def _compiled(function: F, *, _nrt: bool = True, **options: str) -> F:
    # Memory management (`_nrt`) is stated, as kernels would inherit it from their callers.
    compile_with = _njit(
        nogil=True, error_model="numpy", no_cfunc_wrapper=True, _nrt=_nrt, **options
    )
    compiled = compile_with(function)
    if not _config.DISABLE_JIT:
        if knows_numba():
            compiled.get_call_template = _without_literals(compiled.get_call_template)
        compiled._cache = _CacheWhenUsed(function)
    return cast(F, compiled)


@cache
def knows_numba() -> bool:
    """Return whether the internals of the installed Numba are those that this module relies on."""
    first, last = TESTED_NUMBA
    version: Any = numba.version_info
    return (
        first <= tuple(version.short) <= last
        and hasattr(compiler.CompileResult, "_rebuild")
        and hasattr(caching.FunctionCache, "_load_overload")
        and hasattr(caching.IndexDataCacheFile, "_open_for_write")
    )


def _cache_of(function: Callable[..., Any]) -> Any:  # noqa: ANN401 - not typed
    """Return the cache of a kernel in the folder of kernels; one of nothing if it is not writable.

    Numba falls back to folders next to the sources, where kernels would become stale.
    """
    folder = kernel_cache_folder()
    previous = _config.CACHE_DIR
    _config.CACHE_DIR = str(folder)
    try:
        cached = cast(Any, _KernelCache if knows_numba() else caching.FunctionCache)(function)
    except RuntimeError:
        return caching.NullCache()
    finally:
        _config.CACHE_DIR = previous
    return cached if folder in Path(cached.cache_path).parents else caching.NullCache()


class _CacheWhenUsed:
    """The cache of a kernel, opened when the kernel is first called: a run calls one in four."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function

    @cached_property
    def _cache(self) -> Any:  # noqa: ANN401 - not typed
        return _cache_of(self._function)

    def __getattr__(self, name: str) -> object:
        return getattr(self._cache, name)


def _without_literals(template: Callable[..., Any]) -> Callable[..., Any]:
    """Return a call template by which kernels are compiled for types, not for literal values.

    A variable that is initialized with a literal would have the kernel compiled for that value,
    and again for the type when the variable turns out to change.
    """

    def with_types(args: Sequence[Any], kws: dict[str, Any]) -> object:
        return template(
            tuple(_unliteral(arg) for arg in args),
            {name: _unliteral(arg) for name, arg in kws.items()},
        )

    return with_types


def can_keep_kernels() -> bool:
    """Return whether compiled kernels can be saved for the next run."""
    folder = kernel_cache_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as probe:
            probe.write(bytes(_KERNEL_BYTES))
    except OSError:
        return False
    return True


@lru_cache(maxsize=1)
def _locks(folder: Path) -> KernelLocks:
    """Return the locks of the processes that share a folder."""
    return KernelLocks(folder)


class _Folder(caching.UserProvidedCacheLocator):
    """The folder of the kernels of one module."""

    def ensure_cache_path(self) -> None:
        """Raise an OSError if the folder cannot be written; Numba would write a file each time."""
        path = Path(cast(Any, self).get_cache_path())
        path.mkdir(parents=True, exist_ok=True)
        if not os.access(path, os.W_OK):
            raise PermissionError(f"{path}: cannot be written")


class _CompiledKernels(caching.CompileResultCacheImpl):
    """Makes kernels from the contents of cache files."""

    _locator_classes: list[Any] = [_Folder]  # noqa: RUF012 - as Numba declares it

    def rebuild(self, target_context: object, payload: Sequence[Any]) -> object:
        """Return the kernel; its intermediate code is parsed when another kernel inlines it."""
        (name, kind, (machine_code, intermediate_code)), description, *rest = payload
        # Numba looks for these functions in the intermediate code: an empty module defines them.
        named = (description.llvm_func_name, description.llvm_cpython_wrapper_name)
        stand_in = "".join(f'define void @"{function}"() {{ ret void }}\n' for function in named)
        code = (name, kind, (machine_code, llvm.parse_assembly(stand_in).as_bitcode()))
        rebuild: Any = cast(Any, compiler.CompileResult)._rebuild
        compiled = rebuild(target_context, code, description, *rest)

        @cache
        def module_for_linking() -> object:
            return llvm.parse_bitcode(intermediate_code)

        compiled.library._get_module_for_linking = module_for_linking
        return cast(object, compiled)


class _DamagedFileError(Exception):
    """The checksum of a file of the cache does not fit."""


class _CheckedFiles(caching.IndexDataCacheFile):
    """Numba's files of one kernel, each followed by a checksum that is compared before loading.

    Numba reads up to the end of what it wrote, so the checksum does not disturb it.
    """

    def _load_index(self) -> object:
        with suppress(FileNotFoundError):
            _check_file(Path(cast(Any, self)._index_path))
        return cast(Any, super())._load_index()

    def _load_data(self, name: str) -> object:
        _check_file(Path(cast(Any, self)._data_path(name)))
        return cast(Any, super())._load_data(name)

    @contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[io.BytesIO]:
        with cast(Any, super())._open_for_write(filepath) as file:
            content = io.BytesIO()
            yield content
            file.write(content.getvalue() + _checksum(content.getvalue()))


def _check_file(path: Path) -> None:
    content = path.read_bytes()
    if _checksum(content[:-_CHECKSUM_BYTES]) != content[-_CHECKSUM_BYTES:]:
        raise _DamagedFileError(str(path))


def _checksum(content: bytes) -> bytes:
    return hashlib.blake2b(content, digest_size=_CHECKSUM_BYTES).digest()


class _KernelCache(caching.FunctionCache):
    """Loads kernels without initializing the compiler, and locks them between processes.

    A missing kernel is compiled by one process, while others wait for it. Kernels are locked in the
    order in which they call each other, so processes cannot wait for each other.
    """

    _impl_class = _CompiledKernels

    def __init__(self, function: Callable[..., Any]) -> None:
        base: Any = super()
        base.__init__(function)
        numbas: Any = self._cache_file
        self._cache_file: Any = cast(Any, _CheckedFiles)(
            numbas._cache_path, self._kernel_name, numbas._source_stamp
        )

    def load_overload(self, sig: object, target_context: object) -> object:
        """Return the kernel of a signature, or None if it is missing; it is locked then."""
        _runtime.rtsys.initialize(target_context)  # what kernels call at run time
        locks = _locks(kernel_cache_folder())
        if (loaded := self._load(sig, target_context)) is not None:
            return loaded
        if not locks.acquire(self._kernel_name):
            trigger: Any = event.trigger_event
            with trigger(_WAIT):
                locks.wait(self._kernel_name)
        # Another process may have compiled it since.
        if (loaded := self._load(sig, target_context)) is not None:
            locks.release(self._kernel_name)
        return loaded

    @property
    def _kernel_name(self) -> str:
        return cast(str, cast(Any, self)._impl.filename_base)

    def _load(self, sig: object, target_context: object) -> object:
        base = cast(Any, self)
        try:
            loaded = base._load_overload(sig, target_context)
        except OSError:
            return None
        except Exception:  # noqa: BLE001 - a damaged file may raise anything
            self._forget()
            return None
        # Two processes may have used one file name for two signatures.
        if loaded is None or loaded.signature.args != tuple(cast(Any, sig)):
            return None
        return cast(object, loaded)

    def save_overload(self, sig: object, data: object) -> None:
        """Save a kernel for the next run, which compiles it again if the disk is full."""
        with suppress(OSError):
            cast(Any, super()).save_overload(sig, data)
        _locks(kernel_cache_folder()).release(self._kernel_name)

    def _forget(self) -> None:
        """Remove the index of this kernel, so that its files are written again."""
        with suppress(OSError):
            Path(cast(Any, self)._cache_file._index_path).unlink(missing_ok=True)


class CompileWatch(event.Listener):
    """Measures the time that a thread spends compiling kernels.

    Attributes
    ----------
    seconds : time that the thread which created the watch has spent compiling, or waiting for
        another process to compile [s].
    """

    def __init__(self, on_first: Callable[[], None]) -> None:
        self.seconds = 0.0
        self._on_first: Callable[[], None] | None = on_first
        self._thread = threading.get_ident()
        self._depth = 0
        self._start = 0.0

    def on_start(self, event: event.Event) -> None:
        """Note that a compilation begins; compilations nest where kernels call others."""
        if self._on_first is not None:
            on_first, self._on_first = self._on_first, None
            on_first()
        if threading.get_ident() == self._thread:
            if self._depth == 0:
                self._start = perf_counter()
            self._depth += 1

    def on_end(self, event: event.Event) -> None:
        """Note that a compilation ends."""
        if threading.get_ident() == self._thread:
            self._depth -= 1
            if self._depth == 0:
                self.seconds += perf_counter() - self._start


@contextmanager
def watch_compilation(on_first: Callable[[], None]) -> Iterator[CompileWatch]:
    """Yield a watch over the compiler while the body runs.

    Parameters
    ----------
    on_first : called when the first kernel has to be compiled, in the thread that compiles it;
        never if all are in the cache.
    """
    watch = CompileWatch(on_first)
    install: Any = event.install_listener
    with install("numba:compile", watch), install(_WAIT, watch):
        yield watch
