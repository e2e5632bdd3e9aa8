"""Learning where nobody puts the robot down at a start: behind a wire, and with light sensors that seem real.

The virtual board's vehicle is the only one that knows where it is. A tracking system under the ceiling and light
sensors that see from there stand in for what a laboratory has.
"""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable, Iterator
from math import hypot, pi
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import txt1
from tests.e2e.conftest import ENDLESS
from tests.e2e.skilled import skilled
from txt1.board.board import Board
from txt1.cli import execute
from txt1.config import load
from txt1.errors import HalError, LightFault, TaskFault
from txt1.learning import qtable
from txt1.learning import task as learning
from txt1.learning.agent import Agent
from txt1.learning.registry import agent_of, make
from txt1.learning.task import LearningTask
from txt1.learning.trial import Phase, Pose, Trial, starts, task_of
from txt1.model.kinematics import wrap_angle
from txt1.model.light_sensors import LUX_MAX, SAMPLE_PERIOD, Readings
from txt1.navigation import PoseSource
from txt1.robot import Robot
from txt1.sensors.base import Reading
from txt1.sensors.light import LIGHT, PhidgetLight, eyes

BOUNDARY = 2.0
SETTINGS = (*ENDLESS, "serial.port=virtual", f"learning.boundary={BOUNDARY}")
CONFIG = load(overrides=SETTINGS).config


def vehicle_of(robot: Robot) -> Callable[[], Pose]:
    """The true pose of the vehicle behind the wire."""
    board: Board = robot.hal.port.board  # type: ignore[attr-defined]

    def read() -> Pose:
        state = board.runtime.hal.vehicle.state  # type: ignore[attr-defined]
        return state.x, state.y, state.theta

    return read


class Ceiling:
    """Light sensors that see the light from where the vehicle behind the wire is."""

    topic, period, simulated = LIGHT, SAMPLE_PERIOD, True

    def __init__(self, where: Callable[[], Pose]) -> None:
        self._where = where
        self._see = eyes(CONFIG, np.random.default_rng(2))
        self.closed = False

    async def open(self) -> None: ...

    def read(self, now: float) -> Reading[Readings]:
        return Reading(now, self._see(self._where()))

    async def close(self) -> None:
        self.closed = True


async def until(condition: Callable[[], bool], timeout: float = 200.0) -> None:
    async with asyncio.timeout(timeout):
        while not condition():
            await asyncio.sleep(0.05)


def trial_of(agent: Agent, episodes: int) -> Trial:
    return Trial(agent, task_of(CONFIG), starts(1, 1, episodes))


def from_start(trial: Trial, pose: Pose) -> tuple[float, float]:
    """How far a pose is from the trial's present start, m and rad."""
    x, y, theta = trial.start
    return hypot(pose[0] - x, pose[1] - y), abs(wrap_angle(pose[2] - theta))


# -- over the wire -----------------------------------------------------------------------------------------------


async def test_over_the_wire_it_drives_to_each_start_and_learns_from_there() -> None:
    async with Robot.open("serial", settings=SETTINGS, seed=1) as robot:
        assert await robot.load_gains()
        where = vehicle_of(robot)
        trial, source = trial_of(make("thesis", CONFIG, np.random.default_rng(1)), 3), Ceiling(where)
        await robot.add_sensor("light", source)
        task = LearningTask(robot, trial, PoseSource("ceiling", where))
        task.start()
        began: list[tuple[float, float]] = []
        phase = trial.phase
        farthest = 0.0
        while not task.ended.is_set():
            await asyncio.sleep(0.05)
            if trial.phase is not phase:
                phase = trial.phase
                if phase is Phase.REST:
                    began.append(from_start(trial, where()))
            if phase is Phase.MOVE:
                farthest = max(farthest, *map(abs, where()[:2]))
        assert [one.number for one in trial.episodes] == [1, 2, 3]
        assert len(began) == 3
        assert max(distance for distance, _ in began) < 0.05
        assert max(turn for _, turn in began) < 5.0 * pi / 180.0
        # it begins outside, where its first episodes end
        assert farthest < BOUNDARY + 0.5
        assert robot.faults["command_stale"] == robot.faults["missed_ticks"] == 0
    assert source.closed


