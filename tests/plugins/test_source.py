"""A source of commands from another package is one module and its entry point."""

import json
import sys
from pathlib import Path

import pytest

from txt1.cli import execute

RABBIT = '''
"""Drives in hops."""

import asyncio


async def hop(robot):
    rabbit = robot.source("rabbit", priority=20, timeout=0.2)

    async def legs(ticks):
        async for now in ticks:
            if now % 2.0 < 1.0:
                rabbit.command(0.4, 0.0)
            else:
                rabbit.release()

    robot.add_task("legs", 0.1, legs)
    await asyncio.sleep(6.0)
    rabbit.release()


async def fall(robot):
    await asyncio.sleep(1.0)
    raise ZeroDivisionError("a stone")
'''

RUN = ("run", "--headless", "--duration", "5", "--speed", "max", "--json", "--set", "sim.room.length=.inf")


@pytest.fixture(autouse=True)
def rabbit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The package `rabbit`, as pip would install it."""
    (tmp_path / "rabbit.py").write_text(RABBIT)
    info = tmp_path / "rabbit-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: rabbit\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[txt1.sources]\nrabbit = rabbit:hop\nfalling = rabbit:fall\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "rabbit", raising=False)


def test_it_drives(capfd: pytest.CaptureFixture[str]) -> None:
    assert execute([*RUN, "--source", "rabbit"]) == 0
    run = json.loads(capfd.readouterr().out)
    assert 0.6 < run["odometry"]["x"] < 1.2, "at least two hops of a second"
    assert run["driver"]["name"] in ("", "rabbit")
    assert run["tasks"]["legs"]["cycles"] > 30


def test_one_that_fails_ends_the_run_and_says_why(capfd: pytest.CaptureFixture[str]) -> None:
    assert execute([*RUN, "--source", "falling"]) == 1
    assert "source of commands" in (told := capfd.readouterr().err) and "a stone" in told


def test_one_that_is_not_there_is_named_beside_those_that_are(capfd: pytest.CaptureFixture[str]) -> None:
    assert execute([*RUN, "--source", "rabit"]) == 2
    assert "no source of commands 'rabit'" in (told := capfd.readouterr().err) and "did you mean 'rabbit'?" in told
