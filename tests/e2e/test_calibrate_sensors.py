"""Sensors calibrated by one drive: the recording is run again, and what contradicts the settings is written."""

from __future__ import annotations

from collections.abc import Sequence
from math import pi
from pathlib import Path

import pytest

from tests.e2e.conftest import ENDLESS
from txt1.cli import execute
from txt1.commands import OK, USAGE
from txt1.config import load
from txt1.estimation.settings import EstimationConfig
from txt1.kernel.loop import run
from txt1.record.session import recording
from txt1.robot import Robot

Moves = Sequence[tuple[float, float, float]]
BOTH_SIDES: Moves = [(0.6, turn, 0.25 * pi) for turn in (1.0, -1.0) * 4]
WRONG = "estimation.settings.vicon.lever=[0.05, 0.0]"


async def record(path: Path, settings: tuple[str, ...], moves: Moves = BOTH_SIDES) -> None:
    """Record a drive, which has curves to both sides if nothing else is asked for."""
    config = load(None, ("seed=1", *ENDLESS, *settings)).config
    async with (
        recording(path, config, "max", {}, print) as attach,
        Robot.open(config=config, arm=True, attach=attach) as robot,
    ):
        await robot.load_gains()
        for v, turn, seconds in moves:
            await robot.drive(v, turn, seconds)


def test_a_lever_arm_that_is_5_cm_wrong_is_found_in_a_drive_and_put_right_in_a_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive, file = tmp_path / "drive.mcap", tmp_path / "sensors.yaml"
    run(record(drive, ("estimation.preset=vicon", WRONG)), speed="max")
    assert execute(["calibrate", "--sensors", str(drive), "--write", str(file)]) == OK
    told = capsys.readouterr().out
    assert "vicon: " in told
    assert "(sigma " in told
    assert "track: " in told
    assert "this drive does not show it: drive " in told
    ahead, left = load(file, ()).config.section(EstimationConfig).settings["vicon"].lever
    assert ahead == pytest.approx(0.0, abs=0.005)
    assert left == pytest.approx(0.0, abs=0.01)


def test_a_circle_as_stated_writes_nothing_and_asks_for_curves_to_both_sides(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A delay of 9 ms was written, told to 1.7 ms: it looks like a frame that is turned."""
    drive, file = tmp_path / "drive.mcap", tmp_path / "sensors.yaml"
    run(record(drive, ("estimation.preset=vicon",), [(0.5, 0.6, 18.0)]), speed="max")
    assert execute(["calibrate", "--sensors", str(drive), "--write", str(file)]) == OK
    told = capsys.readouterr().out
    assert "does not show it: drive hard starts and stops, and curves to both sides" in told
    assert "nothing contradicts the settings" in told
    assert not file.exists()


def test_a_drive_without_a_sensor_of_positions_is_refused_in_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive = tmp_path / "drive.mcap"
    run(record(drive, ()), speed="max")
    assert execute(["calibrate", "--sensors", str(drive)]) == USAGE
    assert "estimation.preset=vicon" in capsys.readouterr().err
