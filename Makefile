# Everything runs in .venv, which the first target that needs it makes. Python 3.11 or later, with venv.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
# Where no bytecode may be kept, each process of the tests compiles all of txt1 anew: half a minute more.
unexport PYTHONDONTWRITEBYTECODE
VENV := .venv
BIN := $(VENV)/bin
BENCH := .venv-bench
ROS2 := $(CURDIR)/.venv-ros2
KILTED ?= $(CURDIR)/.venv-ros2-kilted
CYCLONEDDS := $(CURDIR)/.venv-ros2-cyclonedds
COLCON := $(CURDIR)/.venv-ros2-colcon
VIEWERS := .venv-viewers
APART := build/apart/env
LEROBOT ?= $(CURDIR)/.venv-lerobot/bin/python
ROS1 := python3-rospy python3-rosmaster python3-rostopic python3-rosservice python3-tf python3-nav-msgs python3-rosbag python3-roslaunch ros-std-msgs python3-genpy libroscpp-dev libtf-dev libnav-msgs-dev python3-gencpp
FUZZ := .venv-fuzz
SBOM := .venv-sbom
DOCS := .venv-docs
# distributions of their own that the tests need, each with its tests
PLUGINS := plugins/learners plugins/physics plugins/ros1 plugins/lerobot plugins/browser
NEEDS = import sys, tomllib; project = tomllib.load(open("pyproject.toml", "rb"))["project"]; extras = project["optional-dependencies"]; print(*(need for name in sys.argv[1:] for need in (extras.get(name) or project[name])), sep="\n")
PIP_INSTALL := -m pip install --quiet --quiet --disable-pip-version-check
PIP_FETCH := -m pip --disable-pip-version-check wheel --quiet --quiet
PIP_WHEEL := -m pip --disable-pip-version-check wheel --quiet --quiet --no-deps --no-build-isolation
TEST_APART = $(APART)/bin/python -m pytest --numprocesses=$(JOBS) --dist=worksteal
# of `make test`: each collects all tests, 5 s of a processor; one that waits leaves the processors to the others
JOBS ?= 6
APART_TESTS ?= tests
RUN ?=
STEADY ?=
WEB ?= tests/browser
# the last release: its tag, or the commit that made the version
BEFORE ?= $(shell git describe --tags --abbrev=0 2>/dev/null || git log -1 --format=%h --grep='^Version [0-9]')
BARE ?=
TRIAL ?=
VERSION ?= dev
ALIAS ?=
MIKE ?=

.PHONY: run test coverage test-long test-plugins test-web test-ros test-viewers test-lerobot steady try-bare lint types style imports wheel release constraints torture bench bench-before docs docs-serve docs-version docs-links build/drive clean

# The first screen waits for what the drive needs. txt1 itself, and what draws pictures of a drive, are installed beside it.
run: $(VENV)/.drives  ## drive a simulated robot from the keyboard or the page; RUN="..." adds options
	@nice -n 10 $(MAKE_COMMAND) --silent $(VENV)/.installed >/dev/null 2>&1 & \
	$(BIN)/python -m txt1 run --practice $(RUN); ended=$$?; \
	test -e $(VENV)/.installed || echo "installing txt1, and what draws pictures of a drive; Ctrl-C leaves it for the next time"; \
	wait; \
	test $$ended = 0 || test $$ended = 130 || exit $$ended  # Ctrl-C ends a drive, and is no error

test: $(VENV)/.dev  ## the tests, six at a time
	$(BIN)/python -m pytest --numprocesses=$(JOBS) --dist=worksteal

test-long: $(VENV)/.dev  ## the long tests, too: many repetitions, long runs, and the compiled wheel
	$(BIN)/python -m pytest --numprocesses=2 --dist=worksteal --hypothesis-profile=others -m "not browser"

coverage: $(VENV)/.dev  ## the tests, and the statements of txt1 and its plug-ins that they run, printed; slow before Python 3.14
	$(BIN)/python $(PIP_INSTALL) --group coverage
	$(BIN)/python -m pytest --numprocesses=2 --dist=worksteal --cov=txt1 $(PLUGINS:plugins/%=--cov=plugins/%) --cov-report=term:skip-covered

