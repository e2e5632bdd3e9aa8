"""The Robot API: every topic, service and setting of the original driver (thesis 3.4.3), in virtual time."""

import asyncio
import gc
import runpy
import sys
from fractions import Fraction
from math import inf, nan
from pathlib import Path
from typing import Any

import pytest
from numpy import float32

import txt1
from tests.e2e.conftest import ENDLESS
from txt1.config import Config
from txt1.control.pid import Gains
from txt1.control.schedule import GainSet
from txt1.errors import CommandRefused, ConfigError, NotArmed, NotCapable, TaskFault
from txt1.hal.base import Button, Capabilities, Inputs
from txt1.hal.registry import create
from txt1.hal.sim import SimHal
from txt1.kernel import garbage
from txt1.kernel.ticks import Ticks
from txt1.model.odometry import Odometry
from txt1.protocol.messages import PowerControl, Switch
from txt1.robot import SHUTDOWN, Robot

EXAMPLES = [
    path
    for path in sorted((Path(__file__).parents[2] / "examples").glob("*.py"))
    # a large package, and minutes of training; a board, and minutes in real time (test_processes)
    if "stable_baselines3" not in path.read_text() and path.stem != "learn_on_the_robot"
]


async def test_the_dozen_lines_of_the_readme_drive_the_robot() -> None:
    async with txt1.Robot.open(hal="sim", seed=1) as robot:
        await robot.load_gains()
        await robot.drive(v=0.5, omega=0.3, duration=2.0)
        assert robot.odometry.x > 0.5
        assert robot.odometry.theta == pytest.approx(0.6, abs=0.15)
        assert robot.battery.battery1 == pytest.approx(12.16, abs=0.05)


@pytest.mark.parametrize(
    "example",
    [pytest.param(path, marks=pytest.mark.long) if path.stem == "teach_by_driving" else path for path in EXAMPLES],
    ids=lambda path: path.stem,
)
def test_the_examples_run(example: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "argv", [str(example), "max"])
    runpy.run_path(str(example), run_name="__main__")
    assert "Odometry(" in capsys.readouterr().out


async def test_the_garbage_collector_looks_seldom_only_while_a_robot_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    # another test may have left a run that never ends
    monkeypatch.setattr(garbage, "_runs", 0)
    gc.set_threshold(*(before := (700, 10, 10)))
    async with Robot.open("sim", seed=1):
        assert gc.get_threshold()[0] > before[0]
    assert gc.get_threshold() == before


async def test_what_one_run_in_virtual_time_leaves_behind_is_collected_while_others_follow() -> None:
    before = gc.get_freeze_count()
    for _ in range(3):
        async with Robot.open(hal="sim"):
            assert gc.get_freeze_count() <= before  # more would be out of the collector's sight with each new run


async def test_drive_takes_as_long_as_asked_and_ends_at_rest(robot: Robot) -> None:
    start = robot.now
    await robot.drive(0.5, 0.0, 3.0)
    assert robot.now - start == pytest.approx(3.0, abs=1e-6)
    await asyncio.sleep(2.0)
    assert robot.hal.read(robot.now).ticks == robot.hal.read(robot.now + 1.0).ticks


async def test_the_odometry_stream_has_twenty_messages_a_second_and_ends_with_the_run() -> None:
    async with Robot.open("sim", seed=1, settings=ENDLESS) as robot:
        assert await robot.load_gains()

        async def collect() -> list[float]:
            return [message.v async for message in robot.odometry_stream()]

        reader = asyncio.create_task(collect())
        await asyncio.sleep(0)
        await robot.drive(0.5, 0.0, 5.0)
    speeds = await reader
    assert len(speeds) == pytest.approx(100, abs=1)
    assert speeds[-1] == pytest.approx(0.5, abs=0.05)


async def test_the_battery_stream_has_one_message_a_second(robot: Robot) -> None:
    stream = robot.battery_stream()
    times = []
    for _ in range(3):
        levels = await anext(stream)
        times.append(robot.now)
        assert 12.0 < levels.battery1 < 12.3
        assert levels.battery2 == 0.0
    assert times[2] - times[1] == pytest.approx(1.0, abs=0.01)


async def test_gains_are_acknowledged_and_take_effect(robot: Robot) -> None:
    assert await robot.load_gains(Gains(5.0, 9.0, 0.1), [GainSet(1.0, Gains(1.0, 2.0, 0.0))])
    table = robot.runtime.state.gains
    assert table.linear == Gains(5.0, 9.0, 0.1)
    assert table.angular.at(0.3) == Gains(1.0, 2.0, 0.0)


async def test_gains_whose_v_max_does_not_rise_are_rejected_and_the_old_ones_stay(robot: Robot) -> None:
    before = robot.runtime.state.gains
    sets = [GainSet(1.0, Gains(1, 1, 0)), GainSet(0.5, Gains(1, 1, 0))]
    assert not await robot.load_gains(Gains(1, 1, 0), sets)
    assert robot.runtime.state.gains == before
    assert robot.faults["gains_refused"] == 1


