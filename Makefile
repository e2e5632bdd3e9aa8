# Everything runs in .venv, which the first target that needs it makes. Python 3.11 or later, with venv.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV := .venv
BIN := $(VENV)/bin
RUN ?=
HEADERS := "import os, sys, sysconfig; sys.exit(not os.path.exists(sysconfig.get_path('include') + '/Python.h'))"

.PHONY: run test test-sources compiled lint bench clean

run: $(VENV)/.installed  ## drive a simulated robot from the keyboard; RUN="..." adds options
	@$(BIN)/python -m txt1 run --hal sim $(RUN)

test: compiled  ## all tests, of the compiled modules where there is a C compiler
	$(BIN)/python -m pytest --numprocesses=2 --dist=worksteal

test-sources: $(VENV)/.dev  ## the tests that concern these modules, without compiling
	PURE_PYTHON=1 $(BIN)/python -m pytest --numprocesses=2 --dist=worksteal tests/unit/kernel tests/unit/sim \
		tests/unit/control tests/unit/tasks tests/unit/model tests/unit/learning \
		tests/e2e/test_safety.py tests/e2e/test_closed_loop.py

compiled: $(VENV)/.dev  ## tasks, physics and learners made into C (a minute): simulations run two to three times as fast
	@if command -v cc >/dev/null && $(BIN)/python -c $(HEADERS); then $(BIN)/python setup.py --quiet build_ext --inplace; \
	else echo "no C compiler (cc) or no Python.h: everything runs from its Python source, at a half to a third of the speed"; fi

lint: $(VENV)/.dev  ## style, types, and who imports whom
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: compiled  ## speed and punctuality, measured beside a peer or a limit
	$(BIN)/python -m benchmarks

clean:
	find txt1 -name '*.so' -delete
	rm -rf $(VENV) build *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: $(VENV)/bin/python pyproject.toml
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable .
	@touch $@

$(VENV)/.dev: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@touch $@