# The environment has the packages of $(VENV), so nothing is resolved anew. Tests of tests/ run against the sources of txt1,
# without a plug-in; those of plug-ins against the wheels, as PYTHONSAFEPATH keeps the tree from coming before them.
test-plugins: $(VENV)/.dev  ## all other tests without any plug-in, then those of each plug-in, its wheel alone beside txt1's
	rm -rf build plugins/*/build && mkdir build
	$(BIN)/python -m pip --disable-pip-version-check freeze --all --exclude-editable > build/packages.txt
	$(BIN)/python $(PIP_WHEEL) --wheel-dir build/apart/txt1 .
	@for each in $(notdir $(PLUGINS)); do $(BIN)/python $(PIP_WHEEL) --wheel-dir build/apart/$$each ./plugins/$$each || exit 1; done
	$(PYTHON) -m venv $(APART)
	$(APART)/bin/python $(PIP_INSTALL) --no-deps --requirement build/packages.txt
	$(APART)/bin/python $(PIP_INSTALL) --no-deps --no-build-isolation --editable .
	pwd > $$($(APART)/bin/python -c "import sysconfig; print(sysconfig.get_path('purelib'))")/tree.pth
	rm -rf $(APART)/lib/python*/site-packages/tests  # of pyvesc-fix, which would come before the tree's
	$(TEST_APART) $(APART_TESTS)
	$(APART)/bin/python $(PIP_INSTALL) --no-deps --force-reinstall build/apart/txt1/*.whl
	@for each in $(notdir $(PLUGINS)); do \
		$(APART)/bin/python $(PIP_INSTALL) build/apart/$$each/*.whl && PYTHONSAFEPATH=1 $(TEST_APART) plugins/$$each/tests || exit 1; \
		$(APART)/bin/python -m pip uninstall --quiet --yes $$(basename build/apart/$$each/*.whl | cut -d- -f1) || exit 1; \
	done

test-web: $(VENV)/.dev  ## the web page in a real browser, Debian's chromium, installed where that is possible; one to six minutes; WEB= is a part of it
	$(BIN)/python $(PIP_INSTALL) --group browser
	@command -v chromium >/dev/null || (apt-get update && apt-get install --yes chromium) >/dev/null 2>&1 || true
	$(BIN)/python -m pytest -m browser -rs $(WEB)

test-ros: $(VENV)/.dev  ## the bridges to ROS beside real peers: ROS 2 from wheels, ROS 1 from Debian, installed where possible
	@command -v rosmaster >/dev/null && test -e /usr/include/ros/ros.h || (apt-get update && apt-get install --yes --no-install-recommends $(ROS1)) >/dev/null 2>&1 || true
	@TXT1_ROS2_HOME=$(ROS2) $(BIN)/python -m txt1 ros2 install || true
	@test -z "$(KILTED)" || TXT1_ROS2_HOME=$(KILTED) $(BIN)/python -m txt1 ros2 install --distribution kilted || true
	@test -e $(CYCLONEDDS)/cyclonedds || $(BIN)/python $(PIP_INSTALL) --target $(CYCLONEDDS) cyclonedds==11.0.1 || true
	@test -e $(COLCON)/bin/colcon || { $(PYTHON) -m venv $(COLCON) && $(COLCON)/bin/python $(PIP_INSTALL) colcon-core==0.21.3 colcon-ros==0.5.0 colcon-package-information==0.4.1 colcon-package-selection==0.2.10 'setuptools<80'; } || true
	TXT1_ROS2_HOME=$(ROS2) TXT1_ROS2_OTHER=$(KILTED) TXT1_CYCLONEDDS=$(CYCLONEDDS) TXT1_COLCON=$(COLCON)/bin $(BIN)/python -m pytest --numprocesses=2 --dist=worksteal -m long -rs tests/ros plugins/ros1/tests

test-viewers: $(VENV)/.dev  ## a recording in the viewers that PyPI has, in an environment of their own
	@test -e $(VIEWERS)/bin/rerun || { $(PYTHON) -m venv $(VIEWERS) && $(VIEWERS)/bin/python $(PIP_INSTALL) rerun-sdk==0.41.0; } || true
	TXT1_VIEWERS=$(CURDIR)/$(VIEWERS)/bin $(BIN)/python -m pytest -m long -rs tests/viewers

test-lerobot: $(VENV)/.dev  ## LeRobot's commands with plugins/lerobot; LEROBOT= is a Python that has both, which nobody installs here
	TXT1_LEROBOT=$(wildcard $(LEROBOT)) $(BIN)/python -m pytest -m long -rs plugins/lerobot/tests

steady: $(VENV)/.dev  ## repeats the tests, none of which may fail: those that wait 20 times, also beside busy loops, all tests 5 times; 90 minutes, resumes
	$(BIN)/python -m tests.steady $(STEADY)

try-bare: $(VENV)/.dev  ## the first hour in a bare Debian root, typed and timed; root, debootstrap and a network; minutes
	$(BIN)/python tests/bare.py $(BARE)

lint: $(VENV)/.dev  ## style, types, and who imports whom, two at a time
	@$(MAKE) --no-print-directory --jobs=2 --output-sync types style imports

types:
	$(BIN)/mypy

style:
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

imports:
	$(BIN)/lint-imports
	@mkdir -p build; $(BIN)/python -m tests.arrows > build/arrows.txt || { tail -20 build/arrows.txt; false; }

wheel: $(VENV)/.dev  ## dist/*.whl, compiled by mypyc: simulations run two to three times as fast; takes a minute
	rm -rf build dist
	COMPILE_TXT1=1 $(BIN)/python $(PIP_WHEEL) --wheel-dir dist .

release: lint test wheel constraints  ## dist/ as a release has it: wheels, sdist, constraints.txt of the tested versions, their bill of materials, SHA256SUMS; tries them
	$(BIN)/python -m rigs.release sums dist
	$(BIN)/python rigs/release_trial.py dist $(TRIAL)

# What the tests do without, as they have fakes of it, is installed for a user with all extras: but for PyTorch and what needs it.
constraints: $(VENV)/.dev $(SBOM)/.installed  ## wheels without compiled parts, sdist, constraints.txt and its bill of materials, into dist/
	rm -rf build plugins/*/build && mkdir build
	$(BIN)/python $(PIP_WHEEL) --wheel-dir dist . $(PLUGINS:%=./%)
	$(BIN)/python -c "from setuptools.build_meta import build_sdist; build_sdist('dist')" > build/sdist.txt
	$(BIN)/python -m pip --disable-pip-version-check freeze --all --exclude-editable > build/packages.txt
	$(PYTHON) -m venv build/users
	build/users/bin/python $(PIP_INSTALL) --constraint build/packages.txt "$$(ls dist/txt1-*-none-any.whl)[all]" "$$(ls dist/txt1_learners-*.whl)[dask]" dist/txt1_[!l]*.whl dist/lerobot_*.whl
	$(BIN)/python -m rigs.release constraints dist/constraints.txt build/users/bin/python
	$(SBOM)/bin/cyclonedx-py requirements dist/constraints.txt --pyproject pyproject.toml --output-reproducible -o dist/txt1.cdx.json

