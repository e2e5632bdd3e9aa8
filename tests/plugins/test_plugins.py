"""A sensor, source, bridge, learner, HAL or screen of another package is one module and its entry point.

The modules are in `site`, announced as pip would install them; no file of txt1's knows of them.
"""

from __future__ import annotations

import csv
import io
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

import txt1
from tests.e2e.test_record_view import messages, served, subscribed
from txt1.cli import execute
from txt1.robot import Robot
from txt1.telemetry.snapshot import Snapshot
from txt1.ui import tables
from txt1.ui.viewer import Viewer

SITE = Path(__file__).parent / "site"
Capture = pytest.CaptureFixture[str]
INSIDE = ("--set", "sensors.inside.driver=thermometer", "--set", "sensors.inside.options.start=30")


@pytest.fixture(autouse=True)
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The plug-ins are installed, in the processes beside the robot, too."""
    monkeypatch.syspath_prepend(SITE)
    monkeypatch.setenv("PYTHONPATH", str(SITE), prepend=os.pathsep)


@pytest.fixture
def run(capsys: Capture) -> Callable[..., dict[str, Any]]:
    """Runs the robot in virtual time; what `--json` says."""

    def run(*words: str, duration: str = "5") -> dict[str, Any]:
        assert execute(["run", "--json", "--speed", "max", "--seed", "1", "--duration", duration, *words]) == 0
        told: dict[str, Any] = json.loads(capsys.readouterr().out)
        return told

    return run


# -- a sensor ----------------------------------------------------------------------------------------------------


def test_a_thermometer_is_listed_and_keeps_what_a_sensor_promises(capsys: Capture) -> None:
    assert execute(["sensor", "list", *INSIDE]) == 0
    said = capsys.readouterr().out.splitlines()
    assert "driver thermometer" in said and "sensor inside: thermometer" in said
    assert execute(["sensor", "check", "inside", *INSIDE]) == 0


def test_its_readings_are_at_hand_in_a_program() -> None:
    async def main() -> None:
        async with Robot.open("sim", settings=["sensors.inside.driver=thermometer"]) as robot:
            await robot.load_gains()
            await robot.drive(0.5, 0.0, 2.0)
            reading = robot.sensor("inside")
            assert reading is not None
            assert reading.value == pytest.approx(20.0 + 0.1 * reading.time)
            assert robot.now - reading.time <= 0.5

    txt1.run(main(), speed="max")


def test_its_readings_are_on_the_sensors_screen() -> None:
    async def main() -> str:
        async with Robot.open("sim", settings=["sensors.inside.driver=thermometer"]) as robot:
            await robot.load_gains()
            await robot.drive(0.5, 0.0, 2.0)
            snapshot = Snapshot.decode(Snapshot.take(robot.runtime.bus, robot.now, "txt1").encode())
        console = Console(width=100, record=True, file=io.StringIO())
        console.print(tables.sensors(snapshot, Viewer(), 100, 20))
        return console.export_text()

    (line,) = [line for line in txt1.run(main(), speed="max").splitlines() if "inside" in line]
    assert "20.3 degrees Celsius" in line and "healthy" in line


def test_its_readings_are_in_the_runs_json(run: Callable[..., dict[str, Any]]) -> None:
    inside = run(*INSIDE)["sensors"]["inside"]
    assert inside["healthy"]
    assert inside["readings"] == 10
    assert inside["values"] == {"value": pytest.approx(30.45)}
    assert inside["units"] == "degrees Celsius"


def test_its_readings_are_in_the_recording_in_log_info_and_in_log_export(
    run: Callable[..., dict[str, Any]], tmp_path: Path, capsys: Capture
) -> None:
    file = tmp_path / "run.mcap"
    run(*INSIDE, "--log", str(file))
    assert execute(["log", "info", str(file)]) == 0
    (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("/sensors/inside ")]
    assert line.split()[1:3] == ["10", "2.00"] and line.endswith("txt1_msgs/msg/Value")
    assert execute(["log", "export", str(file), "-o", str(tmp_path)]) == 0
    with (tmp_path / "sensors_inside.csv").open() as table:
        rows = list(csv.DictReader(table))
    assert [float(row["time"]) for row in rows] == [0.5 * k for k in range(10)]
    assert [float(row["value"]) for row in rows] == pytest.approx([30.0 + 0.05 * k for k in range(10)])
    assert execute(["replay", "--verify", str(file)]) == 0


def test_its_readings_are_in_the_live_view() -> None:
    with served(*INSIDE) as client:
        _, message = next(messages(client, subscribed(client, "/sensors/inside")))
        assert 30.0 <= message.value < 36.0


# -- a source of commands ----------------------------------------------------------------------------------------


def test_a_source_of_commands_drives(run: Callable[..., dict[str, Any]]) -> None:
    odometry = run("--source", "circler")["odometry"]
    assert odometry["v"] == pytest.approx(0.5, abs=0.05)
    assert odometry["omega"] == pytest.approx(0.5, abs=0.1)


# -- a learner ---------------------------------------------------------------------------------------------------


def test_a_learner_learns_and_its_table_can_be_driven_by(
    run: Callable[..., dict[str, Any]], tmp_path: Path, capsys: Capture
) -> None:
    assert execute(["learn", "--agent", "guesser", "--trials", "1", "--episodes", "2", "--out", str(tmp_path)]) == 0
    capsys.readouterr()
    with (tmp_path / "learning.csv").open() as file:
        assert len(list(csv.DictReader(file))) == 2
    told = run("--policy", str(tmp_path / "qtable.json"), duration="20")
    assert told["tasks"]["learning"]["cycles"] > 100
    assert abs(told["odometry"]["x"]) + abs(told["odometry"]["y"]) > 0.2, "it has moved"


# -- a HAL -------------------------------------------------------------------------------------------------------


def test_a_hal_is_listed_keeps_what_a_hal_promises_and_drives(
    run: Callable[..., dict[str, Any]], capsys: Capture
) -> None:
    assert execute(["hal", "list"]) == 0
    assert "toy" in capsys.readouterr().out.splitlines()
    assert execute(["hal", "check", "toy"]) == 0
    capsys.readouterr()
    odometry = run("--hal", "toy", "--drive", "0.5,0.5")["odometry"]
    assert (odometry["v"], odometry["omega"]) == (0.5, 0.5)
