"""The robot stops when anything breaks."""

import asyncio
from collections.abc import Callable
from math import inf, nan
from typing import Any

import pytest

from tests.e2e.conftest import ENDLESS, Sample, recorder
from tests.patience import until
from txt1.config import Config
from txt1.errors import CommandRefused, HalError, NotArmed, TaskFault
from txt1.hal.base import Button, Inputs, Outputs
from txt1.hal.registry import create
from txt1.hal.sim import SimHal
from txt1.kernel.clock import RealClock
from txt1.kernel.loop import RealTimeLoop, clock_of, run
from txt1.kernel.ticks import Ticks
from txt1.protocol.messages import PowerControl, PwmCommand, Switch, Velocity
from txt1.robot import Robot
from txt1.sim.parameters import Faults
from txt1.tasks.fields import CombinedSample, LinkState

TICK = 0.02
Every = Callable[[Callable[[], None]], None]


def outputs(robot: Robot) -> Outputs:
    """What the actuators get at this moment."""
    held = robot.hal.outputs  # type: ignore[attr-defined]
    assert isinstance(held, Outputs)
    return held


def true_speed(robot: Robot) -> float:
    return robot.hal.vehicle.state.v  # type: ignore[attr-defined, no-any-return]


async def test_at_power_up_nothing_moves_before_the_gains_are_loaded() -> None:
    async with Robot.open("sim", seed=1, settings=ENDLESS) as robot:
        with pytest.raises(CommandRefused, match="load_gains"):
            await robot.drive(1.0, 1.0, 2.0)
        for _ in range(40):  # as a program that commands by itself
            robot.command(1.0, 1.0)
            await asyncio.sleep(0.05)
        assert robot.armed
        assert outputs(robot)[:3] == (0, 0, 0)
        assert true_speed(robot) == 0.0
        told = [event.text for event in robot.runtime.state.events if "no gains are loaded" in event.text]
        assert told == ["no gains are loaded, so nothing moves: call 'await robot.load_gains()' first"]


async def test_when_commands_stop_the_set_point_is_zero_within_the_time_out_and_a_tick(
    robot: Robot, samples: list[Sample]
) -> None:
    await robot.drive(0.5, 0.0, 2.0)
    robot.command(0.5, 0.0)
    given = robot.now
    await asyncio.sleep(1.0)
    stopped = next(s.time for s in samples if s.time > given and s.command_v == 0.0)
    assert given + 0.25 < stopped <= given + 0.25 + TICK + 1e-9
    assert next(s.motor for s in samples if s.time >= stopped) == 0
    assert robot.armed, "a stale command does not disarm"
    assert robot.faults["command_stale"] == 1
    await robot.drive(0.5, 0.0, 2.0)
    assert true_speed(robot) == pytest.approx(0.5, abs=0.05), "the next fresh command resumes"


async def test_driving_on_after_a_stale_command_starts_with_cleared_controllers(
    robot: Robot, samples: list[Sample]
) -> None:
    await robot.drive(0.5, 0.0, 3.0)
    await asyncio.sleep(5.0)
    start = robot.now
    await robot.drive(0.1, 0.0, 1.0)
    assert max(s.v for s in samples if s.time > start) < 0.2


@pytest.mark.parametrize("v, omega", [(nan, 0.0), (inf, 0.0), (0.5, nan)])
async def test_a_command_not_finite_is_refused_and_does_not_keep_the_last_one_alive(
    robot: Robot, every_tick: Every, v: float, omega: float
) -> None:
    await robot.drive(0.5, 0.0, 1.0)
    robot.command(0.5, 0.0)

    def insist() -> None:
        with pytest.raises(CommandRefused):
            robot.command(v, omega)

    every_tick(insist)
    await asyncio.sleep(0.3)
    assert outputs(robot).motor == 0
    assert robot.faults["command_not_finite"] > 10


async def test_ten_metres_a_second_is_clipped_to_the_limit(robot: Robot, samples: list[Sample]) -> None:
    await robot.drive(10.0, 0.0, 4.0)
    assert max(s.command_v for s in samples) == 1.5
    assert max(s.v for s in samples) < 1.6
    assert robot.faults["speed_clipped"] > 0