async def test_over_the_wire_a_disarm_voids_the_episode_and_after_the_arm_it_is_done_again() -> None:
    async with Robot.open("serial", settings=SETTINGS, seed=1) as robot:
        assert await robot.load_gains()
        where = vehicle_of(robot)
        trial = trial_of(make("thesis", CONFIG, np.random.default_rng(1)), 2)
        await robot.add_sensor("light", Ceiling(where))
        task = LearningTask(robot, trial, PoseSource("ceiling", where))
        task.start()
        await until(lambda: len(trial.episodes) == 1 and trial.phase is Phase.REST)
        known, start = trial.agent.memory()["q"], trial.start
        await until(lambda: trial.phase is Phase.DRIVE)
        await asyncio.sleep(3.0)
        assert trial.agent.memory()["q"] != known
        robot.disarm("somebody was in the way")
        await asyncio.sleep(5.0)
        assert trial.phase is Phase.MOVE
        assert trial.agent.memory()["q"] == known, "what the broken episode taught is forgotten"
        assert len(trial.episodes) == 1
        rests = where()
        await asyncio.sleep(5.0)
        assert where() == rests, "it waits for the arm"
        assert from_start(trial, rests)[0] > 0.3
        robot.arm()
        await until(lambda: trial.phase is Phase.REST)
        assert trial.start == start
        assert from_start(trial, where())[0] < 0.05
        await until(task.ended.is_set)
        assert [one.number for one in trial.episodes] == [1, 2]
        assert trial.voided == 1


@pytest.mark.long
async def test_a_lost_pose_stops_the_robot_and_it_carries_on_when_it_is_seen_again() -> None:
    async with Robot.open("serial", settings=SETTINGS, seed=1) as robot:
        assert await robot.load_gains()
        where = vehicle_of(robot)
        seen = True
        trial = trial_of(skilled(CONFIG), 2)
        source = PoseSource("ceiling", lambda: where() if seen else None)
        await robot.add_sensor("light", Ceiling(where))
        task = LearningTask(robot, trial, source)
        task.start()
        for phase in (Phase.MOVE, Phase.DRIVE):
            await until(lambda phase=phase: trial.phase is phase and robot.odometry.v > 0.2)  # type: ignore[misc]
            seen = False
            await asyncio.sleep(3.0)
            assert robot.odometry.v == 0.0
            seen = True
        await until(task.ended.is_set)
        assert [one.success for one in trial.episodes] == [True, True]
        assert trial.voided == 1


@pytest.mark.parametrize("seen", [True, False])
async def test_who_ends_the_learning_gets_a_robot_that_stands_still_and_obeys(seen: bool) -> None:
    async with Robot.open("serial", settings=SETTINGS, seed=1) as robot:
        assert await robot.load_gains()
        where = vehicle_of(robot)
        enough = False
        source = PoseSource("ceiling", lambda: where() if seen or not enough else None)
        await robot.add_sensor("light", Ceiling(where))
        task = LearningTask(robot, trial_of(skilled(CONFIG), 2), source, stopped=lambda: enough)
        task.start()
        await until(lambda: robot.odometry.v > 0.2)  # on the way to the first start
        enough = True
        await until(task.ended.is_set, 1.0)
        await asyncio.sleep(2.0)
        rests = where()
        await asyncio.sleep(2.0)
        assert where() == rests
        await robot.drive(0.3, 0.0, 2.0)
        assert hypot(where()[0] - rests[0], where()[1] - rests[1]) > 0.4


