"""A bridge beside a robot: what it may ask for, and that nothing it does harms the robot. Long form: benchmarks/."""

from __future__ import annotations

import asyncio
import os
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from txt1.bridges.registry import BRIDGES, bridge
from txt1.errors import ConfigError
from txt1.kernel.loop import run
from txt1.robot import Robot

TARGETS = Path(__file__).parents[1] / "unit" / "beside"
ROOT = TARGETS.parents[2]

STALE = 0.25 + 0.02
"""s after which a command of a silent source must have gone stale: the gate's time-out and one tick."""


@pytest.fixture(autouse=True)
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The bridges of the tests, by name."""
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}:{TARGETS}")
    for name in ("ask", "drive", "drive_then_hang", "flood", "leak"):
        monkeypatch.setitem(BRIDGES.ours, name, f"beside_targets:{name}")


async def until(condition: Callable[[], object], limit: float = 20.0) -> None:
    async with asyncio.timeout(limit):
        while not condition():
            await asyncio.sleep(0.005)


def standing(robot: Robot) -> bool:
    return robot.runtime.state.control.v == 0.0


def test_it_sees_the_topics_it_asked_for_and_drives_under_its_own_name() -> None:
    async def main() -> None:
        async with Robot.open(hal="sim", seed=1) as robot:
            await robot.load_gains()
            seen: list[dict[str, object]] = []
            async with bridge(robot, "ask", {"topics": ["/odom", "/rosout"]}, {"seen": lambda line: seen.append(line)}):
                await until(lambda: len(seen) >= 3 and robot.driver.name == "ask" and not standing(robot))
                robot.tell("hello")
                await until(lambda: any("events" in line for line in seen))
            assert robot.driver.name != "ask", "the wheel is free when the bridge has gone"
            assert set(seen[-1]["topics"]) == {"/odom"}  # type: ignore[call-overload]
            assert seen[0]["name"] == "sim" and seen[0]["version"] == 1
            said = [event["value"]["text"] for line in seen for event in line.get("events", ())]  # type: ignore[attr-defined]
            assert "hello" in said

    run(main())


def test_the_name_must_be_that_of_an_installed_bridge() -> None:
    async def main() -> None:
        async with Robot.open(hal="sim", seed=1) as robot:
            with pytest.raises(ConfigError, match="did you mean 'flood'"):
                async with bridge(robot, "floot"):
                    pass

    run(main())


def test_what_it_asks_wrongly_is_counted_and_told_once() -> None:
    async def main() -> None:
        async with Robot.open(hal="sim", seed=1) as robot:
            asked = [
                ["drive", {"v": "fast", "omega": 0.0}],
                ["drive", {"v": 1.0}],
                ["drive", {"v": float("nan"), "omega": 0.0}],
                ["fly", {}],
                ["press", {"button": "eject"}],
                ["subscribe", {"rate": 0}],
                ["fly", {}],
                ["tell", {"text": "done"}],
            ]
            told = lambda: [event.text for event in robot.runtime.state.events]  # noqa: E731
            async with bridge(robot, "ask", {"asked": asked}):
                await until(lambda: "bridge 'ask': done" in told())
            text = "\n".join(told())
            for part in (
                "v: 'fast' is no number", "missing a required argument", "must be a finite", "no request 'fly'",
                "'eject' is none", "rate: 0 Hz",
            ):  # fmt: skip
                assert part in text
            assert robot.armed

    run(main())


@pytest.mark.parametrize("what", ["hangs", "is stopped", "is killed"])
def test_the_commands_of_a_silent_bridge_go_stale_in_time(what: str) -> None:
    async def main() -> float:
        async with Robot.open(hal="sim", seed=1) as robot:
            await robot.load_gains()
            async with bridge(robot, "drive_then_hang" if what == "hangs" else "drive", silence=None) as beside:
                await until(lambda: not standing(robot))
                assert beside.pid is not None
                since = robot.now
                if what != "hangs":
                    os.kill(beside.pid, signal.SIGSTOP if what == "is stopped" else signal.SIGKILL)
                await until(lambda: standing(robot))
                took = robot.now - since
                assert robot.armed
                return took

    assert run(main()) < STALE + 0.05  # what this test takes to see it, on a busy machine


def test_a_flood_of_messages_misses_no_cycle_and_does_not_keep_the_keys_from_stopping() -> None:
    async def main() -> None:
        async with Robot.open(hal="sim", seed=1) as robot:
            await robot.load_gains()
            async with bridge(robot, "flood") as beside:
                await until(lambda: not standing(robot))
                keys = robot.source("keys")
                missed = robot.runtime.statistics()["controller"].misses
                began = robot.now
                while robot.now < began + 2.0:
                    keys.command(0.3, 0.0)
                    await asyncio.sleep(0.05)
                    assert robot.driver.name == "keys"
                assert robot.runtime.state.control.v == 0.3
                assert robot.runtime.statistics()["controller"].misses - missed <= 1  # none, but for a busy machine
                assert beside.counts["dropped"] > 10_000
                assert beside.counts["taken"] < 20 * 20 * (robot.now + 1.0)

    run(main())


def test_a_leak_is_the_leaking_process_s_own_affair() -> None:
    async def main() -> None:
        async with Robot.open(hal="sim", seed=1) as robot:
            await robot.load_gains()
            leaked: list[int] = []
            more = {"leaked": lambda bytes: leaked.append(bytes)}
            async with bridge(robot, "leak", {"total": 200 << 20, "rate": 400 << 20}, more):
                await until(lambda: leaked and leaked[-1] >= 200 << 20)
                assert not standing(robot)
                assert robot.runtime.statistics()["controller"].misses <= 1

    run(main())
