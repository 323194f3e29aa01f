# `make demo` and `make test` do all the set-up: each creates the virtual environment from plain python3.
PYTHON ?= python3
# Test workers: a number, or auto for two more than the cores at hand (eight at most).
WORKERS ?= auto
VENV := .venv
BIN := $(VENV)/bin
export PIP_DISABLE_PIP_VERSION_CHECK := 1
# Modules are stored compiled when first imported, not all on installation: a third of the time until the first dive.
INSTALL := pip install --quiet --no-compile
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help setup compile demo test test-all test-quick test-random test-lowest fuzz check types uncompiled bench wheel sbom fortran docs clean

help:  ## list the targets
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 14

$(VENV)/run: pyproject.toml
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(0 if (3, 11) <= v <= (3, 14) else f"gliderhpc needs Python 3.11 to 3.14, and {sys.executable} is {v[0]}.{v[1]}; name another with make PYTHON=python3.12")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/$(INSTALL) --editable .
	@touch $@

$(VENV)/bench: $(VENV)/dev
	$(BIN)/$(INSTALL) --editable '.[dev,bench]'
	@touch $@

$(VENV)/docs: $(VENV)/run
	$(BIN)/$(INSTALL) --editable '.[docs]'
	@touch $@

$(VENV)/dev: $(VENV)/run
	$(BIN)/$(INSTALL) --editable '.[dev,docs]'
	@touch $@

$(VENV)/compliance: $(VENV)/dev
	$(BIN)/$(INSTALL) --editable '.[dev,docs,compliance]'
	@touch $@

setup: $(VENV)/dev  ## make the environment of a developer in .venv

compile: $(VENV)/run  ## compile the kernels, which otherwise the first run does
	$(BIN)/python -m gliderhpc.mission.warm kernels simulator

demo: $(VENV)/run  ## simulate a mission, invert and study it, report on it (under 3 minutes)
	$(BIN)/gliderhpc demo --out demo

test: $(VENV)/dev  ## run the tests on all cores (WORKERS=2 for two), but for the longest ones
	$(BIN)/python -m pytest -n $(WORKERS) -m 'not long' --durations=10

test-all: $(VENV)/dev  ## run all tests, with every command of the documentation, before a release
	$(BIN)/python -m pytest -n $(WORKERS) --durations=10

test-quick: $(VENV)/dev  ## run the quick tests, before each commit (under 90 seconds)
	$(BIN)/python -m pytest -n $(WORKERS) -m 'not slow' -q

test-random: $(VENV)/dev  ## run the tests in a random order (SEED=1 repeats one)
	$(BIN)/python -m pytest -n $(WORKERS) -p randomly $(if $(SEED),--randomly-seed=$(SEED))

# The lowest versions' own warnings of newer companions (numpy's headers, pyparsing's names) are not ours to mend.
test-lowest:  ## run the quick tests with the lowest versions allowed, in a separate environment
	$(PYTHON) -m venv .venv-lowest
	.venv-lowest/bin/$(INSTALL) -c constraints-lowest.txt . filelock hypothesis \
		pytest pytest-cov pytest-randomly pytest-timeout pytest-xdist websocket-client
	.venv-lowest/bin/python -m pytest -n $(WORKERS) -m 'not slow' -q \
		-W 'ignore:numpy.ndarray size changed' -W ignore::DeprecationWarning

# A longer run, another seed, another tree: make fuzz SECONDS=3600 SEED=7 TREE=../release-0.1.0
fuzz: $(VENV)/dev  ## feed unusual inputs to every parser and command, and kill the long ones (SECONDS=600, SEED=0, TREE=.)
	$(BIN)/python -m benchmarks.fuzz --seconds $(or $(SECONDS),600) --seed $(or $(SEED),0) $(if $(TREE),--tree $(TREE))

# The types, which one process checks in most of a minute, are checked while the kernels' tests run.
check: $(VENV)/dev  ## check lint, types, layers, and the kernels' coverage with the compiler off
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports
	$(MAKE) --jobs=2 --keep-going types uncompiled

types: $(VENV)/dev
	$(BIN)/mypy

uncompiled: $(VENV)/dev
	NUMBA_DISABLE_JIT=1 $(BIN)/python -m pytest -n $(WORKERS) --dist worksteal -q --cov=gliderhpc/kernels --cov-branch --cov-fail-under=95 \
		$(addprefix tests/kernels/test_, elementary.py dynamics.py adjoint.py filter_kernels.py moving_water.py lane_type.py \
			lane_window.py line_search.py quasi_newton.py smoother_kernels.py fortran.py compiled_cache.py cache_folder.py \
			sensitivity.py follow.py precompiled.py compiler.py)

bench: $(VENV)/bench  ## time the engines against their peers, and Fortran against Numba; writes the README's section
	$(BIN)/python -m benchmarks.run
	if command -v gfortran >/dev/null; then \
		$(MAKE) fortran && $(BIN)/python -m benchmarks.fortran; \
	else echo "no gfortran here: docs/fortran.md stays as it is"; fi

# Of another compiler or processor: make fortran FC=gfortran-13 FFLAGS='-O3 -march=haswell' LANES=4. The environment's FC
# and FFLAGS are meant for other programs and not taken.
option = $(if $(findstring command,$(origin $(1))),$(2)='$($(1))')
fortran: $(VENV)/run  ## compile the Fortran kernels (FC=, FFLAGS=, LANES=) and compare them with Numba's
	$(BIN)/python -m gliderhpc.kernels.fortran.build $(call option,FC,--compiler) $(call option,FFLAGS,--flags) $(call option,LANES,--lanes)
	$(if $(call option,LANES),,$(BIN)/python -m gliderhpc.estimation.fortran_check)

# The same sources and versions give the same bytes. LEVELS='x86-64-v3 x86-64-v2' names other levels of processors.
wheel: $(VENV)/dev  ## build a wheel with compiled kernels into dist/, for this Python and this numba
	$(BIN)/python -m gliderhpc.mission.precompile build/kernels $(LEVELS)
	GLIDERHPC_KERNELS=$(CURDIR)/build/kernels $(BIN)/python -m build --no-isolation --wheel

# Every package that an empty environment gets from the wheel, with versions, licences and where they come from.
sbom:  ## write the bill of materials (CycloneDX) of the wheel in dist/ into dist/
	@ls dist/gliderhpc-*.whl >/dev/null 2>&1 || { echo "no wheel in dist/; make wheel builds one"; exit 1; }
	rm -rf build/bare build/cyclonedx
	$(PYTHON) -m venv build/bare
	build/bare/bin/$(INSTALL) --constraint constraints-dev.txt dist/gliderhpc-*.whl
	$(PYTHON) -m venv build/cyclonedx
	build/cyclonedx/bin/$(INSTALL) cyclonedx-bom
	build/cyclonedx/bin/cyclonedx-py environment --pyproject pyproject.toml --output-reproducible \
		--output-file dist/gliderhpc.cdx.json build/bare/bin/python

docs: $(VENV)/docs  ## build the documentation into site/, warnings as errors
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict

clean:  ## remove the environment and everything made
	rm -f gliderhpc/kernels/fortran/*.so
	rm -rf $(VENV) demo site build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache .coverage
