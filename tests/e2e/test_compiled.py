"""What is compiled does what its source says, to the last bit, and gives way to a source that was edited since."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import txt1

PACKAGE = Path(txt1.__file__).parent

pytestmark = pytest.mark.skipif(not txt1.IS_COMPILED, reason="nothing is compiled here: make compiled")


def output_of(*command: str, sources: bool = False, folder: Path | None = None) -> str:
    """What a command of this Python prints, from the sources alone or with what is compiled."""
    environment = {name: value for name, value in os.environ.items() if name != "PURE_PYTHON"}
    if sources:
        environment["PURE_PYTHON"] = "1"
    done = subprocess.run(
        [sys.executable, *command], cwd=folder, env=environment, capture_output=True, text=True, check=True, timeout=120
    )
    return done.stdout


def test_a_run_is_the_same_compiled_and_from_its_source() -> None:
    command = ("-m", "txt1", "run", "--hal", "sim", "--headless", "--json", "--speed", "max")

    def run(sources: bool) -> dict[str, Any]:
        printed = output_of(*command, "--duration", "30", "--seed", "7", "--drive", "0.5,0.5", sources=sources)
        result: dict[str, Any] = json.loads(printed)
        del result["wall_time_s"]
        for task in result["tasks"].values():
            del task["run_time_s"]
        return result

    compiled, interpreted = run(False), run(True)
    assert compiled == interpreted
    assert compiled["odometry"]["x"] != 0.0


def test_what_is_learned_is_the_same_compiled_and_from_its_source(tmp_path: Path) -> None:
    for folder in ("compiled", "interpreted"):
        learn = ("-m", "txt1", "learn", "--agent", "thesis", "--trials", "2", "--episodes", "6", "--seed", "3")
        output_of(*learn, "--out", str(tmp_path / folder), sources=folder == "interpreted")
    for file in ("learning.csv", "qtable.json"):
        assert (tmp_path / "compiled" / file).read_bytes() == (tmp_path / "interpreted" / file).read_bytes()


SAY = ("-c", "import txt1, txt1.kernel.scheduler as s; print(txt1.IS_COMPILED, s.__file__.endswith('.py'))")


def test_the_sources_run_when_they_are_asked_for() -> None:
    assert output_of(*SAY).split() == ["True", "False"]
    assert output_of(*SAY, sources=True).split() == ["False", "True"]


@pytest.mark.parametrize("module", ["kernel/scheduler.py", "tasks/controller.py"])
def test_the_sources_run_when_one_was_edited(tmp_path: Path, module: str) -> None:
    copy = tmp_path / "txt1"
    shutil.copytree(PACKAGE, copy)
    assert output_of(*SAY, folder=tmp_path).split() == ["True", "False"]
    with (copy / module).open("a") as source:
        source.write("# a thought\n")
    assert output_of(*SAY, folder=tmp_path).split() == ["False", "True"]
