"""A radio control at a Pico, whose firmware runs under MicroPython with its memory locked, and the host beside it."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress

import pytest
from blockbuster import BlockBuster

from tests.e2e.conftest import ENDLESS, may_block
from tests.e2e.test_rc import found
from txt1.cars.pico.virtual_pico import Pico, interpreter
from txt1.config import load
from txt1.control.limits import Fault
from txt1.errors import ConfigError, HalError, MissingExtra, StopNotVerified
from txt1.hal.serial import SerialHal
from txt1.hal.serial import create as create_serial
from txt1.hal.simulated_controller import ControllerPort
from txt1.kernel.ticks import Ticks
from txt1.rc.robot_end import RcHand, beside
from txt1.rc.settings import RcParameters
from txt1.rc.take_over import RcState
from txt1.rc.virtual_receiver import VirtualReceiver
from txt1.robot import Robot

try:
    interpreter()
except MissingExtra:
    pytest.skip("MicroPython's unix port is not installed", allow_module_level=True)


@pytest.fixture(autouse=True)
def the_device_waits_for_its_firmware(blocking_calls_fail: BlockBuster) -> None:
    """It is a program of its own as a rule; here its clock is the host's, so it waits a tenth of a millisecond."""
    may_block(blocking_calls_fail, "txt1/cars/pico/virtual_pico.py", "_exchange", "_read")


@asynccontextmanager
async def radio() -> AsyncIterator[tuple[Robot, Pico, VirtualReceiver, RcHand]]:
    """An armed host, and a Pico whose hand drives."""
    config = load(None, ["hal=serial", "serial.port=pico", "rc.port=board", *ENDLESS]).config
    hal = create_serial(config)
    async with Robot.open(hal, config=config, arm=False) as robot:
        assert isinstance(hal, SerialHal) and isinstance(hal.port, ControllerPort)
        assert await robot.load_gains(timeout=60.0)
        pico = hal.port.device
        assert isinstance(pico, Pico) and pico.radio is not None
        async with beside(robot, config.section(RcParameters)) as hand:
            robot.arm()
            await asyncio.sleep(2.0)
            assert hand.state is RcState.DRIVES
            yield robot, pico, pico.radio, hand


def speed(pico: Pico) -> float:
    """The vehicle's true speed, m/s."""
    return pico.hal.vehicle.state.v  # type: ignore[attr-defined, no-any-return]


async def test_the_hand_takes_over_from_the_computer_and_the_host_finds_no_fault() -> None:
    async with radio() as (robot, pico, receiver, _):
        wanted = 0.5

        async def program(ticks: Ticks) -> None:
            async for _ in ticks:
                robot.command(wanted, 0.0)

        robot.add_task("program", 0.05, program)
        receiver.switch = "computer"
        await asyncio.sleep(0.5)
        wanted = 0.0
        await asyncio.sleep(0.2)
        wanted = 0.5
        await asyncio.sleep(3.0)
        assert robot.driver.name == "program" and speed(pico) == pytest.approx(0.5, abs=0.05)
        receiver.switch = "hand"
        await asyncio.sleep(3.0)
        assert robot.driver.name == "rc" and abs(speed(pico)) < 0.05
        receiver.throttle = -0.4
        await asyncio.sleep(3.0)
        assert speed(pico) == pytest.approx(-0.5, abs=0.05)
        receiver.throttle = 0.0
        await asyncio.sleep(3.0)
        assert robot.armed and not robot.trouble and abs(speed(pico)) < 0.05


async def test_a_stop_at_the_host_stops_the_hand_at_the_board() -> None:
    async with radio() as (robot, pico, receiver, _):
        receiver.throttle = 0.4
        await asyncio.sleep(3.0)
        assert speed(pico) > 0.4
        robot.stop()
        await asyncio.sleep(0.1)
        assert pico.state.outputs[0] == 0
        await asyncio.sleep(3.0)
        assert abs(speed(pico)) < 0.02 and not robot.trouble, "zeros were enough"
        receiver.switch = "computer"
        await asyncio.sleep(0.5)
        receiver.switch = "hand"
        await asyncio.sleep(1.0)
        assert abs(speed(pico)) < 0.02


