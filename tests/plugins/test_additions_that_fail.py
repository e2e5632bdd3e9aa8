"""An addition that fails is told in one line by its name; the robot does not start, or stops safely, or stands."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable, Iterator
from functools import cache
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.e2e.test_record_learn import messages
from txt1 import additions
from txt1.cli import execute
from txt1.commands import UNGUARDED
from txt1.errors import TaskFault
from txt1.kernel.loop import run
from txt1.kernel.ticks import Ticks
from txt1.robot import Robot

SITE = Path(__file__).parent / "site"
WHY = "ValueError: no luck today"
CODE = r"""
import asyncio
from contextlib import asynccontextmanager
from txt1.additions import Addition

ADDITION = Addition("failing", 60, **{"settings": "plugin_speed_limit:SpeedLimit", "FIELD": "plugin_failing:FUNCTION"})

def fail():
    raise ValueError("no luck\ntoday")

async def prepare(runtime, settings):
    fail()

@asynccontextmanager
async def entering(subject, settings):
    fail()
    yield

@asynccontextmanager
async def leaving(subject, settings):
    try:
        yield
    finally:
        fail()

@asynccontextmanager
async def swallowing(subject, settings):
    try:
        yield
    except BaseException:
        pass

async def later():
    await asyncio.sleep(1.5)
    fail()

@asynccontextmanager
async def task(robot, settings):
    robot.alongside.append(asyncio.ensure_future(later()))
    yield

@asynccontextmanager
async def ready(robot, settings):
    robot.on_ready.append(later)
    yield

async def guard(runtime, settings):
    runtime.guard("failing", lambda v, omega, now: (v, omega) if now < 2.0 else GUARD)
