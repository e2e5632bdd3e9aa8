"""What holds for all tests: random ones repeat, and those that wait in real time are marked."""

from __future__ import annotations

import gc
import os
import shutil
import subprocess
import sys
from collections.abc import Generator, Iterator
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import hypothesis
import pytest

from tests.examples import SHARE, USUAL
from tests.patience import surviving

HERE = Path(__file__).parent
INSIDE = f"{HERE}{os.sep}"
USUAL_MARKS = "not long and not browser"
APART = ("browser", "ros", "viewers")

# Messages of argparse are looked for in no other language: for each of them that is asked of the disk.
os.environ.setdefault("LANGUAGE", "C")

# A process with a BLAS thread for each processor computes no sooner here, and its threads keep a processor busy while
# they wait. This has to be said before numpy is imported, and holds for processes that the tests start, too.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Entry points of the installed packages are read once for each search path and not for each configuration: 10 ms each.
ENTRY_POINTS = metadata.entry_points


@cache
def _entry_points(path: tuple[str, ...], **params: str) -> Any:
    del path
    return ENTRY_POINTS(**params)


metadata.entry_points = lambda **params: _entry_points(tuple(sys.path), **params)

# No example has a deadline, and none is drawn too slowly, as both say how busy the machine is. A change is judged by
# the same examples each time, so what fails is the change's; `make test-long` looks for others.
BUSY = {"deadline": None, "suppress_health_check": [hypothesis.HealthCheck.too_slow]}
hypothesis.settings.register_profile("same", **BUSY, derandomize=True, max_examples=USUAL // SHARE)
hypothesis.settings.register_profile("others", **BUSY, print_blob=True, max_examples=USUAL)
hypothesis.settings.load_profile("same")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark tests that are patient, and those of modules with something of tests/patience.py, for `make steady`."""
    for item in items:
        if isinstance(item, pytest.Function) and (
            "patient" in item.fixturenames or any(map(has_patience, modules_of(item.module.__name__)))
        ):
            item.add_marker(pytest.mark.waits)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out folders whose tests are all long or in a browser where none of these runs: their imports take time."""
    apart = collection_path.parent == HERE and collection_path.name in APART
    return True if apart and config.getoption("markexpr") == USUAL_MARKS else None


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Let no garbage be looked for while the tests are collected: there is next to none among so much that stays."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()


def pytest_collection_finish() -> None:
    """Keep what was collected away from the garbage collector: every robot in real time looks through the rest.

    Garbage is also looked for seldom: a test makes little, and each look goes through what the tests before it left.
    """
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)


@cache
def modules_of(name: str) -> frozenset[str]:
    """A module of the tests, and the modules of the tests from which it has something, however indirectly."""
    found, new = {name}, [name]
    while new:
        for value in vars(sys.modules[new.pop()]).values():
            origin = getattr(value, "__module__", None)
            file = getattr(sys.modules.get(origin), "__file__", None) if isinstance(origin, str) else None
            if file is not None and origin not in found and file.startswith(INSIDE):
                found.add(origin)
                new.append(origin)
    return frozenset(found)


@cache
def has_patience(name: str) -> bool:
    """Whether a module imports tests/patience.py."""
    return "\nfrom tests.patience import " in Path(str(sys.modules[name].__file__)).read_text("utf-8")


@pytest.fixture(scope="session")
def tracked() -> list[str]:
    """The names of the files that the repository holds, from its root on."""
    if shutil.which("git") is None:
        pytest.skip("did not run: git is not installed")
    listed = subprocess.run(["git", "ls-files"], cwd=HERE.parent, capture_output=True, text=True, check=False)
    if listed.returncode:
        pytest.skip("did not run: this is no checkout")
    return listed.stdout.splitlines()


@pytest.fixture
def patient() -> Iterator[None]:
    """The test's robots, here and in processes that it starts, live through stalls of the machine."""
    with surviving():
        yield
