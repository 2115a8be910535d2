# SPDX-License-Identifier: Apache-2.0
"""The one place of Numba options and of the kernel cache.

Numba's own cache does not notice a change in a callee that lives in another file, and silently
runs stale code. Kernels are therefore cached in the user's cache folder, and nowhere else, under a
key made of a hash of the sources of all kernels, the compiler's version and the processor.

Nor does Numba's cache know that most runs compile nothing: it readies the compiler for whatever it
loads, for 0.3 s and 45 MB. `_KernelCache` leaves that to the first kernel that is not there. And
what is wrong with a file of the cache, or the disk, costs no more than compiling anew.
"""

from __future__ import annotations

import hashlib
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cache, lru_cache
from pathlib import Path
from time import perf_counter
from typing import Any, TypeVar, cast

import llvmlite.binding as llvm
import numba
from numba.core import caching, compiler, event, runtime, types

from cartoloop._kernel_folder import Turns, user_cache_folder

_KERNEL_BYTES = 1 << 20
"""More than any one kernel takes on the disk."""

_WAIT = "cartoloop:wait"
"""The event that another process compiles what this one needs."""

F = TypeVar("F", bound=Callable[..., Any])

# Numba is not typed, and its attributes are made at run time.
_config: Any = numba.config
_runtime: Any = runtime
_njit: Any = numba.njit
_unliteral: Any = types.unliteral
_rebuild: Any = compiler.CompileResult._rebuild


@lru_cache(maxsize=1)
def kernel_cache_folder() -> Path:
    """Return where the compiled kernels of exactly these sources are kept."""
    digest = hashlib.sha256(f"{numba.__version__} {sys.version}".encode())
    own = Path(__file__)  # how kernels are compiled
    for source in (own, *sorted(own.parent.joinpath("kernels").glob("*.py"))):
        digest.update(source.name.encode())
        digest.update(source.read_bytes())
    bounds_check = "-checked" if _config.BOUNDSCHECK else ""
    return user_cache_folder() / "kernels" / (digest.hexdigest()[:16] + bounds_check)


def inlined_kernel(function: F) -> F:
    """Compile `function` into each kernel that calls it, as if it were written there.

    Numba counts references to arrays around a call that the compiler does not inline by itself.
    """
    return _compiled(function, inline="always")


def kernel(function: F) -> F:
    """Compile `function` on its first call, without the GIL, cached on disk.

    No typed signatures (they compile at import), no fast-math (results must not depend on the
    compiler's mood), no parallel loops (threads belong to the caller), no way in for C, which
    nobody takes and which takes an eighth of the time to compile.
    """
    return _compiled(function)


def _compiled(function: F, **options: str) -> F:
    previous = _config.CACHE_DIR
    _config.CACHE_DIR = str(kernel_cache_folder())
    try:
        compile_with = _njit(nogil=True, error_model="numpy", no_cfunc_wrapper=True, **options)
        compiled = compile_with(function)
        if not _config.DISABLE_JIT:
            compiled.get_call_template = _without_literals(compiled.get_call_template)
        if not _config.DISABLE_JIT and (kept := _cache_of(function)) is not None:
            compiled._cache = kept
    finally:
        _config.CACHE_DIR = previous
    return cast(F, compiled)


def _without_literals(template: Callable[..., Any]) -> Callable[..., Any]:
    """Return what tells a caller's compilation of a kernel, for any number in place of a certain.

    A variable that starts as a certain number would have the kernel compiled for that one, for
    nothing: the next moment the variable turns out to hold others.
    """

    def with_types(args: Sequence[Any], kws: dict[str, Any]) -> object:
        return template(
            tuple(_unliteral(arg) for arg in args),
            {name: _unliteral(arg) for name, arg in kws.items()},
        )

    return with_types


def _cache_of(function: Callable[..., Any]) -> object | None:
    """Return the cache of a kernel, or None where the folder for it cannot be written."""
    try:
        kept = cast(Any, _KernelCache)(function)
    except RuntimeError:
        return None
    # Numba falls back to folders next to the sources, where kernels would become stale.
    return kept if kernel_cache_folder() in Path(kept.cache_path).parents else None