@pytest.mark.parametrize("bad", [nan, inf, 10**400, 10**5000, 1e7, "x"], ids=lambda bad: str(type(bad)))
async def test_gains_that_no_board_takes_are_refused_and_counted(robot: Robot, bad: Any) -> None:
    before = robot.runtime.state.gains
    with pytest.raises(CommandRefused, match="kp"):
        await robot.load_gains(Gains(bad, 1.0, 0.0))
    with pytest.raises(CommandRefused, match="ki"):
        await robot.load_gains(angular=[GainSet(1.0, Gains(1.0, bad, 0.0))])
    await asyncio.sleep(0.1)
    assert robot.runtime.state.gains == before
    assert robot.faults["gains_refused"] == 2


@pytest.mark.parametrize("bad", [nan, inf, 10**400, 10**5000, "x", None], ids=lambda bad: str(type(bad)))
async def test_a_value_that_is_no_finite_number_is_refused_before_anything_is_sent(robot: Robot, bad: Any) -> None:
    for command in (
        lambda: robot.command(bad, 0.0),
        lambda: robot.command(0.5, bad),
        lambda: robot.combined_odometry(0.0, 0.0, 0.0, bad, 0.0),
        lambda: robot.combined_odometry(bad, 0.0, 0.0, 0.0, 0.0),
        lambda: robot.servos(bad, 0),
        lambda: robot.pwm_test(bad, 0, 0),
    ):
        with pytest.raises(CommandRefused, match="finite"):
            command()
    await asyncio.sleep(0.1)
    assert robot.armed
    assert robot.faults["command_not_finite"] == 6
    assert robot.runtime.state.servos == (0, 0)


async def test_the_free_servos_go_where_they_are_told_without_a_velocity_command(robot: Robot) -> None:
    robot.servos(12000, -24000)
    await asyncio.sleep(0.1)
    assert robot.runtime.state.control.outputs[3:5] == (12000, -24000)
    await robot.drive(0.3, 0.0, 1.0)
    assert robot.runtime.state.control.outputs[3:5] == (12000, -24000)
    with pytest.raises(CommandRefused):
        robot.servos(float("nan"), 0)  # type: ignore[arg-type]


async def test_manual_pwm_steers_front_and_rear_apart(robot: Robot) -> None:
    await robot.set_manual(True)
    await robot.hold_pwm(motor=2000, front=-9000, rear=-9000, duration=2.0)
    x, y, theta = robot.pose or (0.0, 0.0, 0.0)
    assert theta == pytest.approx(0.0, abs=1e-6), "both axles steered alike move it sideways"
    assert x > 0.5
    assert abs(y) > 0.05
    await robot.set_manual(False)
    assert not robot.runtime.state.panel.manual


async def test_the_joystick_changes_screens_scrolls_and_toggles_manual_mode(robot: Robot) -> None:
    for button in (Button.RIGHT, Button.RIGHT, Button.LEFT, Button.DOWN, Button.CENTRE):
        robot.press(button)
    await asyncio.sleep(0.2)
    assert robot.runtime.state.panel == (1, 1, True)


async def test_the_switches_of_the_power_board_do_what_they_say(robot: Robot) -> None:
    robot.switch_power(Switch.ESC, False)
    await asyncio.sleep(0.1)
    assert robot.runtime.state.power == (True, False, True)
    robot.disarm()
    robot.switch_power(Switch.ATX, False)
    await asyncio.sleep(0.1)
    before = robot.hal.read(robot.now).ticks
    robot.hal.vehicle.state = robot.hal.vehicle.state._replace(v=0.5)  # type: ignore[attr-defined]
    await asyncio.sleep(0.5)
    assert robot.hal.read(robot.now).ticks == before, "without 5 V the encoders see nothing"


