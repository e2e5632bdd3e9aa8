"""An addition of another package: a section, an option, a command, a guard, a topic; no file of txt1's knows of it."""

from __future__ import annotations

import json
from collections.abc import Callable
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import pytest

from txt1 import additions
from txt1.cli import execute
from txt1.config import Config, load
from txt1.config.schema import RECORDED
from txt1.errors import ConfigError
from txt1.kernel import loop as kernel
from txt1.robot import Robot

SITE = Path(__file__).parent / "site"
Capture = pytest.CaptureFixture[str]
Run = Callable[..., dict[str, Any]]


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The package is installed."""
    monkeypatch.syspath_prepend(SITE)


@pytest.fixture
def run(capsys: Capture, installed: None) -> Run:
    """Drives at 0.6 m/s; what `--json` says."""

    def run(*words: str) -> dict[str, Any]:
        whole = ["run", "--json", "--speed", "max", "--seed", "1", "--duration", "3", "--drive", "0.6,0", *words]
        assert execute(whole) == 0
        told: dict[str, Any] = json.loads(capsys.readouterr().out)
        return told

    return run


def test_its_section_asks_for_it(run: Run) -> None:
    told = run("--set", "speed_limit.v=0.2")
    assert told["topics"]["/speed_limit"] == 0.2
    assert told["odometry"]["v"] == pytest.approx(0.2, abs=0.02)


def test_its_option_asks_for_it(run: Run) -> None:
    assert run("--speed-limit", "0.25")["odometry"]["v"] == pytest.approx(0.25, abs=0.02)


def test_nobody_asks_for_it(run: Run) -> None:
    told = run()
    assert "/speed_limit" not in told["topics"]
    assert told["odometry"]["v"] == pytest.approx(0.6, abs=0.05)


def test_its_option_is_refused_before_a_robot_starts(installed: None, capsys: Capture) -> None:
    assert execute(["run", "--speed-limit", "9"]) == 2
    assert capsys.readouterr().err == "txt1: --speed-limit 9: the gate's is lower; give less\n"


def test_a_wrong_value_in_its_section_is_told_by_its_key(installed: None) -> None:
    with pytest.raises(ConfigError, match=r"^speed_limit\.v: -1: input should be greater than 0 \(from --set"):
        load(overrides=["speed_limit.v=-1"])
    with pytest.raises(ConfigError, match=r"^speed_limit\.w: unknown key .*known here: v"):
        load(overrides=["speed_limit.w=1"])


def test_its_command_and_options_are_listed(installed: None, capsys: Capture) -> None:
    assert execute(["limit"]) == 0
    assert capsys.readouterr().out == "0.3 m/s\n"
    assert execute(["--help"]) == 0
    assert "limit" in capsys.readouterr().out
    assert execute(["run", "--help"]) == 0
    assert "--speed-limit V" in capsys.readouterr().out
    assert execute(["config", "show"]) == 0
    assert "speed_limit.v:" in capsys.readouterr().out


def test_a_program_asks_for_it_by_name(installed: None) -> None:
    from plugin_speed_limit import SpeedLimit

    async def main() -> float:
        async with Robot.open("sim", seed=1, additions={"speed_limit": SpeedLimit(v=0.2)}) as robot:
            await robot.load_gains()
            await robot.drive(0.6, 0.0, 2.0)
            return robot.odometry.v

    assert kernel.run(main(), speed="max") == pytest.approx(0.2, abs=0.02)


# -- additions that are not there, or wrong -----------------------------------------------------------------------


def test_a_section_without_its_addition_is_refused_and_kept_in_a_recording() -> None:
    with pytest.raises(ConfigError, match=r"^speed_limit\.v: unknown key .* needs the addition's package$"):
        load(overrides=["speed_limit.v=0.2"])
    with pytest.raises(ValueError, match="unknown key"):
        Config.model_validate({"speed_limit": {"v": 0.2}})
    recorded = Config.model_validate({"speed_limit": {"v": 0.2}}, context=RECORDED)
    assert recorded.model_dump()["speed_limit"] == {"v": 0.2}


async def test_one_that_is_named_and_not_installed_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"there is no addition 'speed_limit': install its package, .*estimation"):
        async with Robot.open("sim", additions={"speed_limit": None}):
            pass


@pytest.fixture
def announced(monkeypatch: pytest.MonkeyPatch) -> list[EntryPoint]:
    """The entry points of packages that are made up."""
    points: list[EntryPoint] = []
    monkeypatch.setattr("importlib.metadata.entry_points", lambda group: points)
    monkeypatch.syspath_prepend(SITE)
    return points


def test_two_of_one_name_are_told_and_neither_takes_part(announced: list[EntryPoint], capsys: Capture) -> None:
    announced += [EntryPoint("speed_limit", "plugin_addition:ADDITION", additions.GROUP)] * 2
    with pytest.raises(ConfigError, match=r"there are two additions 'speed_limit'.*uninstall one"):
        load(overrides=["speed_limit.v=0.2"])


def test_one_that_has_the_name_of_ours_is_told_and_does_not_take_its_place(
    announced: list[EntryPoint], capsys: Capture
) -> None:
    announced.append(EntryPoint("estimation", "plugin_addition:ADDITION", additions.GROUP))
    assert execute(["--help"]) == 0
    assert "there are two additions 'estimation': ours, and plugin_addition" in capsys.readouterr().err
    assert additions.named("estimation") is additions.ours()["estimation"]


def test_one_that_cannot_be_imported_is_told_in_a_line_and_holds_up_nobody(
    announced: list[EntryPoint], capsys: Capture
) -> None:
    announced.append(EntryPoint("broken", "plugin_that_is_not_there:ADDITION", additions.GROUP))
    assert execute(["--help"]) == 0
    assert capsys.readouterr().err.splitlines() == [
        "txt1: the addition 'broken' (plugin_that_is_not_there:ADDITION of the package '?') cannot be imported: "
        "ModuleNotFoundError: No module named 'plugin_that_is_not_there'"
    ]
    with pytest.raises(ConfigError, match=r"the addition 'broken'.*cannot be imported"):
        load(overrides=["broken.x=1"])
