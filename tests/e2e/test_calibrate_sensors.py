"""Sensors calibrated by one drive: the recording is run again, and what contradicts the settings is written."""

from __future__ import annotations

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

WRONG = "estimation.settings.vicon.lever=[0.05, 0.0]"


async def record(path: Path, settings: tuple[str, ...]) -> None:
    """Record curves to both sides."""
    config = load(None, ("seed=1", *ENDLESS, *settings)).config
    async with (
        recording(path, config, "max", {}, print) as attach,
        Robot.open(config=config, arm=True, attach=attach) as robot,
    ):
        await robot.load_gains()
        for turn in (1.0, -1.0) * 4:
            await robot.drive(0.6, turn, 0.25 * pi)


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


def test_a_drive_without_a_sensor_of_positions_is_refused_in_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive = tmp_path / "drive.mcap"
    run(record(drive, ()), speed="max")
    assert execute(["calibrate", "--sensors", str(drive)]) == USAGE
    assert "estimation.preset=vicon" in capsys.readouterr().err