def test_a_program_with_sensors_of_its_own_learns_and_keeps_a_table_to_drive_by(tmp_path: Path) -> None:
    agent = agent_of(CONFIG, "thesis", None)
    assert agent is not None

    async def learn() -> None:
        async with Robot.open("serial", settings=SETTINGS, seed=1, arm=True) as robot:
            assert await robot.load_gains()
            where = vehicle_of(robot)
            await robot.add_sensor("light", Ceiling(where))
            task = learning.start(robot, agent, PoseSource("ceiling", where), episodes=2)
            await task.ended.wait()
            assert [one.number for one in task.trial.episodes] == [1, 2]

    txt1.run(learn(), speed="max")
    file = tmp_path / "qtable.json"
    qtable.save(file, agent.table())
    driver = agent_of(CONFIG, None, file)
    assert driver is not None
    assert np.array_equal(driver.table().values, agent.table().values)


def test_learn_over_the_wire_says_what_is_missing_and_leaves_no_experiment_behind(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["learn", "--agent", "thesis", "--trials", "1", "--episodes", "1", "--out", str(tmp_path)]
    wire = ["--port", "virtual", "--speed", "max"]
    assert execute([*words, *wire]) == 1
    assert "needs four light sensors" in capsys.readouterr().err
    assert execute([*words, *wire, "--set", "board.link_timeout=0.3"]) == 1
    assert "needs four light sensors" in capsys.readouterr().err, (
        "another try with another setting is no other experiment"
    )
    assert execute([*words, "--hal", "sim", "--port", "virtual"]) == 2
    assert "only these HALs have a port" in capsys.readouterr().err
    assert execute(words) == 0


# -- Phidgets ----------------------------------------------------------------------------------------------------


class PhidgetError(Exception):
    """`PhidgetException` as version 1.26 of Phidget22 has it."""

    def __init__(self, code: int, description: str, details: str = "") -> None:
        self.code, self.description, self.details = code, description, details


class Channel:
    """`VoltageRatioInput` of an Interface Kit: the calls of Phidget22 1.26, and when it refuses them."""

    kit: list[Channel]
    """Those that are open, in the order in which they were opened."""
    fitted = range(8)

    def __init__(self) -> None:
        self.channel = 0
        self.attached = False
        self.interval, self.trigger = 256, 0.001
        self.changed: Callable[[Channel, float], None] | None = None
        self.detached: Callable[[Channel], None] | None = None
        self.attaches: Callable[[Channel], None] | None = None

    def setChannel(self, Channel: int) -> None:
        self.channel = Channel

    def setDeviceSerialNumber(self, DeviceSerialNumber: int) -> None:
        raise AssertionError("nobody has asked for a serial number")

    def setOnVoltageRatioChangeHandler(self, handler: Callable[[Channel, float], None] | None) -> None:
        self.changed = handler

    def setOnDetachHandler(self, handler: Callable[[Channel], None] | None) -> None:
        self.detached = handler

    def setOnAttachHandler(self, handler: Callable[[Channel], None] | None) -> None:
        self.attaches = handler

    def openWaitForAttachment(self, timeout: int) -> None:
        assert timeout == 5000
        if self.channel not in self.fitted:
            raise PhidgetError(3, "Timed Out", "No Phidgets were detected at all. Make sure your device is attached.")
        self.attached = True
        self.kit.append(self)

    def _need_kit(self) -> None:
        if not self.attached:
            raise PhidgetError(0x34, "Device not Attached")

    def getMinDataInterval(self) -> int:
        self._need_kit()
        return 1

    def setDataInterval(self, DataInterval: int) -> None:
        self._need_kit()
        assert isinstance(DataInterval, int)
        self.interval = DataInterval

    def setVoltageRatioChangeTrigger(self, VoltageRatioChangeTrigger: float) -> None:
        self._need_kit()
        self.trigger = VoltageRatioChangeTrigger

    def close(self) -> None:
        self.attached = False

    def report(self, ratio: float) -> None:
        """What the driver's thread does with a sample."""
        assert self.changed is not None
        if self.attached:
            self.changed(self, ratio)

    def unplug(self) -> None:
        """What the driver's thread does when the kit is gone."""
        assert self.detached is not None
        self.attached = False
        self.detached(self)

    def plug_in(self) -> None:
        """What the driver's thread does when the kit is back, with an interval and a trigger of its own."""
        assert self.attaches is not None
        self.attached, self.interval, self.trigger = True, 256, 0.001
        self.attaches(self)


@pytest.fixture
def kit(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Channel]]:
    """The channels of an Interface Kit, as they are opened."""
    ours = type("VoltageRatioInput", (Channel,), {"kit": []})
    contents: dict[str, dict[str, Any]] = {
        "Phidget22": {},
        "Phidget22.Devices": {},
        "Phidget22.Devices.VoltageRatioInput": {"VoltageRatioInput": ours},
        "Phidget22.PhidgetException": {"PhidgetException": PhidgetError},
    }
    for name, content in contents.items():
        module = ModuleType(name)
        module.__dict__.update(content)
        monkeypatch.setitem(sys.modules, name, module)
    yield ours.kit  # type: ignore[attr-defined]


