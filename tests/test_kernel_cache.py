# SPDX-License-Identifier: Apache-2.0
"""Kernels load from the cache without the compiler, and can still be inlined into others."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import cartoloop
from cartoloop import _jit

pytestmark = pytest.mark.slow

PROGRAM = """
import sys
import numpy as np
from cartoloop._jit import watch_compilation
from cartoloop.kernels.voxel_filter import adaptive_voxel_filter, voxel_filter

points = np.random.default_rng(0).uniform(-5.0, 5.0, (300, 2))
kept = np.zeros_like(points)
with watch_compilation(lambda: print("compiles")):
    print(voxel_filter(points, len(points), 0.5, kept), kept.sum())
    print("compiler ready:", "numba.np.arraymath" in sys.modules)
    print(adaptive_voxel_filter(points, 2.0, 100, 60.0, kept), kept.sum())
"""


TWO_SIGNATURES = """
import sys
import numpy as np
from cartoloop._jit import watch_compilation
from cartoloop.kernels.pixel_rows import add_span

wide, narrow = np.zeros((2, 3), dtype=np.int64), np.zeros((2, 3), dtype=np.uint32)
with watch_compilation(lambda: print("compiles")):
    add_span(wide, 1, 3, 70)
    add_span(narrow, 1, 3, 70)
print(np.array_equal(wide, narrow), int(wide.sum()))
"""


BORROWING = """
import numpy as np
from cartoloop._jit import borrowing_kernel, kernel

def total(numbers):
    result = 0.0
    for k in range(numbers.size):
        result += numbers[k]
    return result