async def test_a_huge_yaw_rate_at_standstill_turns_nothing(robot: Robot) -> None:
    await robot.drive(0.0, 50.0, 1.0)
    assert outputs(robot)[:3] == (0, 0, 0)
    assert robot.faults["yaw_rate_clipped"] > 0


async def test_pwm_30000_in_manual_mode_is_limited_to_what_motor_and_steering_stand(robot: Robot) -> None:
    await robot.set_manual(True)
    robot.pwm_test(30000, -30000, 30000)
    await asyncio.sleep(0.1)
    assert outputs(robot)[:3] == (8000, -18000, 18000)
    assert robot.faults["pwm_clipped"] == 1
    assert robot.faults["motor_limited"] > 0
    assert robot.faults["steering_limited"] > 0


async def test_pwm_test_is_obeyed_in_manual_mode_only(robot: Robot) -> None:
    with pytest.raises(CommandRefused, match="manual mode"):
        robot.pwm_test(3000, 0, 0)
    await asyncio.sleep(0.1)
    assert outputs(robot).motor == 0
    assert robot.faults["pwm_test_refused"] == 1


async def test_in_manual_mode_a_pwm_command_goes_stale_too(robot: Robot) -> None:
    await robot.set_manual(True)
    robot.pwm_test(3000, 0, 0)
    await asyncio.sleep(0.2)
    assert outputs(robot).motor == 3000
    await asyncio.sleep(0.2)
    assert outputs(robot).motor == 0


async def test_velocity_commands_move_nothing_in_manual_mode(robot: Robot) -> None:
    await robot.set_manual(True)
    await robot.drive(1.0, 0.0, 1.0)
    assert true_speed(robot) == 0.0


@pytest.mark.parametrize("faults", [Faults(right_encoder=True), Faults(left_encoder=True), Faults(True, True)])
@pytest.mark.parametrize("v", [0.2, 0.5, 1.0])
async def test_a_dead_encoder_stops_the_vehicle(robot: Robot, faults: Faults, v: float) -> None:
    await robot.drive(v, 0.0, 3.0)
    robot.hal.vehicle.faults = faults  # type: ignore[attr-defined]
    with pytest.raises(NotArmed, match=r"runaway|dead encoders"):
        await robot.drive(v, 0.0, 5.0)
    assert robot.faults["runaway"] == 1
    closed = robot.now
    robot.stop()  # whatever the operator does meanwhile
    while True:
        try:
            robot.arm()
        except NotArmed as error:
            assert "it did not obey, and " in str(error)
            await asyncio.sleep(TICK)
        else:
            break
    assert true_speed(robot) == 0.0, "dead encoders say 0 of a car that rolls"
    assert robot.now - closed < 2.1
    robot.hal.vehicle.faults = Faults()  # type: ignore[attr-defined]
    await robot.drive(0.5, 0.0, 2.0)
    robot.disarm()
    robot.arm()  # it obeyed since, so it may


async def test_a_car_with_dead_encoders_keeps_its_supply_and_host_while_it_rolls(robot: Robot) -> None:
    await robot.drive(1.0, 0.0, 3.0)
    robot.hal.vehicle.faults = Faults(True, True)  # type: ignore[attr-defined]
    with pytest.raises(NotArmed):
        await robot.drive(1.0, 0.0, 5.0)
    for _ in range(100):
        if true_speed(robot) > 0.0:
            assert not robot.runtime.stands(robot.now)
            with pytest.raises(CommandRefused, match="the ATX supply feeds the encoders"):
                robot.switch_power(Switch.ATX, False)
        await asyncio.sleep(TICK)
    assert true_speed(robot) == 0.0
    robot.switch_power(Switch.ATX, False)