async def test_the_host_is_shut_down_only_when_allowed_and_disarmed_and_by_a_fixed_command(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(CommandRefused, match=r"host\.allow_shutdown"):
        await robot.shutdown_host()

    called: list[tuple[str, ...]] = []

    class Refusing:
        returncode = 1

        async def wait(self) -> int:
            return 1

    async def execute(*words: str) -> Refusing:
        called.append(words)
        return Refusing()

    monkeypatch.setattr(asyncio, "create_subprocess_exec", execute)
    async with Robot.open("sim", settings=["host.allow_shutdown=true"]) as allowed:
        with pytest.raises(CommandRefused, match="armed"):
            await allowed.shutdown_host()
        assert called == []
        await allowed.load_gains()
        await allowed.drive(0.5, 0.0, 2.0)
        allowed.disarm()
        with pytest.raises(CommandRefused, match="seen to stand"):
            await allowed.shutdown_host()
        assert called == []
        await asyncio.sleep(2.0)
        with pytest.raises(CommandRefused, match="exit code 1"):
            await allowed.shutdown_host()
    assert called == [("shutdown", "-h", "now")] == [SHUTDOWN]


async def test_a_simulated_robot_can_be_placed_and_its_odometry_goes_on(robot: Robot) -> None:
    await robot.drive(0.5, 0.0, 1.0)
    before = robot.odometry
    robot.place(2.0, -1.0, 1.5)
    await asyncio.sleep(0.1)
    assert robot.pose == pytest.approx((2.0, -1.0, 1.5), abs=0.01)
    assert robot.odometry[:3] == pytest.approx(before[:3], abs=0.05)


async def test_simulation_arms_by_itself_unless_told_not_to() -> None:
    async with Robot.open("sim") as robot:
        assert robot.armed
    async with Robot.open("sim", arm=False) as robot:
        assert not robot.armed
        with pytest.raises(NotArmed):
            await robot.drive(0.5, 0.0, 1.0)
    async with Robot.open("sim", settings=["safety.auto_arm=never"]) as robot:
        assert not robot.armed
        robot.arm()
        assert robot.armed


async def test_numbers_of_any_kind_are_taken(robot: Robot) -> None:
    for kind in (int, float32, Fraction):
        one, none = kind(1), kind(0)
        assert robot.command(one, none)
        robot.combined_odometry(none, none, none, one, none)
        robot.servos(one, none)
        assert await robot.load_gains(Gains(one, none, none), [GainSet(one, Gains(one, none, none))])
        assert robot.runtime.state.gains.linear == (1.0, 0.0, 0.0)
        await robot.set_manual(True)
        robot.pwm_test(one, none, none, one, none)
        await asyncio.sleep(0.05)
        await robot.set_manual(False)
    assert robot.runtime.state.servos == (1, 0)
    assert robot.armed


class SetpointHal(SimHal):
    """A board that closes its own loops, in a world where they are perfect."""

    name = "board"
    capabilities = Capabilities(pose=True, simulated=True)

    def read(self, now: float) -> Inputs:
        return Inputs(odometry=Odometry(v=self.outputs.v, omega=self.outputs.omega), odometry_time=now)


async def test_a_hal_that_takes_set_points_gets_them_and_runs_no_second_pid() -> None:
    hal = SetpointHal(create(Config()).vehicle)  # type: ignore[attr-defined]
    async with Robot.open(hal, arm=True) as robot:
        await robot.drive(0.5, 0.2, 1.0)
        assert robot.odometry[3:] == (0.5, 0.2)
        assert hal.outputs[:3] == (0, 0, 0)
        await asyncio.sleep(0.5)
        assert robot.odometry[3:] == (0.0, 0.0), "a stale command is a set-point of 0"
        for refused in (
            lambda: robot.servos(0, 0),
            lambda: robot.switch_power(Switch.ESC, False),
            lambda: robot.pwm_test(0, 0, 0),
            lambda: robot.place(0, 0, 0),
        ):
            with pytest.raises(NotCapable, match="'board'"):
                refused()
        with pytest.raises(NotCapable, match="by_hand"):
            await robot.set_manual(True)
        robot.press(Button.CENTRE)
        robot.runtime.post(PowerControl(Switch.ESC, False), robot.now)
        await asyncio.sleep(0.2)
        assert not robot.runtime.state.panel.manual
        assert robot.faults["power_control_refused"] == 1, "and the run goes on"


@pytest.mark.waits
def test_what_is_not_simulated_waits_for_being_armed_and_for_real_time() -> None:
    class Real(SetpointHal):
        capabilities = Capabilities()

    async def main() -> bool:
        async with Robot.open(Real(create(Config()).vehicle)) as robot:  # type: ignore[attr-defined]
            return robot.armed

    assert not txt1.run(main())
    with pytest.raises(ConfigError, match="real time only"):
        txt1.run(main(), speed="max")


async def test_two_runs_with_one_seed_are_alike_to_the_last_bit_and_another_seed_differs() -> None:
    async def final(seed: int) -> tuple[object, ...]:
        async with Robot.open("sim", seed=seed, settings=ENDLESS) as robot:
            await robot.load_gains()
            await robot.drive(0.5, 0.3, 5.0)
            return robot.odometry, robot.pose, robot.battery

    assert await final(7) == await final(7)
    assert await final(7) != await final(8)


async def test_a_task_of_the_users_own_runs_beside_the_robots(robot: Robot) -> None:
    times: list[float] = []

    async def mine(ticks: Ticks) -> None:
        async for now in ticks:
            times.append(now)

    start = robot.now
    robot.add_task("mine", 0.1, mine)
    await asyncio.sleep(1.05)
    assert len(times) == pytest.approx(11, abs=1)
    assert times[0] - start < 0.1
    assert robot.runtime.statistics()["mine"].misses == 0


async def test_a_command_in_the_instant_of_a_fault_leaves_the_block_with_the_fault_alone() -> None:
    faulted = asyncio.Event()

    async def fail(ticks: Ticks) -> None:
        async for now in ticks:
            if now > 0.5:
                faulted.set()  # wakes the program before the scheduler's callbacks come
                raise ArithmeticError("a mistake in the program")

    with pytest.raises(TaskFault, match="a mistake in the program"):
        async with Robot.open("sim", seed=1, settings=ENDLESS) as robot:
            robot.add_task("mine", 0.05, fail)
            await faulted.wait()
            await robot.drive(0.5, 0.0, 1.0)
    await asyncio.sleep(0.1)
    body = asyncio.current_task()
    assert body is not None
    assert body.cancelling() == 0
