"""The Pico's firmware, run by MicroPython with its memory locked, between the host's driver and a simulated vehicle."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from math import hypot

import pytest
from blockbuster import BlockBuster

from tests.e2e.conftest import ENDLESS, may_block
from txt1.cars.pico.virtual_pico import Pico, interpreter
from txt1.config import Config, load
from txt1.control.limits import Fault
from txt1.errors import MissingExtra, NotArmed, StopNotVerified
from txt1.experiments.identify import identify, try_out
from txt1.hal.base import Button
from txt1.hal.serial import SerialHal
from txt1.hal.serial import create as create_serial
from txt1.hal.simulated_controller import ControllerPort
from txt1.link.base import Link, connect
from txt1.link.impairments import paced
from txt1.protocol.layout import encode
from txt1.protocol.messages import Switch, Velocity
from txt1.robot import Robot

try:
    interpreter()
except MissingExtra:
    pytest.skip("MicroPython's unix port is not installed", allow_module_level=True)

SMALL_GAINS = "control.angular=[{v_max: 1.5, kp: 4, ki: 130, kd: 0.005}]"
"""One set: its frame has 34 bytes, of which a noisy line lets more through than of 242."""


@pytest.fixture(autouse=True)
def the_device_waits_for_its_firmware(blocking_calls_fail: BlockBuster) -> None:
    """It is a program of its own as a rule; here its clock is the host's, so it waits a tenth of a millisecond."""
    may_block(blocking_calls_fail, "txt1/cars/pico/virtual_pico.py", "_exchange", "_read")


@asynccontextmanager
async def robot_and_pico(*settings: str) -> AsyncIterator[tuple[Robot, Pico]]:
    """A host, its gains loaded, and the Pico that it drives."""
    config = load(None, ["hal=serial", "serial.port=pico", *ENDLESS, *settings]).config
    hal = create_serial(config)
    async with Robot.open(hal, config=config) as robot:
        assert await robot.load_gains(timeout=60.0)
        assert isinstance(hal, SerialHal) and isinstance(hal.port, ControllerPort) and hal.port.device is not None
        yield robot, hal.port.device


def speed(pico: Pico) -> float:
    """The vehicle's true speed, m/s."""
    return pico.hal.vehicle.state.v  # type: ignore[attr-defined, no-any-return]


async def test_it_drives_as_it_is_asked() -> None:
    async with robot_and_pico() as (robot, pico):
        await robot.drive(0.5, 0.25, 5.0)
        assert pico.state.armed and pico.state.link
        x, y, _ = pico.hal.read(pico.now).pose or (0.0, 0.0, 0.0)
        assert hypot(x, y) > 1.5
        assert robot.odometry.v == pytest.approx(0.5, abs=0.05)
        assert robot.odometry.omega == pytest.approx(0.25, abs=0.1)
        await asyncio.sleep(2.0)
        assert speed(pico) == 0.0


async def test_its_odometry_is_where_the_virtual_boards_is() -> None:
    ends = []
    for port in ("pico", "virtual"):
        config = load(None, ["hal=serial", f"serial.port={port}", "sim.noise.drag=0", *ENDLESS]).config
        async with Robot.open(config=config) as robot:
            await robot.load_gains()
            await robot.drive(0.5, 0.3, 10.0)
            await asyncio.sleep(2.0)
            ends.append(robot.odometry)
    ours, theirs = ends
    assert hypot(ours.x - theirs.x, ours.y - theirs.y) < 0.05
    assert abs(ours.theta - theirs.theta) < 0.05


class Host:
    """A host that sends what it is told to."""

    def connected(self, link: Link) -> None:
        self.link = link

    def received(self, data: bytes) -> None:
        """Take no notice."""

    def lost(self, reason: str) -> None:
        """Take no notice."""


async def test_a_host_that_dies_leaves_it_neutral_after_a_quarter_of_a_second_and_a_cycle() -> None:
    pico, host = Pico(load(None, ENDLESS).config), Host()
    await pico.power_up()
    try:
        connect(host, paced(pico, 57600))
        await asyncio.sleep(0.0)
        host.link.write(encode(Config().control.pid_set()))
        for _ in range(100):
            host.link.write(encode(Velocity(0.5, 0.0)))
            await asyncio.sleep(0.05)
        assert speed(pico) == pytest.approx(0.5, abs=0.05)
        await asyncio.sleep(0.25 + 0.02 - 0.05 + 0.02)
        assert pico.state.armed and pico.state.outputs[:3] == (0, 0, 0)
        await asyncio.sleep(2.0)
        assert not pico.state.armed and speed(pico) == 0.0
    finally:
        await pico.power_down()


