"""Keys, gamepad and programs on one robot: one of them drives."""

import asyncio
from itertools import pairwise

import pytest

from tests.e2e.conftest import ENDLESS, Sample
from txt1.control.commander import Driver
from txt1.driver import CommandSource
from txt1.errors import CommandRefused, ConfigError, NotArmed, Overruled
from txt1.experiments.profile import Profile, ProfileStep
from txt1.experiments.runner import Experiment
from txt1.kernel.ticks import Ticks
from txt1.navigation import follow, go_to
from txt1.robot import Robot
from txt1.tasks.fields import DRIVER

TICK = 0.02
ENTERS = 0.02 + TICK
"""s in which a command that is sent at once has become the controller's set-point."""


def keep_on(robot: Robot, source: CommandSource, v: float, omega: float = 0.0) -> list[tuple[float, bool]]:
    """Have a source command the same 20 times a second from now on; when, and whether it was obeyed."""
    told: list[tuple[float, bool]] = []

    async def task(ticks: Ticks) -> None:
        async for now in ticks:
            told.append((now, source.command(v, omega)))

    robot.add_task(source.name, 0.05, task)
    return told


async def hold(robot: Robot, source: CommandSource, v: float, seconds: float) -> None:
    """Hold a key or a stick, and let it go."""
    ends = robot.now + seconds
    while robot.now < ends:
        source.command(v, 0.0)
        await asyncio.sleep(0.05)
    source.release()


def setpoint(robot: Robot) -> float:
    return robot.runtime.state.control.v


async def test_keys_take_over_from_a_program_at_once_and_letting_go_does_not_set_it_off(
    robot: Robot, samples: list[Sample]
) -> None:
    keys = robot.source("keys")
    told = keep_on(robot, robot.program, 0.5)
    await asyncio.sleep(2.0)
    assert setpoint(robot) == 0.5
    assert robot.driver.name == "program"

    keys.command(-0.3, 0.0)
    assert keys.drives and not robot.program.drives
    await asyncio.sleep(ENTERS)
    assert setpoint(robot) == 0.0, "through zero"
    await hold(robot, keys, -0.3, 1.0)
    assert samples[-1].command_v == -0.3
    await asyncio.sleep(ENTERS)
    released = robot.now
    await asyncio.sleep(5.0)
    assert {s.command_v for s in samples if s.time >= released} == {0.0}
    assert robot.driver.name == ""
    assert robot.driver.refused["program"] == sum(not obeyed for _, obeyed in told)

    robot.command(0.0, 0.0)
    await asyncio.sleep(0.1)
    assert setpoint(robot) == 0.5, "it has been neutral once"


async def test_the_set_points_of_the_hand_over_are_those_of_one_source_or_zero(
    robot: Robot, samples: list[Sample]
) -> None:
    gamepad = robot.source("gamepad")
    keep_on(robot, robot.program, 0.5)
    for _ in range(3):
        await asyncio.sleep(0.33)
        await hold(robot, gamepad, 0.2, 0.41)
        await asyncio.sleep(0.06)
        robot.program.request()
    await asyncio.sleep(0.5)
    seen = [s.command_v for s in samples]
    steps = {(a, b) for a, b in pairwise(seen) if a != b}
    assert steps == {(0.0, 0.5), (0.5, 0.0), (0.0, 0.2), (0.2, 0.0)}, "it passes through zero"


async def test_a_gamepad_that_falls_silent_gives_the_wheel_back_and_the_program_waits(robot: Robot) -> None:
    gamepad = robot.source("gamepad", timeout=0.1)
    keep_on(robot, robot.program, 0.5)
    await asyncio.sleep(1.0)
    gamepad.command(0.2, 0.0)
    await asyncio.sleep(0.1 + 0.05 + ENTERS)
    assert robot.driver.name == ""
    assert setpoint(robot) == 0.0
    await asyncio.sleep(1.0)
    assert setpoint(robot) == 0.0


async def test_a_drive_is_told_who_took_the_wheel(robot: Robot) -> None:
    keys = robot.source("keys")
    driving = asyncio.ensure_future(robot.drive(0.5, 0.0, 10.0))
    await asyncio.sleep(1.0)
    await hold(robot, keys, 0.3, 0.5)
    with pytest.raises(Overruled, match="'program' does not drive: 'keys' has taken the wheel") as caught:
        await driving
    assert caught.value.driver == "keys"
    assert robot.armed
    await robot.drive(0.5, 0.0, 0.5)  # asked anew