def can_keep_kernels() -> bool:
    """Return whether compiled kernels can be kept for the next run."""
    folder = kernel_cache_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as probe:
            probe.write(bytes(_KERNEL_BYTES))
    except OSError:
        return False
    return True


@lru_cache(maxsize=1)
def _turns(folder: Path) -> Turns:
    """Return whose turn it is to compile what is not in a folder."""
    return Turns(folder)


class _CompiledKernels(caching.CompileResultCacheImpl):
    """Makes kernels of what the files of the cache hold."""

    def rebuild(self, target_context: object, payload: Sequence[Any]) -> object:
        """Return the kernel, its intermediate code unread until it is compiled into another."""
        (name, kind, (machine_code, intermediate_code)), description, *rest = payload
        # Numba believes in no more functions than the intermediate code tells of.
        named = (description.llvm_func_name, description.llvm_cpython_wrapper_name)
        stand_in = "".join(f'define void @"{function}"() {{ ret void }}\n' for function in named)
        code = (name, kind, (machine_code, llvm.parse_assembly(stand_in).as_bitcode()))
        compiled = _rebuild(target_context, code, description, *rest)

        @cache
        def module_for_linking() -> object:
            return llvm.parse_bitcode(intermediate_code)

        compiled.library._get_module_for_linking = module_for_linking
        return cast(object, compiled)


class _KernelCache(caching.FunctionCache):
    """Loads kernels without readying the compiler for a compilation, which readies it itself.

    A kernel that is not there is compiled by one process alone, while others wait for it. They wait
    for no more than what it calls while they hold it themselves: not for each other.
    """

    _impl_class = _CompiledKernels

    def load_overload(self, sig: object, target_context: object) -> object:
        """Return the kernel of a signature, or None if the cache does not hold it.

        It is this process' turn to compile it then.
        """
        _runtime.rtsys.initialize(target_context)  # all that kernels themselves call
        turns = _turns(kernel_cache_folder())
        if (loaded := self._load(sig, target_context)) is not None:
            return loaded
        if turns.is_taken(self._kernel_name):
            trigger: Any = event.trigger_event
            with trigger(_WAIT):
                turns.wait(self._kernel_name)
        # Another process may have compiled it since.
        if (loaded := self._load(sig, target_context)) is not None:
            turns.give_back(self._kernel_name)
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
        except Exception:  # noqa: BLE001 - whatever a damaged file leads to
            self._forget()
            return None
        # Two processes that compile a kernel at once may take one name for two signatures.
        if loaded is None or loaded.signature.args != tuple(cast(Any, sig)):
            return None
        return cast(object, loaded)

    def save_overload(self, sig: object, data: object) -> None:
        """Keep a kernel for the next run; if the disk is full, that one compiles it anew."""
        with suppress(OSError):
            cast(Any, super()).save_overload(sig, data)
        _turns(kernel_cache_folder()).give_back(self._kernel_name)

    def _forget(self) -> None:
        """Have what there is of this kernel written anew."""
        with suppress(OSError):
            Path(cast(Any, self)._cache_file._index_path).unlink(missing_ok=True)


class CompileWatch(event.Listener):
    """Knows whether kernels are compiled, and how long this thread has been held up by it.

    Attributes
    ----------
    seconds : time that the thread which made the watch has spent compiling, or waiting for another
        process to compile [s].
    """

    def __init__(self, on_first: Callable[[], None]) -> None:
        self.seconds = 0.0
        self._on_first: Callable[[], None] | None = on_first
        self._thread = threading.get_ident()
        self._depth = 0
        self._start = 0.0

    def on_start(self, event: event.Event) -> None:
        """Note that a compilation begins; they nest, where kernels call others."""
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
    on_first : called, in whichever thread it is, when a kernel has to be compiled for the first
        time; never if all are in the cache.
    """
    watch = CompileWatch(on_first)
    install: Any = event.install_listener
    with install("numba:compile", watch), install(_WAIT, watch):
        yield watch
