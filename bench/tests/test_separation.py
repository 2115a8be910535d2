# SPDX-License-Identifier: Apache-2.0
"""The product does not depend on the benchmarks."""

import subprocess
import sys
from pathlib import Path

from cartoloop import _jit

BENCH = Path(__file__).parents[1]


def test_kernel_cache_key_covers_no_file_of_bench(monkeypatch):
    files, read_bytes = [], Path.read_bytes
    monkeypatch.setattr(Path, "read_bytes", lambda path: files.append(path) or read_bytes(path))
    _jit.kernel_cache_folder.__wrapped__()
    assert files
    assert not any(BENCH in file.parents for file in files)


def test_help_imports_no_benchmark_and_no_compiler():
    code = (
        "import sys; from bench.__main__ import run; status = run(['--help']);"
        "heavy = {'numba', 'scipy', 'bench.record'} & set(sys.modules);"
        "sys.exit(str(heavy) if heavy else status)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=BENCH.parent, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "Measure accuracy and speed" in done.stdout
