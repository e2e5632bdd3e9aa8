"""What a user of version 0.2.0 has, settings and a recording, is read by this version; what is not the same is told.

Both files were written by version 0.2.0: ``txt1 config show``, as YAML, and ``txt1 run --headless --speed max
--duration 2 --seed 1 --drive 0.5,0.3 --log drive.mcap``.
"""

import csv
from importlib.util import find_spec
from pathlib import Path

import pytest
import yaml
from blockbuster import BlockBuster

from tests.e2e.conftest import may_block
from txt1.cli import execute
from txt1.config import load

SETTINGS, DRIVE = (Path(__file__).parent / "version_0_2_0" / name for name in ("settings.yaml", "drive.mcap"))


with_learners = pytest.mark.skipif(
    find_spec("txt1_learners") is None, reason="the pilot and its settings are in plugins/learners: not installed"
)


@pytest.fixture(autouse=True)
def a_replay_may_block(blocking_calls_fail: BlockBuster) -> None:
    """Nobody waits for a tick while a recording is played as lines."""
    may_block(blocking_calls_fail, "txt1/record/player.py", "play")


@with_learners
def test_every_setting_is_read(capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["config", "check", str(SETTINGS)]) == 0
    assert "valid" in capsys.readouterr().out
    told = yaml.safe_load(SETTINGS.read_text("utf-8"))
    config = load(str(SETTINGS), [], {}, {}).config
    assert config.geometry.radius_min == told["geometry"]["radius_min"]
    assert config.safety.command_timeout == told["safety"]["command_timeout"]


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("sensor fake", "there are list, check, virtual"),
        ("learn --worlds usual", "txt1_learners.studies worlds"),
        ("run --hal waveshare --port /dev/null", "hal_options.model"),
        pytest.param("run --set learning.pilot.period=1", "does not learn", marks=with_learners),
    ],
)
def test_a_command_that_changed_says_what_to_type_in_a_line(
    line: str, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert execute(line.split()) == 2
    error = capsys.readouterr().err.strip()
    assert told in error and "\n" not in error


def test_a_recording_is_shown_and_exported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["log", "info", str(DRIVE)]) == 0
    assert "/odom" in capsys.readouterr().out
    table = tmp_path / "odom.csv"
    assert execute(["log", "export", str(DRIVE), "--topic", "/odom", "-o", str(table)]) == 0
    rows = list(csv.DictReader(table.read_text("utf-8").splitlines()))
    assert len(rows) == 100
    # as version 0.2.0 told it at the end
    assert float(rows[-1]["pose.pose.position.x"]) == pytest.approx(0.391, abs=0.0005)
    assert execute(["replay", "--speed", "100", str(DRIVE)]) == 0


def test_its_verification_says_that_it_is_older(capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["replay", "--verify", str(DRIVE)]) != 0
    told = capsys.readouterr()
    assert "txt1 0.2.0 recorded it" in told.out
