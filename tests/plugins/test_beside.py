"""A bridge or a screen of another package is one module and its entry point; both run beside the robot."""

from __future__ import annotations

import importlib.metadata
import json
import os
from collections.abc import Iterator
from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console

from txt1.cli import execute
from txt1.hal.base import Button
from txt1.kernel.loop import run
from txt1.robot import Robot
from txt1.telemetry.snapshot import Snapshot
from txt1.ui import screens
from txt1.ui.viewer import Viewer

SITE = Path(__file__).parent / "site"


@pytest.fixture(autouse=True)
def installed(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.syspath_prepend(SITE)
    monkeypatch.setenv("PYTHONPATH", str(SITE), prepend=os.pathsep)
    screens.installed.cache_clear()
    yield
    screens.installed.cache_clear()


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
            await robot.drive(0.0, 0.0, 1.0)
            return robot.snapshot

    assert list(screens.installed())[-1] == "COMPASS"
    snapshot = Snapshot.decode(run(main(), speed="max").encode())
    console = Console(file=StringIO(), width=100, height=24, color_system=None)
    with console.capture() as capture:
        console.print(screens.render(snapshot, Viewer(), 100, 24), end="")
    assert "COMPASS]" in capture.get()
    assert "the nose points 0 degrees to the left" in capture.get()


def test_a_screen_that_fails_says_so_in_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    broken = importlib.metadata.EntryPoint("STATUS", "no_such_module:screen", screens.GROUP)
    monkeypatch.setitem(screens.installed(), "STATUS", broken)
    console = Console(file=StringIO(), width=100, height=24, color_system=None)
    with console.capture() as capture:
        console.print(screens.render(Snapshot(0.0, "", {}), Viewer(), 100, 24), end="")
    assert "this screen failed: ModuleNotFoundError" in capture.get()
