"""The comparison with an older version notices a task that sleeps, and takes a version for as large as itself."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.patience import LIMIT

ROOT = Path(__file__).parents[2]

pytestmark = pytest.mark.long


def compared(new: Path, cases: str) -> subprocess.CompletedProcess[str]:
    words = [sys.executable, "-m", "benchmarks.before", str(ROOT), str(new), "--cases", cases]
    words += ["--rounds", "3", "--real", "3", "--duration", "20"]
    return subprocess.run(words, cwd=ROOT, capture_output=True, text=True, timeout=5.0 * LIMIT)


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """A copy of the sources."""
    for folder in ("txt1", "config"):
        shutil.copytree(ROOT / folder, tmp_path / folder, ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


def test_a_planted_sleep_in_the_way_of_other_tasks_fails_it(copy: Path) -> None:
    module = copy / "txt1" / "tasks" / "encoder.py"
    loop = "    async for now in ticks:\n        inputs = hal.read(now)\n"
    text = module.read_text()
    assert text.count(loop) == 1
    asleep = loop.replace("        inputs", "        __import__('time').sleep(0.002)\n        inputs")
    module.write_text(text.replace(loop, asleep))
    done = compared(copy, "real time")
    assert done.returncode == 1, done.stdout + done.stderr
    assert "latest task late, median, us" in done.stdout.splitlines()[-1]


def test_a_version_is_as_fast_as_itself_but_for_the_machine(copy: Path) -> None:
    done = compared(copy, "recorded")
    # which of two like programs is faster is the machine's choice; what they take of the memory is not
    assert done.returncode in (0, 1), done.stderr
    (memory,) = (line for line in done.stdout.splitlines() if "memory" in line)
    assert memory.endswith("met")