torture: $(VENV)/.dev $(FUZZ)/.dev  ## faults, mutants and random bytes in great numbers, into docs/results/reliability.md; hours, and it can be ended and goes on
	$(BIN)/python -m torture campaign --page
	$(FUZZ)/bin/python -m torture fuzz --page
	$(BIN)/python -m torture processes --page
	$(BIN)/python -m torture soak --page
	$(BIN)/python -m torture mutation --page

bench: wheel $(BENCH)/.dev  ## speed and punctuality of the compiled wheel, beside peers or limits, into out/bench.txt
	$(BENCH)/bin/python $(PIP_INSTALL) --force-reinstall --no-deps dist/*.whl
	PYTHONSAFEPATH=1 $(BENCH)/bin/python -m benchmarks --out out/bench.txt

bench-before: $(VENV)/.dev  ## this tree beside the last release: speed, start, memory, lateness, missed cycles; 1 if a limit is missed; five minutes
	rm -rf build/before && mkdir -p build/before && git archive $(BEFORE) | tar -x -C build/before
	$(BIN)/python -m benchmarks.before build/before

docs: $(DOCS)/.installed build/drive  ## the pages as a site in build/site, every link checked, with the robot in the browser if there is npm
	NO_MKDOCS_2_WARNING=1 COLUMNS=100 $(DOCS)/bin/mkdocs build --quiet --strict
	@echo "open build/site/index.html; make docs-serve has the search, and the robot in the browser, too"

# docs/pages.py takes it; without npm or a network the door of the site leads to how it is made
build/drive: $(DOCS)/.installed
	@rm -rf $@
	@$(DOCS)/bin/python -m txt1 browser build -o $@ || echo "the site is made without the robot in the browser, which needs npm and a network"

docs-serve: $(DOCS)/.installed build/drive  ## the pages with search at http://127.0.0.1:8000, made anew when a file changes
	NO_MKDOCS_2_WARNING=1 COLUMNS=100 $(DOCS)/bin/mkdocs serve --quiet

docs-version: docs  ## keep the pages as VERSION, beside the others, on the branch gh-pages; MIKE=--push publishes it
	TXT1_DOCS_VERSIONS=mike NO_MKDOCS_2_WARNING=1 COLUMNS=100 PATH="$(CURDIR)/$(DOCS)/bin:$$PATH" mike deploy $(MIKE) $(VERSION) $(ALIAS)

docs-links: docs  ## the links that lead out of the pages, tried one by one; needs a network
	$(DOCS)/bin/python docs/links.py build/site

clean:
	rm -rf $(VENV) $(BENCH) $(FUZZ) $(SBOM) $(DOCS) $(ROS2) $(KILTED) $(CYCLONEDDS) $(COLCON) $(VIEWERS) build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

# What README and `txt1` alone show needs: recordings and the page. Without --no-compile pip compiles all modules of all
# packages, a third of the time until the first screen; Python compiles those that are used, when they are. Most of the
# rest is reading the long lists of each package's files, so two read at once. The second one only fetches, as two
# that install would meet in the packages that both need. txt1 runs from the tree until it is installed.
$(VENV)/.drives: $(VENV)/bin/python pyproject.toml
	@$(BIN)/python -c '$(NEEDS)' web > $(VENV)/web.txt
	$(BIN)/python $(PIP_FETCH) --wheel-dir $(VENV)/wheels --requirement $(VENV)/web.txt & web=$$!; \
	$(BIN)/python -c '$(NEEDS)' dependencies record | $(BIN)/python $(PIP_INSTALL) --no-compile --requirement /dev/stdin && wait $$web
	$(BIN)/python $(PIP_INSTALL) --no-compile --no-index --find-links $(VENV)/wheels --requirement $(VENV)/web.txt
	@touch $@

# once txt1 is there, pip adds what the extra needs, and does not build txt1 anew
$(VENV)/.installed: $(VENV)/.drives
	$(BIN)/python $(PIP_INSTALL) --no-compile --no-deps --editable .
	$(BIN)/python $(PIP_INSTALL) --no-compile 'txt1[plots]'
	@rm -rf $(VENV)/wheels
	@touch $@

# Beside one another at the end: the tests are compiled, or all processes would do it at once, and numba's loops, half a
# minute, which tests of maps use.
$(VENV)/.dev: $(VENV)/.installed $(PLUGINS:%=%/pyproject.toml)
	$(BIN)/python $(PIP_INSTALL) --upgrade 'pip>=25.1'  # knows groups, which a Python's own may not
	$(BIN)/python $(PIP_INSTALL) --group dev --editable . $(PLUGINS:%=--editable %)
	$(BIN)/python -m compileall -j 2 -q txt1 $(PLUGINS)  # as pip does with all others: each process of the tests loads them
	@$(BIN)/python -m pytest --collect-only >/dev/null 2>&1 & $(BIN)/python -c 'from txt1.mapping.scan_work import warm; warm()' && wait
	@touch $@

$(SBOM)/.installed: pyproject.toml
	$(PYTHON) -m venv $(SBOM)
	$(SBOM)/bin/python $(PIP_INSTALL) --upgrade 'pip>=25.1'
	$(SBOM)/bin/python $(PIP_INSTALL) --group sbom
	touch $@

$(FUZZ)/.dev: pyproject.toml
	$(PYTHON) -m venv $(FUZZ)
	$(FUZZ)/bin/python $(PIP_INSTALL) --upgrade 'pip>=25.1'
	$(FUZZ)/bin/python $(PIP_INSTALL) --group dev --group fuzz --editable . $(PLUGINS:%=--editable %)
	@touch $@

$(DOCS)/.installed: pyproject.toml plugins/browser/pyproject.toml
	$(PYTHON) -m venv $(DOCS)
	$(DOCS)/bin/python $(PIP_INSTALL) --upgrade 'pip>=25.1'
	$(DOCS)/bin/python $(PIP_INSTALL) --group docs --editable '.[record,plots,view]' --editable plugins/browser
	@touch $@

# The benchmarks' folder comes after what is installed, so they measure the wheel and not the sources beside them.
$(BENCH)/.dev: pyproject.toml
	$(PYTHON) -m venv $(BENCH)
	$(BENCH)/bin/python $(PIP_INSTALL) --upgrade 'pip>=25.1'
	$(BENCH)/bin/python $(PIP_INSTALL) --group dev --group bench .
	pwd > $$($(BENCH)/bin/python -c "import sysconfig; print(sysconfig.get_path('purelib'))")/benchmarks.pth
	@touch $@
