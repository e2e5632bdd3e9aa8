"""What somebody meets first: `txt1` alone, the demo, the shell's completion, a report."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from txt1 import __version__
from txt1.cli import COMMANDS, execute, parsers
from txt1.errors import NotArmed


def test_alone_it_says_in_ten_lines_what_to_type(capsys: pytest.CaptureFixture[str]) -> None:
    assert execute([]) == 0
    told = capsys.readouterr().out
    assert told.count("\n") <= 10
    assert all(command in told for command in ("txt1 demo", "txt1 run", "txt1 --help"))


def test_package_project_citation_and_changelog_name_the_same_version() -> None:
    root = Path(__file__).parents[2]
    assert f'version = "{__version__}"\n' in (root / "pyproject.toml").read_text()
    assert f"version: {__version__}\n" in (root / "CITATION.cff").read_text()
    assert f"\n## {__version__} (" in (root / "CHANGELOG.md").read_text()


def test_every_command_and_action_has_a_help() -> None:
    known = {name: each.format_help() for name, each in parsers()}
    assert set(COMMANDS) <= set(known)
    assert {"log info", "config show", "hal check"} <= set(known)
    assert all("usage: txt1" in text for text in known.values())


@pytest.mark.parametrize("shell", ["bash", "zsh"])
def test_completion_knows_commands_and_their_options(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["completion", shell]) == 0
    script = capsys.readouterr().out
    assert all(word in script for word in ("experiment", "--headless", "--duration"))
    if shell == "bash" and shutil.which("bash"):
        asked = f"{script}\nCOMP_WORDS=(txt1 exp) COMP_CWORD=1; _shtab_txt1 txt1 exp txt1; echo ${{COMPREPLY[@]}}"
        ended = subprocess.run(["bash", "-c", asked], capture_output=True, text=True, check=True)
        assert ended.stdout.split() == ["experiment"]


def test_the_demo_shows_all_its_steps_and_what_to_type(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert execute(["demo", "--out", str(tmp_path / "demo"), "--seed", "1"]) == 0
    told = capfd.readouterr().out
    said = [line.split(" s  ", 1)[1] for line in told.splitlines() if re.search(r" s  \d/5 ", line)]
    assert [line[0] for line in said] == list("12234555"[: len(said)]) and said[-1][0] == "5"
    assert all(" You: txt1 " in line for line in said)
    assert "the light after" in told and "bit for bit" in said[-1] and "not the same" not in told
    stood = re.findall(r"v=([+-][\d.]+) m/s .* armed; 3/5 ", told)
    assert max(map(float, stood)) > 0.4 and abs(float(stood[-1])) < 0.01, "it drives to the box, and stands before it"
    assert 70.0 <= float(re.findall(r"(?m)^t= *([\d.]+) s", told)[-1]) <= 100.0, "ninety seconds"
    assert {"demo.mcap", "part.mcap", "learned"} <= {each.name for each in (tmp_path / "demo").iterdir()}


def test_the_demo_drives_nothing_but_the_simulation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("TXT1_HAL", "serial")
    assert execute(["demo", "--out", str(tmp_path / "demo")]) == 2
    assert "a practice drives the simulation only" in capsys.readouterr().err


def test_a_first_screen_is_refused_where_there_are_none(capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["run", "--headless", "--duration", "1", "--screen", "5"]) == 2
    assert "--screen: without screens it has no effect; leave it out" in capsys.readouterr().err


def test_a_learners_setting_is_refused_for_a_robot_that_does_not_learn(capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["run", "--headless", "--duration", "1", "--set", "learning.goal_period=1"]) == 2
    told = "--set learning.goal_period=1: this robot does not learn, so it would have no effect; add --learn"
    assert told in capsys.readouterr().err


def test_learning_tells_its_world_after_all_was_accepted(capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["learn", "--agent", "nobody"]) == 2
    assert "in the world" not in capsys.readouterr().err


def test_a_program_that_may_not_drive_is_told_the_remedy_first() -> None:
    assert str(NotArmed("an empty battery")) == "call Robot.arm() or press m: not armed: an empty battery"


def test_a_report_marks_where_the_robot_was_disarmed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from txt1.record.report import Content, draw  # matplotlib takes 0.3 s, for each process that collects the tests

    log = tmp_path / "wall.mcap"
    words = ["--headless", "--speed", "max", "--seed", "1", "--duration", "9", "--drive", "0.5,0", "--log", str(log)]
    assert execute(["run", *words]) == 3
    capsys.readouterr()
    content = Content(log)
    assert len(content.disarms) == 1 and 5.0 < content.disarms[0] < 7.0
    assert content.tasks["controller"]["cycles"] == "450"
    assert draw(content).startswith(b"\x89PNG")
