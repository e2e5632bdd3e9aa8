"""After a stop that the holder did not ask for the same hold does not drive on; who asks again drives."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from benchmarks.board_faults import BOARDS, GAPS, Hold, disturb, on_board, through_a_gap, watch
from tests.e2e.conftest import ENDLESS
from tests.examples import some
from txt1.errors import NotArmed, Overruled
from txt1.learning.registry import agent_of
from txt1.learning.task import LearningTask, need_light, start
from txt1.learning.trial import Phase
from txt1.robot import Robot
from txt1.sensors.light import SimulatedLight
from txt1.sim.lamp import LightSensors, PointLight, noise_for_jitter

TOLD = "was stopped for more than 0.5 s: it has to let go and ask again"


def told(robot: Robot) -> str:
    return "; ".join(event.text for event in robot.runtime.state.events)


# -- a line from the host to the board that is disturbed ----------------------------------------------------------


@pytest.mark.parametrize("duration", GAPS)
@pytest.mark.parametrize("v", some(0.3, 1.0, rest=[0.6]))
@pytest.mark.parametrize("board", BOARDS)
async def test_after_a_gap_it_is_never_faster_than_commanded(board: str, v: float, duration: float) -> None:
    through = await through_a_gap(board, v, duration)
    assert through.course.fastest < 1.2 * v
    assert through.ended or through.last > 0.9 * v, "it either drives on all the time, or not any more"


@pytest.mark.parametrize("v", [0.3, 1.0])
async def test_a_board_that_did_not_obey_gets_zeros_and_the_hold_has_to_let_go(v: float) -> None:
    async with on_board("original") as (robot, at):
        hold = Hold(robot, robot.source("keys"), v)
        await asyncio.sleep(3.0)
        await disturb(robot, 2.0)
        await asyncio.sleep(3.0)
        assert robot.armed and abs(at.vehicle.motion[3]) < 0.05
        assert "the car slows down under a constant command" in told(robot) and TOLD in told(robot)
        hold.v = 0.0
        await asyncio.sleep(0.2)
        hold.v = v
        await asyncio.sleep(3.0)
        assert at.vehicle.motion[3] == pytest.approx(1.07 * v, abs=0.03)


async def test_a_program_is_told_and_asks_again() -> None:
    async with on_board("original") as (robot, at):
        await robot.drive(0.6, 0.0, 2.0)
        gap = asyncio.ensure_future(disturb(robot, 2.0))
        with pytest.raises(Overruled, match="the robot was stopped without its asking; ask again"):
            await robot.drive(0.6, 0.0, 10.0)
        await gap
        await asyncio.sleep(1.0)
        await robot.drive(0.6, 0.0, 2.0)
        assert at.vehicle.motion[3] == pytest.approx(0.64, abs=0.03)


async def test_who_asks_again_at_once_gets_zeros_until_the_board_has_settled() -> None:
    async with on_board("original") as (robot, at):
        hold = Hold(robot, robot.program, 1.0)
        await asyncio.sleep(3.0)
        # a board of 2011 counts its messages once a second, so a shorter gap may pass unnoticed
        gap = asyncio.ensure_future(disturb(robot, 2.0))
        for _ in range(250):
            await asyncio.sleep(0.02)
            if robot.program.overruled:
                break
        assert robot.program.overruled
        robot.program.request()
        assert (await watch(at, at.vehicle, 4.0)).fastest < 1.2
        await gap
        assert hold.v == 1.0 and at.vehicle.motion[3] > 0.9, "and then it drives"


# -- a robot that is disarmed and armed again ---------------------------------------------------------------------


@pytest.mark.parametrize(("name", "goes_on"), [("keys", False), ("gamepad", False), ("web", False), ("script", True)])
async def test_arming_lets_programs_go_on_but_no_hold_of_a_hand(name: str, goes_on: bool) -> None:
    async with Robot.open("sim", settings=ENDLESS, seed=1) as robot:
        await robot.load_gains()
        hold = Hold(robot, robot.source(name), 0.5)
        await asyncio.sleep(1.0)
        robot.disarm()
        await asyncio.sleep(1.0)
        robot.arm()
        await asyncio.sleep(1.0)
        assert (robot.odometry.v > 0.4) is goes_on
        hold.v = 0.0
        await asyncio.sleep(0.2)
        hold.v = 0.5
        await asyncio.sleep(1.0)
        assert robot.odometry.v > 0.4


async def test_a_short_stop_ends_no_program() -> None:
    async with Robot.open("sim", settings=ENDLESS, seed=1) as robot:
        await robot.load_gains()
        Hold(robot, robot.source("script"), 0.5)
        await asyncio.sleep(1.0)
        robot.disarm()
        await asyncio.sleep(0.3)
        robot.arm()
        await asyncio.sleep(1.0)
        assert robot.odometry.v > 0.4


async def test_who_commanded_before_the_robot_was_armed_drives_when_it_is() -> None:
    async with Robot.open("sim", settings=ENDLESS, seed=1, arm=False) as robot:
        await robot.load_gains()
        Hold(robot, robot.source("script"), 0.5)
        await asyncio.sleep(2.0)
        robot.arm()
        await asyncio.sleep(1.0)
        assert robot.odometry.v > 0.4, "nothing was stopped"


# -- guards -------------------------------------------------------------------------------------------------------

LASER = ("sensors.laser.driver=sim_laser", "sim.room.length=20", "sim.room.width=20", "sim.start=[-8,0,0]")


async def test_a_guard_that_opens_after_its_sensor_s_gap_lets_no_hold_drive_on() -> None:
    async with Robot.open("sim", settings=LASER, seed=1) as robot:
        await robot.load_gains()
        hold = Hold(robot, robot.source("keys"), 0.5)
        await asyncio.sleep(2.0)
        assert robot.odometry.v > 0.4
        laser: Any = robot.sensors["laser"].sensor
        read, laser.read = laser.read, lambda now: None
        await asyncio.sleep(2.0)
        laser.read = read
        await asyncio.sleep(2.0)
        assert robot.armed and robot.odometry.v == 0.0 and TOLD in told(robot)
        hold.v = 0.0
        await asyncio.sleep(0.2)
        hold.v = 0.5
        await asyncio.sleep(1.5)
        assert robot.odometry.v > 0.4


@pytest.mark.parametrize("asks", ["zero", "request", "arm"])
async def test_a_stream_of_a_program_or_of_ros_goes_on_once_it_asks_again(asks: str) -> None:
    async with Robot.open("sim", settings=LASER, seed=1) as robot:
        await robot.load_gains()
        source = robot.source("ros")
        stream = Hold(robot, source, 0.5)
        await asyncio.sleep(2.0)
        laser: Any = robot.sensors["laser"].sensor
        read, laser.read = laser.read, lambda now: None
        await asyncio.sleep(2.0)
        laser.read = read
        await asyncio.sleep(2.0)
        assert robot.odometry.v == 0.0 and "'ros' was stopped for more than 0.5 s" in told(robot)
        if asks == "zero":
            stream.v = 0.0
            await asyncio.sleep(0.1)
            stream.v = 0.5
        elif asks == "request":
            assert source.request()
        else:
            robot.disarm()
            await asyncio.sleep(0.1)
            robot.arm()
        await asyncio.sleep(1.5)
        assert robot.odometry.v > 0.4


async def test_an_obstacle_that_is_seen_only_limits_the_command_and_goes_away() -> None:
    async with Robot.open("sim", settings=LASER, seed=1) as robot:
        await robot.load_gains()
        Hold(robot, robot.source("keys"), 0.5)
        await asyncio.sleep(1.0)
        gate = robot.runtime.gate
        see, *_ = gate.guards

        def blocked(v: float, omega: float, now: float) -> tuple[float, float]:
            see(v, omega, now)
            gate.limited = True
            return 0.0, 0.0

        gate.guards[:] = [blocked]
        await asyncio.sleep(2.0)
        assert robot.odometry.v == 0.0
        gate.guards[:] = [see]
        await asyncio.sleep(1.5)
        assert robot.odometry.v > 0.4 and TOLD not in told(robot)


# -- what each holder does ----------------------------------------------------------------------------------------


async def test_a_disarmed_program_is_told_by_the_gate() -> None:
    async with Robot.open("sim", settings=ENDLESS, seed=1) as robot:
        await robot.load_gains()
        asyncio.get_running_loop().call_later(1.0, robot.disarm)
        with pytest.raises(NotArmed):
            await robot.drive(0.5, 0.0, 5.0)
        await asyncio.sleep(1.0)
        robot.arm()
        await robot.drive(0.5, 0.0, 1.0)
        assert robot.odometry.v > 0.4


@pytest.mark.parametrize("board", BOARDS)
async def test_who_is_armed_anew_has_to_reach_its_command_anew(board: str) -> None:
    async with on_board(board) as (robot, at):
        for _ in range(3):
            robot.arm()
            await robot.drive(0.8, 0.0, 2.0)
            assert at.vehicle.motion[3] > 0.7
            robot.disarm()
            await asyncio.sleep(2.5)
        assert "slows down under a constant command" not in told(robot)


# -- a learner ----------------------------------------------------------------------------------------------------


async def learner_on(robot: Robot) -> LearningTask:
    """A learner at work, as `txt1 run --learn thesis` starts it."""
    await need_light(robot)
    return start(robot, agent_of(robot.config, "thesis", None))


async def until(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(120.0):
        while not condition():
            await asyncio.sleep(0.01)


async def stands_until_armed_anew(robot: Robot, task: LearningTask) -> None:
    """The learner that was stopped stands, says why, and drives again when the robot is armed anew."""
    await asyncio.sleep(3.0)
    for _ in range(50):
        assert robot.armed and robot.odometry.v == 0.0
        await asyncio.sleep(0.1)
    assert TOLD in told(robot)
    assert "the robot was stopped; the learner goes on when it is armed anew (press m)" in told(robot)
    assert task.trial.voided <= 1, "the episode in which it was stopped does not count"
    robot.arm()
    await until(lambda: robot.odometry.v > 0.1)


async def test_a_learner_whose_guard_s_sensor_was_silent_waits_until_it_is_armed_anew() -> None:
    room = (LASER[0], "sim.room.length=20", "sim.room.width=20")
    async with Robot.open("sim", settings=room, seed=1) as robot:
        await robot.load_gains()
        task = await learner_on(robot)
        await until(lambda: task.trial.phase is Phase.DRIVE and robot.odometry.v > 0.1)
        laser: Any = robot.sensors["laser"].sensor
        read, laser.read = laser.read, lambda now: None
        await asyncio.sleep(2.0)
        laser.read = read
        await stands_until_armed_anew(robot, task)


@pytest.mark.parametrize("phase", [Phase.MOVE, Phase.DRIVE])
async def test_a_learner_whose_board_did_not_obey_waits_until_it_is_armed_anew(phase: Phase) -> None:
    async with on_board("original") as (robot, at):
        light = LightSensors(PointLight(), noise_for_jitter(), np.random.default_rng(2))
        there = SimulatedLight(lambda pose: light.read(*pose), lambda: at.vehicle.motion[:3])
        await robot.add_sensor("light", there)
        task = await learner_on(robot)
        await until(lambda: task.trial.phase is phase and robot.odometry.v > 0.2)
        await disturb(robot, 2.0)
        await stands_until_armed_anew(robot, task)