async def test_who_rolls_by_one_encoder_is_not_armed_however_long_it_takes(robot: Robot) -> None:
    await robot.drive(0.5, 0.0, 3.0)
    vehicle = robot.hal.vehicle  # type: ignore[attr-defined]
    vehicle.faults = Faults(right_encoder=True)
    with pytest.raises(NotArmed, match="encoder is silent"):
        await robot.drive(0.5, 0.0, 5.0)
    read, pushed = robot.hal.read, [0]

    def rolls(now: float) -> Inputs:
        pushed[0] += 5
        inputs = read(now)
        return inputs._replace(ticks=(inputs.ticks[0], inputs.ticks[1] + pushed[0]))

    robot.hal.read = rolls  # type: ignore[method-assign]
    await asyncio.sleep(3.0)
    with pytest.raises(NotArmed, match="it did not obey, and still moves"):
        robot.arm()


async def test_a_wall_ends_in_a_stop_and_backing_out_after_arming_works() -> None:
    async with Robot.open("sim", seed=1) as robot:
        await robot.load_gains()
        with pytest.raises(NotArmed, match=r"blocked: a wall of the 5 x 5 m room"):
            await robot.drive(0.5, 0.0, 20.0)
        assert robot.pose is not None
        assert 2.1 < robot.pose[0] < 2.5 - 0.51 / 2.0 + 1e-6
        robot.arm()
        await robot.drive(-0.5, 0.0, 2.0)
        assert robot.pose[0] < 1.7


async def test_the_emergency_stop_acts_at_once_and_latches(robot: Robot) -> None:
    await robot.drive(0.5, 0.2, 2.0)
    robot.command(0.5, 0.2)
    await asyncio.sleep(0.1)
    assert outputs(robot).motor != 0
    robot.stop()
    assert outputs(robot)[:3] == (0, 0, 0), "without waiting for a tick"
    with pytest.raises(NotArmed, match="emergency stop"):
        await robot.drive(0.5, 0.0, 1.0)
    robot.command(0.5, 0.0)
    await asyncio.sleep(0.1)
    assert outputs(robot).motor == 0
    robot.arm()
    await robot.drive(0.5, 0.0, 2.0)
    assert true_speed(robot) == pytest.approx(0.5, abs=0.05)


async def test_a_command_from_before_a_stop_does_not_resume_with_arming(robot: Robot) -> None:
    await robot.drive(0.5, 0.0, 2.0)
    robot.command(0.5, 0.0)
    await asyncio.sleep(0.05)
    robot.stop()
    robot.arm()
    await asyncio.sleep(0.04)
    assert outputs(robot).motor == 0


async def test_a_host_that_falls_silent_loses_the_link_within_two_seconds_and_disarms(robot: Robot) -> None:
    await robot.drive(0.5, 0.0, 2.0)
    # the driver dies: from now on no Velocity message arrives, whatever the program wants
    robot.runtime.post = lambda message, time: None  # type: ignore[method-assign]
    robot.command(0.5, 0.0)
    await asyncio.sleep(2.0)
    assert not robot.armed
    assert robot.reason == "link lost"
    assert robot.faults["link_lost"] == 1
    with pytest.raises(NotArmed, match="look at the program that drives it"):
        robot.arm()


async def test_a_task_that_raises_stops_the_robot_and_the_error_reaches_the_user() -> None:
    async def clumsy(ticks: Ticks) -> None:
        async for now in ticks:
            if now > 3.0:
                raise ZeroDivisionError("a bug in my task")

    with pytest.raises(TaskFault, match=r"clumsy.*a bug in my task") as caught:
        async with Robot.open("sim", seed=1, settings=ENDLESS) as robot:
            await robot.load_gains()
            robot.add_task("clumsy", 0.1, clumsy)
            samples = recorder(robot)
            await robot.drive(0.5, 0.0, 60.0)
    assert isinstance(caught.value.__cause__, ZeroDivisionError)
    assert samples[-1].time <= 3.1 + TICK
    assert samples[-1].v > 0.4
    assert outputs(robot)[:3] == (0, 0, 0)
    assert robot.faults["task_fault"] == 1


