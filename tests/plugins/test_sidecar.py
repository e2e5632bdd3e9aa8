"""A bridge or a screen of another package is one module and its entry point; both run beside the robot."""

from __future__ import annotations

import importlib.metadata
import json
import os
import subprocess
import sys
from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console

from tests.e2e.test_record_learn import messages
from txt1.bridges.registry import BRIDGES
from txt1.cli import execute
from txt1.hal.base import Button
from txt1.kernel.loop import run
from txt1.robot import Robot
from txt1.telemetry.snapshot import Snapshot
from txt1.ui import screens
from txt1.ui.viewer import Viewer

SITE = Path(__file__).parent / "site"
LIMIT = ("--set", "speed_limit.v=0.2")


@pytest.fixture(autouse=True)
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(SITE)
    monkeypatch.setenv("PYTHONPATH", str(SITE), prepend=os.pathsep)


@pytest.mark.long
@pytest.mark.usefixtures("patient")
def test_a_bridge_is_named_on_the_command_line_and_drives(capsys: pytest.CaptureFixture[str]) -> None:
    for duration in ("2", "10", "50"):  # the longer ones for a busy machine
        assert execute(["run", "--duration", duration, "--json", "--bridge", "pusher:distance=0.3"]) == 0
        x = json.loads(capsys.readouterr().out)["odometry"]["x"]
        if x >= 0.3:
            break
    assert x >= 0.3


def test_a_bridge_that_is_not_installed_is_refused_by_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["run", "--duration", "1", "--json", "--bridge", "pushr"]) == 2
    assert "did you mean 'pusher'?" in capsys.readouterr().err


def test_a_screen_follows_ours_and_draws_what_the_robot_tells() -> None:
    async def main() -> Snapshot:
        async with Robot.open("sim", seed=1) as robot:
            robot.press(Button.LEFT)  # round to the last
            robot.press(Button.LEFT)
            await robot.drive(0.0, 0.0, 1.0)
            return robot.snapshot

    assert list(screens.installed())[-2:] == ["COMPASS", "LIMIT"]
    drawn = drawing(Snapshot.decode(run(main(), speed="max").encode()))
    assert "COMPASS]" in drawn
    assert "the nose points 0 degrees to the left" in drawn


def drawing(snapshot: Snapshot) -> str:
    console = Console(file=StringIO(), width=100, height=24, color_system=None)
    with console.capture() as capture:
        console.print(screens.render(snapshot, Viewer(), 100, 24), end="")
    return capture.get()


def test_an_addition_brings_a_screen_that_draws_its_own_topic() -> None:
    async def main() -> bytes:
        async with Robot.open("sim", seed=1, settings=["speed_limit.v=0.25"]) as robot:
            robot.press(Button.LEFT)
            await robot.drive(0.0, 0.0, 1.0)
            return robot.snapshot.encode()

    drawn = drawing(Snapshot.decode(run(main(), speed="max")))
    assert "LIMIT]" in drawn
    assert "at most 0.25 m/s" in drawn


def test_the_drawing_process_finds_the_screen_of_an_addition_and_its_topic_by_itself() -> None:
    code = "from txt1.ui.screens import installed; print([each.load().__module__ for each in installed().values()][-1])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "plugin_limit_screen\n"


@pytest.mark.usefixtures("patient")
def test_an_addition_brings_a_bridge_that_is_named_on_the_command_line(tmp_path: Path) -> None:
    more = ("--json", "--bridge", "limited:share=0.5", *LIMIT, "--set", "sim.room.length=20")
    for duration in ("2", "10", "50"):  # the longer ones for a busy machine
        log = tmp_path / f"{duration}.mcap"
        assert execute(["run", "--duration", duration, *more, "--log", str(log)]) == 0
        # where a busy machine is late, commands expire, and the last set-point may be 0
        speeds = {setpoint.twist.linear.x for setpoint in messages(log, "/setpoint")}
        if any(speeds):
            break
    assert sorted(speeds) == pytest.approx([0.0, 0.1])


def test_a_bridge_of_an_addition_is_found_though_nothing_else_asks_for_the_addition() -> None:
    assert BRIDGES.place("bridge", "limited") == "plugin_limit_bridge:main"
    assert {"limited", "pusher", "web"} <= set(BRIDGES.names())


def test_a_screen_that_fails_says_so_in_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    broken = importlib.metadata.EntryPoint("STATUS", "no_such_module:screen", screens.GROUP)
    monkeypatch.setitem(screens.installed(), "STATUS", broken)
    assert "this screen failed: ModuleNotFoundError" in drawing(Snapshot(0.0, "", {}))
