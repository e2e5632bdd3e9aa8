"""The spine knows no addition, and a plain robot loads none."""

import ast
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import txt1
from tests.arrows import arrows, folder, layers, module_of
from txt1 import additions

PACKAGE = Path(txt1.__file__).parent
SPINE = {
    f"txt1.{name}"
    for name in (
        *("additions", "config", "conformance", "control", "driver", "errors", "hal", "kernel", "link", "model"),
        *("plugins", "protocol", "robot", "runtime", "sensors", "shipped", "sim", "tasks", "telemetry", "units"),
    )
}
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


def test_the_spine_names_no_addition() -> None:
    of_layers = layers()
    known = [
        f"{arrow.file}:{arrow.line}: {arrow.target}"
        for arrow in arrows()
        if folder(module_of(arrow.file), of_layers) in SPINE
        and not in_addition(module_of(arrow.file))
        and in_addition(arrow.target)
    ]
    assert known == []


def test_opening_a_simulated_robot_loads_no_addition() -> None:
    done = subprocess.run([sys.executable, "-c", OPEN], capture_output=True, text=True, check=True)
    loaded = json.loads(done.stdout)
    assert [module for module in loaded if in_addition(module)] == []


def test_ours_are_found_by_their_folders() -> None:
    assert {"estimation", "obstacle_stop", "roll_guard"} <= set(additions.ours())
    assert sorted(additions.ours()) == sorted(file.parent.name for file in FILES)


@pytest.mark.parametrize("file", FILES, ids=[file.parent.name for file in FILES])
def test_what_says_what_an_addition_brings_imports_nothing_heavy(file: Path) -> None:
    code = file.read_text()
    assert code.count("\n") <= 40
    assert set(imported(ast.parse(code))) <= {"txt1.additions"}


def imported(tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (each.name for each in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module or ""
