# Everything runs in .venv, which the first target that needs it makes. Python 3.11 or later, with venv.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV := .venv
BIN := $(VENV)/bin
RUN ?=

.PHONY: run test lint bench clean

run: $(VENV)/.installed  ## drive a simulated robot from the keyboard; RUN="..." adds options
	@$(BIN)/python -m txt1 run --hal sim $(RUN)

test: $(VENV)/.dev  ## all tests
	$(BIN)/python -m pytest --numprocesses=2 --dist=worksteal

lint: $(VENV)/.dev  ## style, types, and who imports whom
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: $(VENV)/.dev  ## speed and punctuality, measured beside a peer or a limit
	$(BIN)/python -m benchmarks

clean:
	rm -rf $(VENV) build *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: $(VENV)/bin/python pyproject.toml
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable .
	@touch $@

$(VENV)/.dev: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@touch $@
