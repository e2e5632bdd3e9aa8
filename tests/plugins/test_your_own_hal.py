"""The page "your own HAL in an hour", followed word by word; and what `txt1 hal new` writes keeps all promises."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest

import txt1
from txt1.cli import execute
from txt1.config import Config, load
from txt1.hal import Hal, Inputs, Outputs
from txt1.hal.conformance import HalConformance
from txt1.hal.registry import HALS
from txt1.hal.simulated_controller import SimulatedCar
from txt1.model.vehicle import PWM_MAX
from txt1.robot import Robot

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "your-own-hal.md").read_text()
BLOCKS = re.findall(r"```(sh|python)\n(.*?)```", PAGE, re.DOTALL)


def perform(line: str, folder: Path) -> str:
    """Run a line of the page in a folder, and return what it prints."""
    command, *words = line.split()
    module = {"txt1": ["-m", "txt1"], "pip": ["-m", "pip", "--quiet"], "python": []}[command]
    site = folder / "site"
    ours = {
        "PYTHONPATH": os.pathsep.join((str(site), str(ROOT))),
        "PYTHONDONTWRITEBYTECODE": "1",
        "PIP_TARGET": str(site),
        "PIP_NO_INDEX": "1",
        "PIP_NO_DEPS": "1",
        "PIP_NO_BUILD_ISOLATION": "0",  # which pip takes for: without it
        "PIP_DISABLE_PIP_VERSION_CHECK": "1",
        "PIP_ROOT_USER_ACTION": "ignore",
    }
    done = subprocess.run(
        [sys.executable, *module, *words],
        cwd=folder,
        env=os.environ | ours,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, f"{line}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.mark.long
def test_the_page_word_by_word(tmp_path: Path) -> None:
    said = {}
    for kind, text in BLOCKS:
        if kind == "python":
            assert (tmp_path / "mycar" / "mycar.py").exists()
            (tmp_path / "mycar" / "mycar.py").write_text(text)
            continue
        for line in text.splitlines():
            said[line] = perform(line, tmp_path)
    assert "mycar" in said["txt1 hal list"].splitlines()
    assert "BROKEN" not in said["txt1 hal check mycar"]
    (driven,) = (json.loads(text) for line, text in said.items() if line.startswith("txt1 run"))
    assert (driven["odometry"]["x"] > 0.5, driven["faults"]["runaway"]) == (True, 0)


def test_what_is_written_at_first_keeps_all_promises(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["hal", "new", "my_car", "--to", str(tmp_path)]) == 0
    ours = {"PYTHONPATH": os.pathsep.join((str(ROOT), str(tmp_path / "my_car")))}
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "my_car"],
        cwd=tmp_path,
        env=os.environ | ours,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout
    assert execute(["hal", "new", "my_car", "--to", str(tmp_path)]) == 2
    assert "is there already" in capsys.readouterr().err


class Tank:
    """A simulated rover at the two motors of what `txt1 hal new` has written."""

    def __init__(self, written: ModuleType, config: Config) -> None:
        self.car = SimulatedCar(config)
        self.now = 0.0

        class Driven(written.Tank):  # type: ignore[name-defined, misc]
            capabilities = replace(written.Tank.capabilities, ticks=True)

            def read(hal, now: float) -> Inputs:
                return Inputs(ticks=self.car.hal.read(now).ticks)

            def write(hal, outputs: Outputs, now: float) -> None:
                self.now = now
                super().write(outputs, now)

            def put_sides(hal, right: float, left: float) -> None:
                self.car.skid(self.now, PWM_MAX * right, PWM_MAX * left)

        self.hal = Driven(written.Options(), skids=config.geometry.steering == "skid")


@pytest.fixture
def tank(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[Config], Hal]]:
    """What makes the rover, registered as "tank"."""
    execute(["hal", "new", "tank", "--to", str(tmp_path)])
    monkeypatch.syspath_prepend(tmp_path / "tank")
    written = import_module("tank")

    def create(config: Config) -> Hal:
        return Tank(written, config).hal

    monkeypatch.setitem(HALS.table, "tank", create)  # type: ignore[arg-type]
    yield create
    del sys.modules["tank"]


ROVER = ("vehicle=rover", "sim.room.length=.inf", "sim.room.width=.inf")


def test_a_rover_s_skeleton_drives_as_it_is_asked(tank: Callable[[Config], Hal]) -> None:
    async def main() -> None:
        async with Robot.open("tank", settings=ROVER, seed=1) as robot:
            await robot.load_gains()
            for omega in (0.0, 0.5):
                turned = []
                for _ in range(40):
                    await robot.drive(0.5, omega, 0.05)
                    turned.append(robot.odometry.omega)
                assert robot.odometry.v == pytest.approx(0.5, abs=0.05)
                assert sum(turned[20:]) / 20 == pytest.approx(omega, abs=0.03)
                assert all(abs(each - omega) < 0.2 for each in turned[20:])

    txt1.run(main(), speed="max")


def test_a_rover_s_skeleton_keeps_the_promise_on_its_sides(tank: Callable[[Config], Hal]) -> None:
    class Suite(HalConformance):
        skids = True

        def make(self) -> Hal:
            return tank(load(None, ROVER, {}, {}).config)

    Suite().test_sides_that_run_at_two_speeds_come_of_the_outputs_as_written()


@pytest.mark.parametrize(("name", "said"), [("vesc", "one of txt1's own"), ("My-Car", "name of a Python module")])
def test_names_that_cannot_be_are_refused(name: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["hal", "new", name]) == 2
    assert said in capsys.readouterr().err