async def test_a_drive_that_stands_is_told_and_none_begins_while_another_drives(robot: Robot) -> None:
    keys = robot.source("keys")
    driving = asyncio.ensure_future(robot.drive(0.0, 0.0, 10.0))
    await asyncio.sleep(1.0)
    pressing = asyncio.ensure_future(hold(robot, keys, 0.3, 0.5))
    await asyncio.sleep(0.1)
    for begin in (
        lambda: driving,
        lambda: robot.drive(0.5, 0.0, 1.0),
        lambda: go_to(robot, (1.0, 0.0, 0.0)),
        lambda: follow(robot, [(1.0, 0.0)]),
        lambda: Experiment(
            robot, Profile(title="-", figure="velocities", steps=(ProfileStep(v=0.3, omega=0.0, seconds=1.0),))
        ).run(),
    ):
        with pytest.raises(Overruled, match="'keys'"):
            await begin()
    await pressing


@pytest.mark.parametrize("drive", ["go_to", "follow"])
async def test_navigation_ends_when_it_is_overruled(robot: Robot, drive: str) -> None:
    keys = robot.source("keys")
    going = asyncio.ensure_future(
        go_to(robot, (3.0, 0.0, 0.0)) if drive == "go_to" else follow(robot, [(3.0, 0.0), (3.0, 3.0)])
    )
    await asyncio.sleep(2.0)
    await hold(robot, keys, 0.1, 0.3)
    with pytest.raises(Overruled, match="'keys'"):
        await going
    await asyncio.sleep(1.0)
    assert setpoint(robot) == 0.0


async def test_an_experiment_says_who_ended_it(robot: Robot) -> None:
    keys = robot.source("keys")
    experiment = Experiment(
        robot, Profile(title="-", figure="velocities", steps=(ProfileStep(v=0.3, omega=0.0, seconds=10.0),))
    )
    running = asyncio.ensure_future(experiment.run())
    await asyncio.sleep(2.0)
    keys.command(0.1, 0.0)
    await running
    assert experiment.outcome().stopped_by == "another source of commands, 'keys'"


async def test_an_emergency_stop_is_above_all_and_arming_makes_nobody_jump(robot: Robot) -> None:
    keys = robot.source("keys")
    keys.command(0.5, 0.0)
    await asyncio.sleep(0.1)
    robot.stop()
    await asyncio.sleep(0.05)
    assert setpoint(robot) == 0.0
    robot.arm()
    assert robot.driver.name == ""
    await asyncio.sleep(0.1)
    assert setpoint(robot) == 0.0
    with pytest.raises(NotArmed):
        robot.disarm()
        keys.insist(0.5, 0.0)


async def test_a_refused_command_refreshes_nothing(robot: Robot) -> None:
    keys = robot.source("keys")
    keys.command(0.5, 0.0)
    for _ in range(8):
        await asyncio.sleep(0.05)
        with pytest.raises(CommandRefused, match="finite"):
            keys.command(float("nan"), 0.0)
        with pytest.raises(CommandRefused, match="later than now"):
            keys.command(0.5, 0.0, robot.now + 1.0)
    assert setpoint(robot) == 0.0
    assert robot.driver.name == ""


async def test_a_name_stands_for_one_source() -> None:
    async with Robot.open("sim", settings=[*ENDLESS, "commander.timeouts={gamepad: 0.1}"]) as robot:
        robot.source("gamepad").command(0.5, 0.0)
        await asyncio.sleep(0.12)
        assert robot.driver.name == "", "its time-out is configured"
        with pytest.raises(ConfigError, match=r"'gamepad'.*this name is taken"):
            robot.source("gamepad")
        with pytest.raises(ConfigError, match=r"0\.5 s.*safety\.command_timeout"):
            robot.source("web", timeout=0.5)


@pytest.mark.parametrize("timeout", [0.1, 0.5])
async def test_a_command_is_good_for_as_long_as_is_configured(timeout: float) -> None:
    async with Robot.open("sim", seed=1, settings=[*ENDLESS, f"safety.command_timeout={timeout}"]) as robot:
        await robot.load_gains()
        await robot.drive(0.5, 0.0, 1.0)
        robot.command(0.5, 0.0)
        await asyncio.sleep(0.8 * timeout)
        assert setpoint(robot) == 0.5
        await asyncio.sleep(0.2 * timeout + 0.05)
        assert setpoint(robot) == 0.0


async def test_who_drives_and_who_was_refused_is_telemetry(robot: Robot) -> None:
    told: list[Driver] = []
    robot.runtime.bus.subscribe(lambda topic, driver, time: told.append(driver), [DRIVER])
    keys = robot.source("keys")
    keep_on(robot, robot.program, 0.5)
    await asyncio.sleep(1.0)
    await hold(robot, keys, 0.2, 0.5)
    await asyncio.sleep(0.5)
    names = [driver.name for driver in told]
    assert [name for name, before in zip(names, [None, *names], strict=False) if name != before] == [
        "",
        "program",
        "keys",
        "",
    ]
    assert told[-1] == robot.driver
    message = DRIVER.make(robot.driver)
    assert isinstance(message, dict)
    assert (message["refused"], message["times"]) == (["program"], [robot.driver.refused["program"]])