async def test_a_lost_transmitter_stops_the_car_while_the_computer_drives() -> None:
    async with radio() as (robot, pico, receiver, hand):
        receiver.switch = "computer"
        await asyncio.sleep(0.5)
        drive = asyncio.ensure_future(robot.drive(0.5, 0.0, 20.0))
        await asyncio.sleep(3.0)
        assert speed(pico) > 0.4
        receiver.on = False
        await asyncio.sleep(0.4)
        assert pico.state.outputs[:3] == (0, 0, 0) and hand.state is RcState.LOST
        with pytest.raises(Exception, match="rc"):
            await drive
        await asyncio.sleep(2.0)
        assert abs(speed(pico)) < 0.02


async def test_the_hand_drives_on_when_the_host_dies() -> None:
    # it sees nothing any more, and says so
    with pytest.raises(StopNotVerified):
        async with radio() as (robot, pico, receiver, _):
            await _outlived(robot, pico, receiver)


@pytest.mark.parametrize("why", ["stopped", "disarmed", "its computer hung"])
async def test_a_stop_outlives_the_host_and_a_host_that_hung_does_not_bind_the_hand(why: str) -> None:
    with suppress(StopNotVerified):
        async with radio() as (robot, pico, receiver, _):
            gate = robot.runtime.gate
            if why == "stopped":
                robot.stop()
            elif why == "disarmed":
                robot.disarm("somebody works at the wheels")
            else:
                gate.disarm("30 missed cycles", Fault.MISSED)
            await asyncio.sleep(1.0)
            hal = robot.hal
            assert isinstance(hal, SerialHal)
            # nothing more goes to the board
            hal.line.link = None
            await asyncio.sleep(4.0)
            receiver.throttle = 0.4
            await asyncio.sleep(3.0)
            assert (speed(pico) > 0.4) is (why == "its computer hung")
            receiver.throttle = 0.0
            await asyncio.sleep(3.0)


async def _outlived(robot: Robot, pico: Pico, receiver: VirtualReceiver) -> None:
    receiver.throttle = 0.4
    await asyncio.sleep(2.0)
    hal = robot.hal
    assert isinstance(hal, SerialHal)
    # nothing more goes to the board
    hal.line.link = None
    await asyncio.sleep(3.0)
    assert not pico.state.link and speed(pico) > 0.4
    receiver.switch = "half way"
    await asyncio.sleep(3.0)
    assert abs(speed(pico)) < 0.02


@asynccontextmanager
async def servo_outputs() -> AsyncIterator[tuple[Robot, Pico, VirtualReceiver]]:
    """A host that is not armed, and a Pico whose receiver has three servo outputs."""
    config = load(None, ["hal=serial", "serial.port=pico", "rc.port=board", "rc.protocol=pwm", *ENDLESS]).config
    hal = create_serial(config)
    async with Robot.open(hal, config=config, arm=False) as robot:
        assert isinstance(hal, SerialHal) and isinstance(hal.port, ControllerPort)
        assert await robot.load_gains(timeout=60.0)
        pico = hal.port.device
        assert isinstance(pico, Pico) and pico.radio is not None
        yield robot, pico, pico.radio


async def test_the_dialogue_finds_the_pulses_of_servo_outputs_and_moves_nothing() -> None:
    async with servo_outputs() as (robot, pico, receiver):
        section, told = await found(receiver, "pwm", robot)
        assert pico.hal.vehicle.state.x == 0.0  # type: ignore[attr-defined]
    pico_settings = json.loads(told[-1].partition(": ")[2])["receiver"]
    assert pico_settings == {
        "protocol": "pwm",
        "pins": [20, 21, 22],
        "throttle": [1, 1000, 1500, 2000],
        "steering": [2, 1950, 1480, 1050],
        "switch": [3, 2000, 1000],
    }
    assert (section["port"], section["protocol"]) == ("board", "pwm")


async def test_the_dialogue_refuses_servo_outputs_that_hold_the_last_position() -> None:
    async with servo_outputs() as (robot, _, receiver):
        receiver.fails = "hold"
        with pytest.raises(HalError, match=r"goes on telling the last position .* \(2000 us of throttle\)"):
            await found(receiver, "pwm", robot)


async def test_a_layer_without_a_board_has_no_receiver() -> None:
    async with Robot.open(settings=ENDLESS) as robot:
        with pytest.raises(ConfigError, match=r"rc\.port: board: the hardware layer 'sim' has no receiver"):
            async with beside(robot, RcParameters(port="board")):
                pass