async def test_a_controller_that_misses_five_cycles_disarms(robot: Robot, every_tick: Every) -> None:
    clock = clock_of(asyncio.get_running_loop())
    stalls = iter([0.13])
    every_tick(lambda: clock.spend(next(stalls, 0.0)))  # type: ignore[attr-defined]
    await asyncio.sleep(0.3)
    assert not robot.armed
    assert robot.faults["missed_ticks"] == 1
    assert "arm (m)" in robot.runtime.state.events[-1].text
    assert robot.runtime.statistics()["controller"].misses == 5


async def test_batteries_that_stay_bad_stop_the_robot_after_five_seconds(robot: Robot) -> None:
    read = robot.hal.read
    robot.hal.read = lambda now: read(now)._replace(batteries=(8.9, 0.0))  # type: ignore[method-assign]
    for _ in range(60):
        robot.command(0.3, 0.0)
        await asyncio.sleep(0.2)
    assert not robot.armed
    assert robot.reason == "batteries bad"
    assert any("Robot.shutdown_host" in event.text for event in robot.runtime.state.events)
    with pytest.raises(NotArmed, match="change the batteries first"):
        robot.arm()


@pytest.mark.parametrize("broken", [nan, inf, -inf])
async def test_a_voltage_that_is_not_finite_is_not_known_and_the_next_one_is(robot: Robot, broken: float) -> None:
    read = robot.hal.read

    async def measure(one: float, two: float, seconds: float) -> None:
        robot.hal.read = lambda now: read(now)._replace(batteries=(one, two))  # type: ignore[method-assign]
        await asyncio.sleep(seconds)

    await measure(broken, 0.0, 2.0)
    assert robot.battery[:4] == (None, 0.0, None, None)
    assert robot.faults["measurement_not_finite"] > 0
    await measure(12.0, 0.0, 1.1)
    assert robot.battery[:3] == (12.0, 0.0, "good")
    await measure(12.0, broken, 1.1)
    assert robot.battery[:3] == (12.0, None, "good"), "one is enough"
    assert robot.armed

    await measure(8.0, broken, 12.0)
    assert robot.reason == "batteries bad"
    await measure(broken, broken, 2.0)
    with pytest.raises(NotArmed, match="change the batteries first"):
        robot.arm()  # unknown is no better


async def test_with_the_esc_off_nothing_moves_and_nothing_lurches_when_it_returns(
    robot: Robot, samples: list[Sample]
) -> None:
    await robot.drive(0.5, 0.0, 2.0)
    robot.switch_power(Switch.ESC, False)
    with pytest.raises(CommandRefused, match="the ESC is off"):
        await robot.drive(0.5, 0.0, 4.0)
    for attempt in (1, 2):
        for _ in range(40):
            robot.command(0.5, 0.0)
            await asyncio.sleep(0.05)
        told = [event.text for event in robot.runtime.state.events if "the ESC is off, so" in event.text]
        assert len(told) == attempt, "once in an attempt"
        robot.command(0.0, 0.0)
        await asyncio.sleep(1.0)
    assert true_speed(robot) == 0.0
    assert outputs(robot).motor == 0
    robot.switch_power(Switch.ESC, True)
    back = robot.now
    await robot.drive(0.5, 0.0, 3.0)
    assert max(s.v for s in samples if s.time > back) < 0.55


async def test_the_atx_supply_cannot_be_switched_off_while_armed(robot: Robot) -> None:
    with pytest.raises(CommandRefused, match="disarm"):
        robot.switch_power(Switch.ATX, False)
    await asyncio.sleep(0.1)
    assert robot.runtime.state.power.atx
    robot.disarm()
    robot.switch_power(Switch.ATX, False)
    await asyncio.sleep(0.1)
    assert not robot.runtime.state.power.atx
    with pytest.raises(NotArmed, match="ATX"):
        robot.arm()