async def test_a_phidgets_kit_is_read_in_lux_from_its_four_inputs(kit: list[Channel]) -> None:
    sensor = PhidgetLight()
    await sensor.open()
    assert [one.channel for one in kit] == [0, 1, 2, 3]
    assert all(one.interval == 16 and one.trigger == 0.0 for one in kit), "every sample, 62.5 times a second"
    assert all(np.isnan(sensor.read(1.0).value)), "nothing has been measured yet"
    for ratio, one in zip((0.1, 0.25, 0.0, 1.02), kit, strict=True):
        one.report(ratio)
    assert sensor.read(2.0).value == pytest.approx((100.0, 250.0, 1.0, LUX_MAX))
    kit[2].unplug()
    assert np.isnan(sensor.read(3.0).value[2])
    kit[2].plug_in()
    assert (kit[2].interval, kit[2].trigger) == (16, 0.0), "as often as before"
    kit[2].report(0.3)
    assert sensor.read(4.0).value[2] == pytest.approx(300.0)
    await sensor.close()
    assert not any(one.attached for one in kit)


async def test_a_kit_that_is_not_there_is_told_with_the_sensor_that_was_looked_for(
    kit: list[Channel], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Channel, "fitted", (0, 1))
    with pytest.raises(HalError, match="light sensor RL on analog input 2: Timed Out"):
        await PhidgetLight().open()
    assert len(kit) == 2
    assert not any(one.attached for one in kit), "those that were there are let go"


async def test_a_phidgets_library_that_cannot_be_loaded_says_what_it_lacks(
    kit: list[Channel], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(self: Channel) -> None:
        raise OSError("libusb-1.0.so.0: cannot open shared object file: No such file or directory")

    monkeypatch.setattr(Channel, "__init__", refuse)
    with pytest.raises(HalError, match=r"libusb-1\.0\.so\.0"):
        await PhidgetLight().open()


async def test_a_kit_that_is_unplugged_stops_the_robot_with_an_error_that_names_the_sensor(kit: list[Channel]) -> None:
    with pytest.raises(TaskFault, match="light sensor FR reads nan") as error:
        async with Robot.open("sim", seed=1, settings=ENDLESS) as robot:
            assert await robot.load_gains()
            see = eyes(CONFIG, np.random.default_rng(2))

            async def driver(ticks: Any) -> None:
                async for _ in ticks:
                    readings = see(robot.runtime.look().pose)
                    for one, lux in zip(kit, readings, strict=True):
                        one.report(lux / LUX_MAX)

            trial = trial_of(skilled(CONFIG), 9)
            robot.add_task("phidgets", 0.016, driver, priority=5)
            await robot.add_sensor("light", PhidgetLight())
            task = LearningTask(robot, trial)
            task.start()
            await until(lambda: any(one.success for one in trial.episodes))
            await until(lambda: trial.phase is Phase.DRIVE and robot.odometry.v > 0.2)
            for one in kit[1:2]:
                one.unplug()
            await until(task.ended.is_set, 3.0)
    assert isinstance(error.value.__cause__, LightFault)
    assert not robot.armed
    assert robot.hal.outputs.motor == 0  # type: ignore[attr-defined]