def half(numbers):
    return borrowing(numbers[: numbers.size // 2])

borrowing, counting = borrowing_kernel(total), kernel(half)

@borrowing_kernel
def made(size):
    return np.zeros(size)

print(counting(np.ones(6)))
print("counts:", ["NRT_incref" in code for code in borrowing.inspect_llvm().values()])
try:
    made(3)
except Exception:
    print("refused")
"""


def _run(cache, program=PROGRAM):
    return subprocess.run(
        [sys.executable, "-c", program],
        env=os.environ | {"CARTOLOOP_CACHE_DIR": str(cache)},
        capture_output=True,
        text=True,
        check=True,
    ).stdout.splitlines()


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """Return for each program a cache that it filled, and what it printed."""
    caches = {}
    for program in (PROGRAM, TWO_SIGNATURES):
        cache = tmp_path_factory.mktemp("cache")
        caches[program] = cache, _run(cache, program)
    return caches


@pytest.fixture
def cache_of(compiled, tmp_path):
    """Return a function that returns a copy of such a cache, and what the program printed."""

    def copied(program):
        cache, printed = compiled[program]
        shutil.copytree(cache, tmp_path, dirs_exist_ok=True)
        return tmp_path, printed

    return copied


def test_kernels_from_the_cache_work_without_the_compiler(cache_of):
    cache, (compiles, once, ready, adaptive) = cache_of(PROGRAM)
    assert (compiles, ready) == ("compiles", "compiler ready: True")
    assert _run(cache) == [once, "compiler ready: False", adaptive]


def test_borrowing_kernels_count_no_references_and_make_none(tmp_path):
    assert _run(tmp_path, BORROWING) == ["3.0", "counts: [False]", "refused"]


def test_kernels_from_the_cache_can_be_inlined(cache_of):
    cache, (_, once, _, adaptive) = cache_of(PROGRAM)
    caller = [file for file in cache.rglob("*") if "adaptive_voxel_filter" in file.name]
    assert caller
    for file in caller:
        file.unlink()
    assert _run(cache) == [once, "compiler ready: False", "compiles", adaptive]


@pytest.mark.parametrize(("kind", "share"), [("*.nbi", 0.0), ("*.nbi", 0.5), ("*.nbc", 0.5)])
def test_damaged_files_of_the_cache_are_replaced(cache_of, kind, share):
    cache, first = cache_of(TWO_SIGNATURES)
    files = list(cache.rglob(kind))
    assert files
    for file in files:
        whole = file.read_bytes()
        file.write_bytes(whole[: int(share * len(whole))])
    assert _run(cache, TWO_SIGNATURES) == first
    assert _run(cache, TWO_SIGNATURES) == first[1:]


@pytest.mark.parametrize("kind", ["*.nbi", "*.nbc"])
def test_one_wrong_bit_has_kernels_compiled_again(cache_of, kind):
    cache, first = cache_of(TWO_SIGNATURES)
    for number, file in enumerate(sorted(cache.rglob(kind))):
        content = bytearray(file.read_bytes())
        content[len(content) * (number + 1) // 4] ^= 0x10
        file.write_bytes(content)
    assert _run(cache, TWO_SIGNATURES) == first


def test_a_file_of_another_signature_is_not_loaded(cache_of):
    cache, first = cache_of(TWO_SIGNATURES)
    assert first[0] == "compiles"
    one, other = sorted(cache.rglob("pixel_rows.add_span*.nbc"))
    shutil.copy(one, other)
    assert _run(cache, TWO_SIGNATURES) == first


def test_without_a_cache_folder_kernels_are_not_saved(tmp_path):
    no_folder = tmp_path / "file"
    no_folder.touch()
    package = tmp_path / "cartoloop"
    shutil.copytree(
        Path(cartoloop.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__")
    )
    environment = {"CARTOLOOP_CACHE_DIR": str(no_folder), "PYTHONPATH": str(tmp_path)}
    for _ in range(2):
        run = subprocess.run(
            [sys.executable, "-c", TWO_SIGNATURES],
            env=os.environ | environment,
            capture_output=True,
            text=True,
            check=True,
        )
        assert "compiles" in run.stdout
    assert not list(tmp_path.rglob("*.nb[ic]"))


def test_kernels_that_cannot_be_saved_still_run(tmp_path, monkeypatch):
    class Full:
        def load(self, key):
            return None

        def save(self, key, data):
            raise OSError(28, "No space left on device")

    @_jit.kernel
    def twice(number):
        return 2 * number

    monkeypatch.setattr(_jit, "kernel_cache_folder", lambda: tmp_path)
    monkeypatch.setattr(_jit._config, "CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(twice, "_cache", _jit._KernelCache(twice.py_func))
    monkeypatch.setattr(twice._cache, "_cache_file", Full())
    assert twice(3) == 6
    assert len(twice.signatures) == 1


def test_compiler_options_are_part_of_the_key(tmp_path, monkeypatch):
    source = tmp_path / "_jit.py"
    source.write_text("one")
    (tmp_path / "kernels").mkdir()
    monkeypatch.setattr(_jit, "__file__", str(source))
    before = _jit.kernel_cache_folder.__wrapped__()
    source.write_text("other")
    assert _jit.kernel_cache_folder.__wrapped__() != before


def test_whether_kernels_can_be_saved_is_known(tmp_path, monkeypatch):
    monkeypatch.setattr(_jit, "kernel_cache_folder", lambda: tmp_path / "new")
    assert _jit.can_keep_kernels()
    (tmp_path / "file").touch()
    monkeypatch.setattr(_jit, "kernel_cache_folder", lambda: tmp_path / "file" / "new")
    assert not _jit.can_keep_kernels()


def test_an_unknown_numba_caches_in_its_own_way(tmp_path):
    unknown = PROGRAM.replace(
        "from cartoloop.kernels",
        "from cartoloop import _jit\n_jit.TESTED_NUMBA = ((0, 0), (0, 1))\nfrom cartoloop.kernels",
    )
    compiles, once, _, adaptive = _run(tmp_path, unknown)
    assert compiles == "compiles"
    assert list(tmp_path.rglob("*.nbc"))
    assert [line for line in _run(tmp_path, unknown) if "compiler" not in line] == [once, adaptive]