"""


class Told(NamedTuple):
    """What a run has told."""

    code: int
    errors: str
    events: list[str]
    speeds: list[float]
    """The set-points, m/s."""


Fail = Callable[..., Told]


@pytest.fixture
def fail(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Iterator[Fail]:
    """Drives at 0.6 m/s for 3 s beside an addition that fails in this function."""

    def fail(field: str, function: str, guard: str = "None", *words: str) -> Told:
        code = CODE.replace("FIELD", field).replace("FUNCTION", function).replace("GUARD", guard)
        (tmp_path / "plugin_failing.py").write_text(code)
        log = tmp_path / "run.mcap"
        more = ("--speed", "max", "--seed", "1", "--duration", "3", "--headless", "--set", "failing.v=1")
        ended = execute(["run", *more, *(words or ("--drive", "0.6,0")), "--log", str(log)])
        errors = capsys.readouterr().err
        events = [event.msg for event in messages(log, "/rosout")]
        speeds = [setpoint.twist.linear.x for setpoint in messages(log, "/setpoint")]
        if speeds:  # a replay runs what watches and prepares, too
            again = ended if field in ("watch", "prepare") and function != "guard" else 0
            assert execute(["replay", "--verify", str(log)]) == again
        capsys.readouterr()
        return Told(ended, errors, events, speeds)

    point = EntryPoint("failing", "plugin_failing:ADDITION", additions.GROUP)
    monkeypatch.setattr("importlib.metadata.entry_points", lambda group: [point])
    monkeypatch.syspath_prepend(SITE)
    monkeypatch.syspath_prepend(tmp_path)
    yield fail
    sys.modules.pop("plugin_failing", None)


def line(function: str, why: str = WHY) -> str:
    return f"txt1: the addition 'failing' (plugin_failing:{function}) failed: {why}\n"


@pytest.mark.parametrize(("field", "function"), [("prepare", "prepare"), ("watch", "entering"), ("beside", "entering")])
def test_the_robot_does_not_start_without_an_addition_that_fails(fail: Fail, field: str, function: str) -> None:
    told = fail(field, function)
    assert (told.code, told.errors) == (1, line(function))
    assert not any(told.speeds)


@pytest.mark.parametrize("field", ["prepare", "watch", "beside"])
def test_nor_without_a_function_that_is_not_there(fail: Fail, field: str) -> None:
    told = fail(field, "missing")
    assert told.errors == line("missing", "AttributeError: module 'plugin_failing' has no attribute 'missing'")


@pytest.mark.parametrize("field", ["watch", "beside"])
def test_one_that_fails_at_the_end_is_told_and_the_robot_has_stopped(fail: Fail, field: str) -> None:
    told = fail(field, "leaving")
    assert (told.code, told.errors) == (1, line("leaving"))
    assert "disarmed: the run has ended" in told.events
    assert len(told.speeds) >= 150


@pytest.mark.parametrize("function", ["task", "ready"])
def test_one_whose_task_fails_ends_the_run_safely(fail: Fail, function: str) -> None:
    told = fail("beside", function)
    assert (told.code, told.errors) == (1, line(function))
    assert told.events[-1] == "disarmed: the run has ended"


@pytest.mark.parametrize("function", ["leaving", "swallowing"])
def test_the_error_that_ended_the_run_is_told_whatever_an_addition_does_then(fail: Fail, function: str) -> None:
    async def main(failing: Callable[[Robot], None]) -> None:
        async with Robot.open("sim", settings=["failing.v=1"]) as robot:
            failing(robot)
            await asyncio.sleep(1.0)

    async def task(ticks: Ticks) -> None:
        raise ValueError

    def end(robot: Robot) -> None:
        raise ZeroDivisionError

    fail("beside", function)
    with pytest.raises(ZeroDivisionError):
        run(main(end), speed="max")
    with pytest.raises(TaskFault, match="task 'mine' failed: ValueError"):
        run(main(lambda robot: robot.add_task("mine", 0.1, task)), speed="max")


@pytest.mark.parametrize(
    ("guard", "why"),
    [
        ("1 / 0", "ZeroDivisionError: division by zero"),
        ("None", "it returned None"),
        ("(v,)", "it returned (0.6,)"),
        ("(v, 'left')", "it returned (0.6, 'left')"),
        ("(float('nan'), 0.0)", "it returned (nan, 0.0)"),
        ("(10 ** 400, 0)", "it returned (1"),
    ],
)
def test_a_guard_that_fails_lets_nothing_through_any_more_and_ends_the_run(fail: Fail, guard: str, why: str) -> None:
    told = fail("prepare", "guard", guard)
    assert told.code == UNGUARDED
    assert told.errors.startswith(f"txt1: guard 'failing' failed: {why}") and told.errors.count("\n") == 1
    (event,) = [event for event in told.events if "failed" in event]
    assert event.startswith(f"guard 'failing' failed: {why}")
    assert event.endswith("; the robot stands for the rest of the run")
    assert told.speeds[95] == 0.6
    # the car has nothing to do after that, and the run is over before its 3 s
    assert not any(told.speeds[102:]) and len(told.speeds) < 140


@pytest.mark.parametrize("field", ["settings", "options", "commands", "wanted"])
def test_one_whose_other_parts_cannot_be_had_is_told_in_a_line(
    field: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    parts = {
        "settings": "plugin_missing:Section",
        "options": "plugin_missing:OPTIONS",
        "commands": {"broken": ("plugin_missing", "it is broken")},
        "wanted": lambda config: config.no_such_thing,
    }
    mine = additions.Addition("broken", **{field: parts[field]})  # type: ignore[arg-type]
    monkeypatch.setattr(additions, "ours", lambda: {"broken": mine})
    monkeypatch.setattr(additions, "strangers", cache(lambda: additions.Strangers({}, {})))
    words = {"settings": ["config", "show", "--set", "broken.x=1"], "commands": ["broken"]}
    assert execute(words.get(field, ["run", "--speed", "max", "--duration", "1"])) == 1
    (told,) = capsys.readouterr().err.splitlines()
    where = "wanted" if field == "wanted" else "plugin_missing"
    assert told.startswith(f"txt1: the addition 'broken' ({where}")
    assert "Error: " in told
