"""The spine knows no addition, and a plain robot loads none."""

import ast
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import txt1
from tests import arrows, size
from txt1 import additions
from txt1.config import load

PACKAGE = Path(txt1.__file__).parent
FILES = sorted(file for pattern in additions.FOLDERS for file in PACKAGE.glob(f"{pattern}/addition.py"))
FOLDERS = [".".join(file.parent.relative_to(PACKAGE.parent).parts) for file in FILES]
OPEN = """
import asyncio, json, sys, txt1
async def main():
    async with txt1.Robot.open("sim"):
        print(json.dumps(sorted(sys.modules)))
txt1.run(main(), speed="max")
"""


def in_addition(module: str) -> bool:
    return any(module == each or module.startswith((f"{each}.", f"{each}:")) for each in FOLDERS)


def test_a_spine_that_names_an_addition_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    planted = arrows.arrows_of("txt1/hal/registry.py", "WHERE = 'txt1.cars.pi.driver:create'")
    monkeypatch.setattr(arrows, "arrows", lambda: planted)
    assert arrows.main([]) == 1
    assert "additions that the spine names: 1\n  txt1/hal/registry.py:1: " in capsys.readouterr().out


def test_opening_a_simulated_robot_loads_no_addition() -> None:
    done = subprocess.run([sys.executable, "-c", OPEN], capture_output=True, text=True, check=True)
    loaded = json.loads(done.stdout)
    assert [module for module in loaded if in_addition(module)] == []
    assert sum(map(size.statements, size.loaded())) <= 6861


PLAIN_RUN = """
import runpy, sys
sys.argv = ["txt1", "run", "--hal", "sim", "--headless", "--speed", "max", "--duration", "0.1"]
try:
    runpy.run_module("txt1", run_name="__main__")
except SystemExit as ended:
    assert not ended.code
"""
SERIAL = """
import sys, txt1.runtime, txt1.robot
from txt1.config import load
from txt1.hal.registry import create
create(load(None, ["hal=serial", "serial.port=/dev/ttyUSB0", "serial.fault.drop=0.1"], {}, {}).config)
"""


@pytest.mark.parametrize("program", [PLAIN_RUN, SERIAL], ids=["run --hal sim", "--hal serial"])
def test_a_plain_robot_loads_no_numpy(program: str) -> None:
    told = program + "print([each for each in ('numpy', 'txt1.hal.base') if each in sys.modules])"
    done = subprocess.run([sys.executable, "-c", told], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "['txt1.hal.base']"


def test_a_section_alone_starts_no_recorder_and_no_learner_but_the_filter() -> None:
    given = ["record.rotate_size=7", "learning.goal_period=0.1", "estimation.preset=gyro"]
    config = load(None, given, {}, {}).config
    assert {"record", "learning", "estimation"} <= set(config.given)
    assert [each.addition.name for each in additions.active(config)] == ["estimation"]
    assert [each.addition.name for each in additions.active(config, {"record": None})] == ["record", "estimation"]


def test_ours_are_found_by_their_folders() -> None:
    assert {"estimation", "obstacle_stop", "roll_guard", "board", "pi", "vesc"} <= set(additions.ours())
    assert sorted(additions.ours()) == sorted(file.parent.name for file in FILES)


@pytest.mark.parametrize("file", FILES, ids=[file.parent.name for file in FILES])
def test_an_additions_description_imports_nothing_heavy(file: Path) -> None:
    code = file.read_text()
    assert code.count("\n") <= 40
    assert set(imported(ast.parse(code))) <= {"txt1.additions"}


def imported(tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (each.name for each in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module or ""