async def test_a_restart_stops_the_vehicle_and_the_host_disarms_and_loads_the_gains_again() -> None:
    with pytest.raises(StopNotVerified, match="no odometry"):
        async with robot_and_pico() as (robot, pico):
            await robot.drive(0.5, 0.0, 4.0)
            drive = asyncio.ensure_future(robot.drive(0.5, 0.0, 4.0))
            await asyncio.sleep(1.0)
            await pico.restart(0.5)
            await asyncio.sleep(2.0)
            assert not robot.armed and robot.faults[Fault.LINK] == 1
            assert speed(pico) == 0.0
            drive.cancel()
            robot.switch_power(Switch.ESC, True)  # nobody saw it stop, so the host has switched it off
            await asyncio.sleep(8.0)
            robot.arm()
            await robot.drive(0.5, 0.0, 3.0)
            assert speed(pico) == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize("v", [0.0, 0.5])
@pytest.mark.parametrize(
    "pause", [0.01, 0.3, 3.0, *(pytest.param(each, marks=pytest.mark.long) for each in (0.1, 30.0))]
)
async def test_a_restart_is_noticed_whatever_its_pause_at_rest_and_in_motion(pause: float, v: float) -> None:
    with suppress(StopNotVerified):  # nobody sees the robot stand while its board has no power
        async with robot_and_pico() as (robot, pico):
            await robot.drive(0.5, 0.0, 2.0)
            await robot.drive(v, 0.0, 2.0)
            robot.command(v, 0.0)
            assert robot.armed
            await pico.restart(pause)
            await asyncio.sleep(1.0)
            assert not robot.armed
            assert robot.faults[Fault.LINK] == 1
            await asyncio.sleep(2.0)
            assert speed(pico) == 0.0
            assert abs(robot.odometry.x) < 0.3, "the odometry begins anew where the board's does"


LINES = ("drop=0.2", "flip=0.001", "duplicate=0.3", "split=true", "delay=0.05", "jitter=0.02")


@pytest.mark.parametrize("fault", [*LINES[:2], *(pytest.param(each, marks=pytest.mark.long) for each in LINES[2:])])
async def test_it_drives_and_stops_over_any_line(fault: str) -> None:
    async with robot_and_pico(SMALL_GAINS, f"board.fault.{fault}", f"serial.fault.{fault}", "seed=3") as (robot, pico):
        with suppress(NotArmed):  # at its origin, a pause of the line cannot be told from a restart
            await robot.drive(0.5, 0.2, 2.0)
        await robot.linked(10.0)
        assert await robot.load_gains(timeout=60.0)
        robot.arm()
        await robot.drive(0.5, 0.2, 2.0)
        assert speed(pico) == pytest.approx(0.5, abs=0.06)
        assert robot.odometry.v == pytest.approx(0.5, abs=0.08)
        robot.command(0.5, 0.0)
        await asyncio.sleep(2.0)
        assert robot.armed, "a stale command does not disarm"
        assert speed(pico) == pytest.approx(0.0, abs=0.005)
        x, y, _ = pico.hal.read(pico.now).pose or (0.0, 0.0, 0.0)
        assert hypot(robot.odometry.x, robot.odometry.y) == pytest.approx(hypot(x, y), rel=0.1)


async def test_the_centre_button_puts_it_into_manual_mode_where_velocity_moves_nothing() -> None:
    async with robot_and_pico() as (robot, pico):
        await robot.drive(0.5, 0.0, 2.0)
        pico.buttons = Button.CENTRE
        for _ in range(20):
            robot.command(0.5, 0.0)
            await asyncio.sleep(0.05)
        assert pico.state.manual and pico.state.outputs[:3] == (0, 0, 0)


async def test_the_esc_switched_off_stops_the_motor_and_its_loops_rest_until_it_is_back() -> None:
    async with robot_and_pico() as (robot, pico):
        await robot.drive(0.5, 0.0, 2.0)
        robot.switch_power(Switch.ESC, False)
        for _ in range(10):
            robot.command(0.5, 0.0)
            await asyncio.sleep(0.05)
        assert not pico.state.esc and pico.state.outputs[0] == 0
        robot.disarm()
        robot.switch_power(Switch.ESC, True)  # which waits until the loops have rested
        await asyncio.sleep(5.0)
        robot.arm()
        await robot.drive(0.4, 0.0, 2.0)
        assert speed(pico) == pytest.approx(0.4, abs=0.05), "nothing was wound up meanwhile"


@pytest.mark.long
async def test_two_minutes_of_driving_take_no_memory() -> None:
    async with robot_and_pico() as (robot, pico):
        for _ in range(20):  # the firmware ends with a MemoryError as soon as a cycle asks for memory
            await robot.drive(0.5, 0.3, 6.0)
        assert pico.state.armed


@pytest.mark.long
async def test_its_vehicle_is_found_by_driving_with_k_p_alone() -> None:
    async with robot_and_pico() as (robot, _):
        found = identify(await try_out(robot))
    vehicle = robot.config.sim.vehicle
    assert found.speed_gain == pytest.approx(vehicle.speed_gain, rel=0.05)
    assert found.time_constant == pytest.approx(vehicle.speed_time_constant, rel=0.1)