async def test_the_atx_supply_stays_on_while_a_disarmed_robot_rolls(robot: Robot) -> None:
    await robot.drive(1.0, 0.0, 2.0)
    robot.disarm()
    while true_speed(robot) > 0.05:
        with pytest.raises(CommandRefused, match="until they have seen the robot stand"):
            robot.switch_power(Switch.ATX, False)
        robot.runtime.post(PowerControl(Switch.ATX, False), robot.now)
        await asyncio.sleep(0.1)
        assert robot.runtime.state.power.atx
    await asyncio.sleep(0.5)
    robot.switch_power(Switch.ATX, False)
    await asyncio.sleep(0.5)
    assert not robot.runtime.state.power.atx
    robot.switch_power(Switch.ATX, True)
    await asyncio.sleep(0.1)
    with pytest.raises(CommandRefused, match="until they have seen the robot stand"):
        robot.switch_power(Switch.ATX, False)  # they have seen it for 0.1 s


async def test_without_encoders_the_atx_supply_is_switched_off_by_hand() -> None:
    async with Robot.open("sim", settings=[*ENDLESS, "geometry.counts_per_rev=0"], arm=False) as robot:
        await asyncio.sleep(1.0)
        with pytest.raises(CommandRefused, match="no encoders that see the robot stand; switch it off at the robot"):
            robot.switch_power(Switch.ATX, False)


async def test_combined_odometry_that_reads_10_per_cent_high_slows_the_car_by_9(
    robot: Robot, every_tick: Every
) -> None:
    feeding = True

    def feed() -> None:
        if feeding:
            robot.combined_odometry(0.0, 0.0, 0.0, 1.1 * true_speed(robot), robot.odometry.omega)

    every_tick(feed)
    await robot.drive(0.5, 0.0, 10.0)
    assert true_speed(robot) == pytest.approx(0.5 / 1.1, rel=0.01)
    feeding = False
    last = robot.now
    while robot.runtime.state.control.source != "encoder":
        robot.command(0.5, 0.0)
        await asyncio.sleep(TICK)
    assert robot.now - last <= 0.1 + 2 * TICK
    await robot.drive(0.5, 0.0, 5.0)
    assert true_speed(robot) == pytest.approx(0.5, rel=0.02)


async def test_combined_odometry_that_freezes_at_zero_cannot_run_the_robot_away(
    robot: Robot, samples: list[Sample], every_tick: Every
) -> None:
    every_tick(lambda: robot.combined_odometry(0.0, 0.0, 0.0, 0.0, 0.0))
    await asyncio.sleep(1.5)
    with pytest.raises(NotArmed, match=r"runaway: combined odometry"):
        await robot.drive(0.5, 0.0, 10.0)
    assert max(s.v for s in samples) < 1.8


async def test_an_encoder_with_its_sign_reversed_stops_the_robot(robot: Robot) -> None:
    read = robot.hal.read

    def reversed_left(now: float) -> Inputs:
        inputs = read(now)
        assert inputs.ticks is not None
        return inputs._replace(ticks=(inputs.ticks[0], -inputs.ticks[1]))

    robot.hal.read = reversed_left  # type: ignore[method-assign]
    with pytest.raises(NotArmed, match="against each other"):
        await robot.drive(0.5, 0.0, 10.0)


async def test_a_hal_that_reports_no_ticks_any_more_ends_the_run() -> None:
    with pytest.raises(TaskFault, match="no encoder ticks"):
        async with Robot.open("sim", seed=1, settings=ENDLESS) as robot:
            await robot.load_gains()
            await robot.drive(0.5, 0.0, 1.0)
            robot.hal.read = lambda now: Inputs()  # type: ignore[method-assign]
            await robot.drive(0.5, 0.0, 10.0)
    assert outputs(robot)[:3] == (0, 0, 0)


@pytest.mark.parametrize("v", [0.02, 0.05, 0.3, 1.0, 1.5])
@pytest.mark.parametrize("share", [0.0, 1.0])
async def test_no_ordinary_driving_is_taken_for_a_runaway(robot: Robot, v: float, share: float) -> None:
    for sign in (1.0, -1.0, 1.0):
        await robot.drive(sign * v, share * v / 0.56, 2.0)
        await robot.drive(sign * v, -share * v / 0.56, 2.0)
    assert robot.armed
    assert robot.faults["runaway"] == 0


