# Two commands on a fresh machine with Python 3.11 or newer:
#
#   make demo    install into .venv, simulate an office floor, map it, name the map's picture
#   make test    install into .venv, check style, types and architecture, run the tests; installs
#                chromium for the tests of the viewer's page, where that is possible
#
# For development: make quick (a minute), make boundscheck, make coverage; make test-lowest checks
# the lowest versions of all dependencies that pyproject.toml admits.
#
# PYTHON chooses the interpreter, OUT the folder of the demo.

PYTHON ?= python3
OUT ?= cartoloop-demo
BIN := .venv/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet
SOURCES := src bench tests examples
# The extras "dds" and "oracles", one by one: not all of them have a wheel for each machine.
OPTIONAL := 'import tomllib; \
	extras = tomllib.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"]; \
	print(*extras["dds"], *extras["oracles"])'
KERNELS := 'from cartoloop.compile_ahead import compile_ahead; \
	from cartoloop.live.warm_up import warm_up; compile_ahead(); warm_up()'
LOCAL_KERNELS := 'from cartoloop.live.warm_up import warm_up; warm_up()'
# Tests of what depends on the libraries below: recordings, sockets, the view, the command line.
LOWEST_TESTS := tests/readers tests/map_file tests/live tests/viewer tests/cli/test_command_line.py \
	tests/test_kernel_cache.py tests/test_config_file.py

# Tests start hundreds of programs: these find modules compiled, whatever the environment says.
export PYTHONDONTWRITEBYTECODE =
# Threads of linear algebra wait for each other in loops, which takes a core from other tests.
export OPENBLAS_NUM_THREADS = 1

.PHONY: demo test test-lowest quick boundscheck coverage check kernels clean

demo: .venv/.installed
	$(BIN)/cartoloop demo -o $(OUT)

# Neither the check of types nor the first process that compiles kernels uses a second core. Three
# processes run the tests on two: they often wait for browsers and programs. Files of slow tests
# come first, as tests/conftest.py sorts them.
test: .venv/.installed-dev
	@$(MAKE) --no-print-directory --jobs=2 check kernels
	@$(MAKE) --no-print-directory boundscheck
	@tests/viewer/install_browser.sh
	$(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder

# Two processes compile at first, each what the other has not. Warnings of new libraries about old
# ones are no faults.
test-lowest: .venv-lowest/.installed
	.venv-lowest/bin/python -c $(KERNELS) & .venv-lowest/bin/python -c $(LOCAL_KERNELS); wait
	CI=1 .venv-lowest/bin/python -m pytest -q -n 2 --dist loadfile -W default -p no:cacheprovider \
		-m "not slow and not browser and not data" $(LOWEST_TESTS)

quick: .venv/.installed-dev
	$(BIN)/python -m pytest -n 2 --dist loadfile -m "not slow and not browser and not data"

# Kernels with checked indices: they are compiled for it, into a cache folder of their own, and
# optimized less, which takes less time.
boundscheck: .venv/.installed-dev
	NUMBA_BOUNDSCHECK=1 NUMBA_OPT=1 $(BIN)/python -m pytest -n 2 --dist loadfile -m "not slow" tests/kernels

# Lines of the product that the tests run; those of kernels without the compiler, which hides them.
coverage: .venv/.installed-dev
	$(BIN)/coverage run -m pytest -q -m "not slow and not browser and not data" tests
	NUMBA_DISABLE_JIT=1 $(BIN)/coverage run --append -m pytest -q -m "not slow and not data" \
		tests/kernels tests/pose_adjustment tests/submaps tests/map_output
	$(BIN)/coverage report

check: .venv/.installed-dev
	$(BIN)/ruff check $(SOURCES)
	$(BIN)/ruff format --check $(SOURCES)
	$(BIN)/mypy src bench
	$(BIN)/lint-imports

# Into the cache of the user, so that no test waits while another one compiles.
kernels: .venv/.installed-dev
	$(BIN)/python -c $(KERNELS)

clean:
	rm -rf .venv .venv-lowest

.venv/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "Python 3.11 or newer is needed: make PYTHON=/path/to/python3.11"; exit 1; }
	@$(PYTHON) -m venv .venv || { rm -rf .venv; exit 1; }

.venv/.installed: pyproject.toml | .venv/bin/python
	$(PIP) install -e .
	@touch $@

.venv/.installed-dev: pyproject.toml | .venv/bin/python
	$(PIP) install -e '.[dev]'
	@for optional in $$($(BIN)/python -c $(OPTIONAL)); do \
		$(PIP) install "$$optional" || \
			echo "$$optional cannot be installed here: the tests that need it are skipped"; \
	done
	@touch $@ .venv/.installed

.venv-lowest/.installed: pyproject.toml .ci/lowest.py | .venv/bin/python
	@rm -rf .venv-lowest
	@.venv/bin/python -m venv .venv-lowest
	.venv-lowest/bin/python -m pip --disable-pip-version-check --quiet install \
		$$(.venv-lowest/bin/python .ci/lowest.py plot test)
	.venv-lowest/bin/python -m pip --disable-pip-version-check --quiet install --no-deps -e .
	@touch $@
