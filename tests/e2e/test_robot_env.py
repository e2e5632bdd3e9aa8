"""The tasks of the environments on the running robot, over the wire, behind the gate."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from math import atan2, hypot, pi
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import numpy as np
import pytest

from tests.e2e.conftest import ENDLESS
from tests.e2e.test_learning_on_hardware import vehicle_of
from txt1.config import load
from txt1.errors import Txt1Error
from txt1.kernel.ticks import Ticks
from txt1.learning.drive_tasks import task_named
from txt1.learning.robot_env import EnvStep, RobotEnv, StepTrial
from txt1.learning.task import LearningTask
from txt1.learning.trial import Phase
from txt1.model.odometry import Odometry
from txt1.navigation import PoseSource
from txt1.navigation.pose_source import true_pose
from txt1.record.reader import FilePass
from txt1.robot import Robot
from txt1.tasks.fields import LOG

pytest.importorskip("gymnasium")

WIRE = (*ENDLESS, "serial.port=virtual", "safety.v_max=0.6")


def steered(seen: np.ndarray) -> np.ndarray:
    """Drive at the place that is seen."""
    return np.array([1.0, np.clip(2.0 * atan2(seen[1], seen[0]), -1.0, 1.0)], np.float32)


class Outside:
    """Whoever gives the actions, in the robot's own time."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        config = load(None, WIRE).config
        self.trial = StepTrial(task_named("pose", config), np.random.default_rng(3))
        LearningTask(robot, self.trial, PoseSource("ceiling", vehicle_of(robot))).start()

    async def handed(self) -> EnvStep:
        """Return what is handed over next."""
        async with asyncio.timeout(200.0):
            while self.trial.handed.empty():
                await asyncio.sleep(0.01)
        return self.trial.handed.get()

    async def step(self, action: np.ndarray) -> EnvStep:
        """Give an action, and return what came of it."""
        v, omega = self.trial.task.driven(action[None])[0].tolist()
        self.trial.actions.put((v, omega))
        return await self.handed()


async def test_over_the_wire_episodes_begin_at_their_starts_and_steps_last_a_period() -> None:
    async with Robot.open("serial", settings=WIRE, seed=1) as robot:
        assert await robot.load_gains()
        outside = Outside(robot)
        where = vehicle_of(robot)
        for _ in range(2):
            outside.trial.ask()
            first = await outside.handed()
            x, y, theta = where()
            away = hypot(x - outside.trial.start[0], y - outside.trial.start[1])
            assert away < 0.1 and abs((theta - outside.trial.start[2] + pi) % (2.0 * pi) - pi) < 0.2
            assert outside.trial.task.low.shape == first.seen.shape and first.reward == 0.0
            began, one, total, count = robot.now, first, 0.0, 0
            while not (one.terminated or one.truncated) and count < 40:
                one = await outside.step(steered(one.seen))
                total, count = total + one.reward, count + 1
            assert robot.now - began == pytest.approx(count * outside.trial.task.period, abs=0.15)
            assert outside.trial.late == 0
            assert np.isfinite(total)
            outside.trial.void()
            while not outside.trial.handed.empty():
                outside.trial.handed.get()
        assert robot.faults["command_stale"] == 0


async def test_an_action_that_comes_late_is_told_and_the_robot_stands_meanwhile() -> None:
    async with Robot.open("sim", settings=(*ENDLESS, "learning.boundary=50"), seed=1) as robot:
        assert await robot.load_gains()
        config = robot.config
        trial = StepTrial(task_named("pose", config), np.random.default_rng(3))
        LearningTask(robot, trial).start()
        trial.ask()
        await asyncio.sleep(2.0)
        trial.handed.get_nowait()
        for pause in (0.0, 0.0, 0.0, 3.0):
            await asyncio.sleep(pause)
            standing = abs(robot.odometry.v) < 0.02
            trial.actions.put((0.3, 0.0))
            while trial.handed.empty():
                await asyncio.sleep(0.01)
            one = trial.handed.get()
        assert one.late == pytest.approx(3.0, abs=0.15) and trial.late == 1
        assert standing


async def test_a_stop_voids_the_episode_and_nothing_of_it_is_counted() -> None:
    async with Robot.open("serial", settings=WIRE, seed=1) as robot:
        assert await robot.load_gains()
        outside = Outside(robot)
        voids = 0
        for _ in range(6):
            outside.trial.ask()
            one = await outside.handed()
            for _ in range(3):
                one = await outside.step(steered(one.seen))
            assert not one.void
            robot.disarm()
            one = await outside.handed()
            voids += one.void
            assert (one.reward, one.truncated, one.terminated) == (0.0, True, False)
            await asyncio.sleep(1.5)
            assert outside.trial.handed.empty(), "nothing is handed over while it is disarmed"
            robot.arm()
        assert voids == 6


def test_a_robot_that_is_put_on_its_start_by_hand_never_drives_there_itself() -> None:
    trial = StepTrial(task_named("pose", load(None, ENDLESS).config), np.random.default_rng(3), by_hand=True)
    here = (5.0, 2.0, 1.0)
    trial.placed(0.0)
    for now in np.arange(0.0, 2.0, 0.05):
        # taken away again before it was seen
        assert trial.tick(now, False, here, Odometry()) == (0.0, 0.0)
        assert trial.phase is Phase.REST and trial.handed.empty()
    assert trial.tick(2.0, True, here, Odometry()) == (0.0, 0.0) and trial.handed.empty(), "it rests first"
    trial.tick(3.0, True, here, Odometry())
    assert trial.phase is Phase.DRIVE and not trial.handed.get_nowait().void


