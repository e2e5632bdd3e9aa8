"""A guard, a bridge and a screen are folders of txt1/: with them in place, no other file is changed."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import txt1
from tests.patience import LIMIT, PATIENT

TREE = Path(txt1.__file__).parents[1]
CRAWL = {
    "addition.py": """
from txt1.additions import Addition

GUARD = "txt1.guards.crawl.guard"
ADDITION = Addition("crawl", order=30, settings=f"{GUARD}:Crawl", prepare=f"{GUARD}:prepare")
""",
    "guard.py": """
from txt1.config.schema import Section


class Crawl(Section):
    share: float = 0.5


async def prepare(runtime, settings):
    runtime.guard("crawl", lambda v, omega, now: (settings.share * v, settings.share * omega))
""",
}
BEACON = {
    "addition.py": """
from txt1.additions import Addition

ADDITION = Addition(
    "beacon",
    order=130,
    beside="txt1.beacon.beside:beside",
    options="txt1.beacon.options:OPTIONS",
    parts={
        "txt1.bridges": {"beacon": "txt1.beacon.bridge:main"},
        "txt1.screens": {"BEACON": "txt1.beacon.screen:screen"},
    },
)
""",
    "options.py": """
from txt1.additions import Options

ARGUMENTS = {"--beacon": {"metavar": "COLOUR", "help": "shine in this colour"}}
OPTIONS = Options("beacon", ARGUMENTS, lambda arguments, config: arguments.beacon)
""",
    "beside.py": """
import asyncio
from contextlib import asynccontextmanager

from txt1.bridges.registry import bridge


@asynccontextmanager
async def beside(robot, colour):
    shone = asyncio.get_running_loop().create_future()

    def shine(colour):
        robot.tell(f"the beacon shines {colour}")
        shone.done() or shone.set_result(None)

    robot.alongside.append(shone)
    async with bridge(robot, "beacon", {"colour": colour}, {"shine": shine}):
        yield
""",
    "bridge.py": """
def main(robot, colour):
    robot.request("subscribe", topics=["/odom"], rate=20.0)
    for telemetry in robot:
        robot.request("shine", colour=colour)
""",
    "screen.py": """
def screen(snapshot, viewer, width, rows):
    return "a beacon"
""",
}


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the program with a guard's folder and a bridge's."""
    tree = tmp_path_factory.mktemp("tree")
    for folder in ("txt1", "config"):
        shutil.copytree(TREE / folder, tree / folder, ignore=shutil.ignore_patterns("__pycache__", "*.so"))
    for name, files in {"guards/crawl": CRAWL, "beacon": BEACON}.items():
        folder = tree / "txt1" / name
        folder.mkdir()
        for file, code in {"__init__.py": "", **files}.items():
            (folder / file).write_text(code)
    return tree


def said(tree: Path, *words: str) -> str:
    """What Python with this program says, started in a folder elsewhere."""
    clean = {name: value for name, value in os.environ.items() if not name.startswith("TXT1_")}
    done = subprocess.run(
        [sys.executable, *words],
        cwd=tree.parent,
        env={**clean, "PYTHONPATH": str(tree)},
        capture_output=True,
        text=True,
        timeout=10.0 * LIMIT,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_guard_is_a_folder(tree: Path) -> None:
    run = ("-m", "txt1", "run", "--headless", "--json", "--speed", "max", "--duration", "4", "--drive", "0.6,0")
    told = json.loads(said(tree, *run, "--set", "crawl.share=0.5").splitlines()[-1])
    assert told["odometry"]["v"] == pytest.approx(0.3, abs=0.03)


@pytest.mark.long
def test_a_bridge_with_its_option_and_its_screen_is_a_folder(tree: Path) -> None:
    assert "--beacon COLOUR" in said(tree, "-m", "txt1", "run", "--help")
    run = ("-m", "txt1", "run", "--json", "--duration", "60", "--set", *PATIENT)
    told = json.loads(said(tree, *run, "--beacon", "red"))
    assert told["sim_time_s"] < 60.0, "the bridge was at work, and its request has ended the run"
    screens = "from txt1.ui.screens import installed; print(installed()['BEACON'].load().__module__)"
    assert said(tree, "-c", screens) == "txt1.beacon.screen\n"
