# Everything runs in .venv, which `make setup` makes once and again whenever the pins change. For another Python beside it:
# make PYTHON=python3.13 VENV=build/venv-3.13 test
PYTHON ?= python3
VENV ?= .venv
SHELL := /bin/bash
.SHELLFLAGS := -o pipefail -c
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
# What pip is at, a line for each step; errors go past it.
PROGRESS := -e 's/^  Installing build dependencies: started/  gets the compiler of the loops/p' \
  -e 's/^Collecting \([A-Za-z0-9_.-]*\).*/  gets \1/p' \
  -e 's/^  Building editable .*started/  compiles the loops/p' \
  -e 's/^Installing collected packages.*/  installs all of them/p'

.PHONY: setup run test check format compiled bench bench-compiled properties properties-compiled fuzz mutants acceptance chaos soak study clean

setup: $(STAMP)

$(STAMP): pyproject.toml constraints.txt setup.py deploy/build_backend.py bus/built.py bus/built.pxi $(wildcard */_*.pyx */*/_*.pyx)
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "Python 3.11 or newer is needed: make PYTHON=/path/to/python3.11 $(MAKECMDGOALS)" >&2; exit 2; }
	@test -x $(BIN)/python || { echo "setup, 1 of 2: makes $(VENV)"; $(PYTHON) -m venv $(VENV); }
	@echo "setup, 2 of 2: compiles the loops and installs what constraints.txt pins; takes a minute or two"
	@PIP_CONSTRAINT=constraints.txt $(BIN)/python -m pip install --disable-pip-version-check --progress-bar off -e '.[dev,study]' | sed -u -n $(PROGRESS)
	touch $@

run: setup
	$(BIN)/python deploy/run_local.py --robots 9 $(ARGS)

test: setup
	$(BIN)/python -m pytest $(ARGS)

check: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

format: setup
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

# The same program with its cores compiled (needs a C compiler and some minutes): build/compiled/deploy/run_local.py, and so on.
compiled: setup
	rm -rf build/compiled build/lib* build/temp*
	VDS_COMPILED=all $(BIN)/python setup.py -q build --build-lib build/compiled

# Longer measurements.
bench: setup
	$(BIN)/python -m tests.bench $(ARGS)

bench-compiled: compiled
	cd build/compiled && PYTHONPATH=$(CURDIR) $(CURDIR)/$(BIN)/python -m tests.bench $(ARGS)

# All property tests with twenty times their examples. ARGS='-k no_loop --examples-times 2000' is the long run of routing.
properties: setup
	$(BIN)/python -m pytest -m hypothesis --examples-times 20 --timeout 0 $(ARGS)

properties-compiled: compiled
	cd build/compiled && PYTHONPATH=$(CURDIR) $(CURDIR)/$(BIN)/python -m pytest $(CURDIR)/tests -c $(CURDIR)/pyproject.toml -m hypothesis --examples-times 20 --timeout 0 $(ARGS)

# A million messages, texts and files that are none. ARGS='--inputs 10000 --seed 7', or '--batch 1234' for one of its batches again.
fuzz: setup
	$(BIN)/python -m tests.fuzz $(ARGS)

# Changes the rules one at a time and says which change no test notices (docs/tests.md). ARGS='planted', or
# 'generated --share 0.1 --seed 1', or '--only agents/nms.py'.
mutants: setup
	$(BIN)/python -m tests.mutants $(ARGS)

acceptance: setup
	mkdir -p build
	$(BIN)/python -m tests.acceptance $(ARGS) | tee build/acceptance.md
	@$(if $(ARGS),echo "docs/acceptance.md stays: this is not the whole of it",mv build/acceptance.md docs/acceptance.md)

# Trouble for 200 short runs, then five long missions. ARGS='--runs 20 --seed 7 --only robots_die' are some of them.
chaos: setup
	$(BIN)/python -m tests.chaos $(ARGS)

# A day of simulated time on real processes, with a fault every 30 s: memory by process. ARGS='--hours 0.2' for a short one.
soak: setup
	$(BIN)/python -m tests.soak $(ARGS)

study: setup
	$(BIN)/python deploy/study.py $(or $(ARGS),fig6 fig7 --quick)

clean:
	rm -rf build dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