@pytest.mark.parametrize("why", ["disarmed", "another drives", "no pose"])
async def test_whatever_ends_a_rest_the_robot_rests_for_half_a_second_once_it_is_over(why: str) -> None:
    async with Robot.open("sim", settings=ENDLESS, seed=1) as robot:
        assert await robot.load_gains()
        trial = StepTrial(task_named("pose", robot.config), np.random.default_rng(3), by_hand=True)
        known, keys = [True], robot.source("keys")
        LearningTask(robot, trial, PoseSource("ceiling", lambda: true_pose(robot).read() if known[0] else None)).start()
        trial.placed(robot.now)
        await asyncio.sleep(0.3)
        if why == "another drives":
            assert keys.hold(0.1, 0.0)
        known[0] = why != "no pose"
        await asyncio.sleep(0.2)
        robot.disarm() if why == "disarmed" else keys.release()
        await asyncio.sleep(1.0)
        assert trial.phase is Phase.REST and trial.handed.empty()
        robot.arm()
        known[0], over = True, robot.now
        while trial.handed.empty():
            await asyncio.sleep(0.01)
        assert robot.now - over == pytest.approx(0.5, abs=0.07) and not trial.handed.get().void


class ByHand(RobotEnv):
    """A simulated robot that a person carries."""

    def __init__(self, **options: Any) -> None:
        # it has said that it waits for a person
        self.waits = threading.Event()
        settings = [*ENDLESS, "seed=2", "sim.start=[3,1,0]"]
        super().__init__("pose", settings=settings, hal="sim", arm=True, by_hand=True, prepare=self._known, **options)

    async def _known(self, robot: Robot) -> None:
        self.robot, self.loop = robot, asyncio.get_running_loop()
        robot.runtime.bus.subscribe(lambda _, one, time: "new start" in one.text and self.waits.set(), [LOG])
        robot.alongside.append(asyncio.ensure_future(self.person()))

    async def person(self) -> None:
        """Whoever is beside the robot."""

    def begins_once_armed(self, arm: Callable[[], None]) -> None:
        """An episode begins when the robot is armed, and not before."""
        began: SimpleQueue[float] = SimpleQueue()
        anew = threading.Thread(target=lambda: (self.reset(), began.put(self.robot.now)))
        anew.start()
        assert self.waits.wait(30.0), "it waits for a person"
        armed: SimpleQueue[float] = SimpleQueue()
        self.loop.call_soon_threadsafe(lambda: (armed.put(self.robot.now), arm()))
        assert began.get(timeout=30.0) >= armed.get() + 0.5
        anew.join()


def test_by_hand_it_begins_where_it_stands_waits_for_the_next_arming_and_records(tmp_path: Path) -> None:
    log = tmp_path / "drive.mcap"
    with ByHand(log=log) as env:
        seen, _ = env.reset()
        assert true_pose(env.robot).pose()[:2] == pytest.approx((3.0, 1.0), abs=0.05)
        env.step(steered(seen))
        env.loop.call_soon_threadsafe(env.robot.disarm)
        assert env.step(steered(seen))[4]["void"]
        env.begins_once_armed(env.robot.arm)
    assert "/learning/step" in {item.topic for item in FilePass(log)}


def test_after_it_was_carried_while_it_rested_the_next_episode_waits_for_a_person() -> None:
    class Carried(ByHand):
        async def person(self) -> None:
            while not (self.robot.armed and self.trial.phase is Phase.REST):
                await asyncio.sleep(0.02)
            self.robot.disarm()
            await asyncio.sleep(0.2)
            self.robot.place(1.0, 2.0, 0.0)
            self.robot.arm()

    with Carried() as env:
        seen, _ = env.reset()
        assert true_pose(env.robot).pose()[:2] == pytest.approx((1.0, 2.0), abs=0.05)
        assert not env.step(steered(seen))[4]["void"] and not env.waits.is_set()
        env.begins_once_armed(lambda: (env.robot.disarm(), env.robot.arm()))


def test_the_environment_runs_the_robot_in_a_thread_and_stops_it() -> None:
    with RobotEnv("pose", settings=[*ENDLESS, "seed=2"], hal="sim") as env:
        seen, _ = env.reset()
        for _ in range(3):
            seen, reward, _, _, told = env.step(steered(seen))
            assert env.observation_space.contains(seen) and np.isfinite(reward)
            assert set(told) == {"success", "touched", "late_s", "void"}
        with pytest.raises(ValueError, match="1 finite pairs"):
            env.step(np.array([np.nan, 0.0], np.float32))


def test_a_robot_that_has_failed_is_told_when_its_environment_is_closed() -> None:
    async def prepare(robot: Robot) -> None:
        async def broken(ticks: Ticks) -> None:
            async for _ in ticks:
                raise ValueError("it is broken")

        robot.add_task("broken", 0.5, broken)

    env = RobotEnv("pose", settings=[*ENDLESS, "seed=2"], hal="sim", prepare=prepare)
    with pytest.raises(Txt1Error, match="broken"):
        while True:
            env.reset()
    with pytest.raises(Txt1Error, match="broken"):
        env.close()