async def test_a_command_given_at_the_instant_of_arming_but_before_it_does_not_count(robot: Robot) -> None:
    robot.disarm()
    robot.command(1.0, 0.0)
    robot.arm()
    await asyncio.sleep(0.2)
    assert true_speed(robot) == 0.0


@pytest.mark.parametrize("stop", [Robot.stop, Robot.disarm])
async def test_servos_that_were_told_to_move_before_arming_stay_where_they_are(
    robot: Robot, stop: Callable[[Robot], None]
) -> None:
    robot.servos(100, -100)
    await asyncio.sleep(0.1)
    robot.servos(12000, -24000)  # has not been carried out yet
    stop(robot)
    robot.arm()
    await asyncio.sleep(0.2)
    assert outputs(robot)[3:5] == (100, -100)

    stop(robot)
    with pytest.raises(NotArmed):
        robot.servos(12000, -24000)
    robot.runtime.post(PwmCommand(12000, -24000), robot.now)  # as a board takes it from its host
    await asyncio.sleep(0.2)
    robot.arm()
    await asyncio.sleep(0.2)
    assert outputs(robot)[3:5] == (100, -100)
    robot.servos(200, -200)
    await asyncio.sleep(0.1)
    assert outputs(robot)[3:5] == (200, -200)


async def test_a_pwm_test_does_not_survive_leaving_manual_mode(robot: Robot, samples: list[Sample]) -> None:
    await robot.set_manual(True)
    robot.pwm_test(5000, 0, 0)
    await asyncio.sleep(0.02)
    robot.press(Button.CENTRE)
    robot.press(Button.CENTRE)
    await robot.set_manual(False)
    await robot.set_manual(True)
    back = robot.now
    await asyncio.sleep(0.1)
    assert all(s.motor == 0 for s in samples if s.time >= back)


async def test_a_duration_that_is_no_number_is_refused(robot: Robot) -> None:
    with pytest.raises(CommandRefused, match="duration"):
        await robot.drive(0.5, 0.0, nan)


async def test_a_measurement_that_is_not_finite_stops_and_driving_resumes_after_it(robot: Robot) -> None:
    await robot.drive(0.5, 0.0, 2.0)
    for _ in range(4):
        robot.runtime.state.combined = CombinedSample(nan, 0.0, robot.now)  # past the gate, as a broken task would
        robot.runtime.state.link = LinkState(alive=True, combined=True)
        robot.command(0.5, 0.0)
        await asyncio.sleep(TICK)
    assert outputs(robot).motor == 0
    assert robot.faults["measurement_not_finite"] > 0
    await robot.drive(0.5, 0.0, 3.0)
    assert true_speed(robot) == pytest.approx(0.5, abs=0.05)


async def test_the_external_supply_drives_without_any_pack() -> None:
    async with Robot.open("sim", seed=1, settings=[*ENDLESS, "sim.battery.used_1=null"]) as robot:
        await robot.load_gains()
        await robot.drive(0.5, 0.0, 3.0)
        assert robot.battery.state == "external power"
        assert true_speed(robot) == pytest.approx(0.5, abs=0.05)


async def test_an_external_supply_above_14_v_is_cut_off_and_one_below_spares_the_packs() -> None:
    async with Robot.open("sim", seed=1, settings=[*ENDLESS, "sim.battery.external=13.9"]) as robot:
        await robot.load_gains()
        await robot.drive(0.5, 0.0, 5.0)
        hal: Any = robot.hal
        assert hal.vehicle.supply.packs == (0.0, None)
    async with Robot.open("sim", seed=1, arm=False, settings=[*ENDLESS, "sim.battery.external=14.1"]) as robot:
        with pytest.raises(NotArmed, match="cut off"):
            robot.arm()


async def test_a_pack_that_is_cut_off_stops_the_robot_and_cannot_be_armed() -> None:
    async with Robot.open("sim", seed=1, settings=[*ENDLESS, "sim.battery.used_1=49.99"]) as robot:
        await robot.load_gains()
        with pytest.raises(NotArmed):
            await robot.drive(0.5, 0.0, 10.0)
        with pytest.raises(NotArmed, match="cut off"):
            robot.arm()


