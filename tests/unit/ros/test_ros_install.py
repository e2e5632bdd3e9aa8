"""`txt1 ros2 install`: what it tells while it works, and what it says if a part fails."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from txt1.cli import execute
from txt1.commands import OK, USAGE
from txt1.ros import install

PIP = """#!/bin/sh
case "$*" in
*pip*) for each in 1 2 3 4 5 6; do echo "Collecting ros-$each"; done; echo "Installing collected packages: ros" ;;
esac
test ! -e fails || { echo "no space left" >&2; exit 3; }
"""


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An environment whose Python only says what pip would."""
    python = tmp_path / "ros2" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text(PIP)
    python.chmod(0o755)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TXT1_ROS2_HOME", str(tmp_path / "ros2"))
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setattr(os, "uname", lambda: os.uname_result(("Linux", "", "", "", "x86_64")))
    return tmp_path / "ros2"


def test_it_tells_each_part_and_how_far_it_is(place: Path) -> None:
    told: list[tuple[float, str]] = []
    install.install(place, "jazzy", lambda share, doing: told.append((share, doing)))
    shares = [share for share, _ in told]
    assert shares == sorted(shares) and len(set(shares)) > 6 and shares[-1] < 1.0
    assert [doing for _, doing in told if doing != install.FETCHING] == [install.TYPES]
    assert (place / install.STATE).exists()


def test_without_a_terminal_a_line_tells_each_part(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["ros2", "install"]) == OK
    told = capsys.readouterr().err.splitlines()
    assert told[0].startswith(f"txt1: installing ROS 2 jazzy into {place}")
    assert told[1:] == [f"txt1: {install.FETCHING}", f"txt1: {install.TYPES}"]


def test_a_part_that_fails_is_told_with_its_last_words(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (place.parent / "fails").touch()
    assert execute(["ros2", "install"]) == USAGE
    last = capsys.readouterr().err.splitlines()[-1]
    assert last == "txt1: installing the wheels: Collecting ros-6 / Installing collected packages: ros / no space left"