@pytest.mark.parametrize("failing", ["open", "task"])
async def test_the_hardware_is_let_go_of_whatever_fails(failing: str) -> None:
    closed: list[bool] = []

    class Hardware(SimHal):
        async def open(self) -> None:
            if failing == "open":
                raise OSError("half-way")

        async def close(self) -> None:
            closed.append(True)
            await super().close()

    async def untidy(ticks: Ticks) -> None:
        try:
            async for _ in ticks:
                pass
        finally:
            raise ValueError("in its finally clause")

    hal = Hardware(create(Config()).vehicle)  # type: ignore[attr-defined]
    with pytest.raises((HalError, TaskFault)):
        async with Robot.open(hal) as robot:
            robot.add_task("untidy", 0.1, untidy)
            await asyncio.sleep(0.5)
    assert closed == [True]


async def test_a_flood_of_messages_is_bounded_and_counted(robot: Robot) -> None:
    for _ in range(1500):
        robot.runtime.post(Velocity(0.0, 0.0), robot.now)
    assert robot.faults["messages_dropped"] == 500


async def test_leaving_the_block_by_an_error_leaves_the_outputs_neutral() -> None:
    with pytest.raises(KeyError):
        async with Robot.open("sim", seed=1, settings=ENDLESS) as robot:
            await robot.load_gains()
            await robot.drive(0.5, 0.0, 2.0)
            raise KeyError("the user's own")
    assert outputs(robot)[:3] == (0, 0, 0)


async def test_cancelling_the_program_leaves_the_outputs_neutral() -> None:
    opened: asyncio.Future[Robot] = asyncio.get_running_loop().create_future()

    async def program() -> None:
        async with Robot.open("sim", seed=1, settings=ENDLESS) as robot:
            await robot.load_gains()
            opened.set_result(robot)
            await robot.drive(0.5, 0.0, 60.0)

    task = asyncio.create_task(program())
    robot = await opened
    await asyncio.sleep(2.0)
    assert outputs(robot).motor > 0
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert outputs(robot)[:3] == (0, 0, 0)


class Suspended:
    """A clock of a computer that sleeps when a test says so."""

    def __init__(self) -> None:
        self.slept_ns = 0
        self._running = RealClock()

    def now_ns(self) -> int:
        return self._running.now_ns()

    def suspended_ns(self) -> int:
        return self.slept_ns


@pytest.mark.usefixtures("patient")
@pytest.mark.parametrize(
    ("hal", "slept", "armed"), [("serial", 0.05, True), ("serial", 7200.0, False), ("sim", 7200.0, True)]
)
def test_a_robot_whose_computer_slept_wakes_up_disarmed_unless_its_world_slept_too(
    hal: str, slept: float, armed: bool
) -> None:
    async def main() -> None:
        loop, clock = asyncio.get_running_loop(), Suspended()
        assert isinstance(loop, RealTimeLoop)
        loop.clock = clock
        settings = ["serial.port=virtual", "safety.missed_ticks_max=1000"]  # 20 s
        async with Robot.open(hal, seed=1, settings=settings, arm=True) as robot:
            await robot.load_gains()
            source = robot.source("test")
            control = lambda: robot.runtime.state.control  # noqa: E731
            cycles = lambda: robot.runtime.statistics()["controller"].cycles  # noqa: E731
            await until(lambda: source.command(0.5, 0.0) and control().outputs.v)
            clock.slept_ns += round(slept * 1e9)
            before = cycles()
            await until(lambda: source.command(0.5, 0.0) and cycles() > before + 2 and bool(control().v) is armed)
            assert robot.armed is armed
            assert (control().outputs.v != 0.0) is armed
            if not armed:
                assert robot.runtime.gate.reason == "the computer slept 7200.0 s"
                assert "arm (m)" in robot.runtime.state.events[-1].text
                robot.arm()
                before = cycles()
                await until(lambda: cycles() > before + 2)
                assert control().v == 0.0  # asked for before it was armed again

    run(main())
