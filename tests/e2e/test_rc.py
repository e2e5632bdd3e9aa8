"""A radio control at a robot: it takes over, gives back, and its loss is a stop whoever drives."""

from __future__ import annotations

import asyncio
import json
import os
import pty
import struct
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from fcntl import ioctl

import pytest

from tests.e2e.conftest import ENDLESS
from txt1.config import load
from txt1.errors import ConfigError, HalError
from txt1.hal.base import Button
from txt1.kernel.ticks import Ticks
from txt1.link.device import DevicePort
from txt1.link.virtual_device import VirtualDevice
from txt1.rc import calibration
from txt1.rc.robot_end import RcHand, beside
from txt1.rc.settings import PROTOCOLS, RcParameters
from txt1.rc.take_over import RcState
from txt1.rc.virtual_receiver import STEERING, SWITCH, THROTTLE, Fails, VirtualReceiver
from txt1.robot import Robot

SETTINGS = {name: RcParameters(name, "x", None, THROTTLE, STEERING, SWITCH) for name in PROTOCOLS}  # type: ignore[arg-type]
FAILS = [("sbus", "silent"), ("sbus", "flagged"), ("crsf", "silent"), ("crsf", "statistics"), ("crsf", "out of range")]
# s from the loss of the transmitter to the set-point 0: the silence, a tick here and one of the controller
STOPS = 0.25 + 0.06


@asynccontextmanager
async def radio(
    protocol: str = "crsf", fails: Fails = "silent", *settings: str
) -> AsyncIterator[tuple[Robot, VirtualReceiver, RcHand]]:
    """An armed robot with a radio control, whose hand has the wheel."""
    receiver = VirtualReceiver(protocol, fails)
    config = load(None, [*ENDLESS, *settings]).config
    async with Robot.open(config=config) as robot, beside(robot, SETTINGS[protocol], receiver) as hand:
        await asyncio.sleep(0.3)
        assert hand.state is RcState.DRIVES
        yield robot, receiver, hand


def setpoint(robot: Robot) -> float:
    return robot.runtime.state.control.v


@pytest.mark.parametrize("protocol", PROTOCOLS)
async def test_the_sticks_drive_by_the_cars_hand_rule(protocol: str) -> None:
    async with radio(protocol) as (robot, receiver, _):
        receiver.throttle, receiver.steering = 0.55, 1.0
        await asyncio.sleep(0.2)
        v, omega = robot.config.hand().velocity(1.5, 0.5, 1.0)
        control = robot.runtime.state.control
        assert (control.v, control.omega) == (pytest.approx(v, abs=0.01), pytest.approx(omega, abs=0.02))
        receiver.throttle = -0.55
        await asyncio.sleep(0.2)
        control = robot.runtime.state.control
        assert control.v < 0.0 and control.omega < 0.0, "its front wheels still point to the left"
        receiver.throttle = receiver.steering = 0.0
        await asyncio.sleep(0.2)
        assert setpoint(robot) == 0.0 and robot.driver.name == "rc"


class Other:
    """A source that commands 0.5 m/s all the time, unless it lets go."""

    def __init__(self, robot: Robot, name: str) -> None:
        self.v, self.source = 0.5, robot.source(name)

        async def task(ticks: Ticks) -> None:
            async for _ in ticks:
                self.source.command(self.v, 0.0)

        robot.add_task(name, 0.05, task)

    async def asks_anew(self) -> None:
        """Command zero once, then drive."""
        self.v = 0.0
        await asyncio.sleep(0.1)
        self.v = 0.5
        await asyncio.sleep(0.3)


@pytest.mark.parametrize("name", ["keys", "gamepad", "web", "ros", "mine"])
async def test_the_switch_takes_the_wheel_and_a_fresh_command_gets_it_back(name: str) -> None:
    async with radio() as (robot, receiver, _):
        receiver.switch = "computer"
        await asyncio.sleep(0.1)
        other = Other(robot, name)
        await asyncio.sleep(0.5)
        assert robot.driver.name == name and setpoint(robot) == 0.5
        for position in ("hand", "half way"):
            receiver.switch = position
            await asyncio.sleep(0.2)
            assert robot.driver.name == "rc" and setpoint(robot) == 0.0 and robot.armed
            receiver.switch = "computer"
            await asyncio.sleep(1.0)
            assert setpoint(robot) == 0.0, "it goes on commanding what it commanded before"
            await other.asks_anew()
            assert robot.driver.name == name and setpoint(robot) == 0.5


async def test_half_way_the_sticks_do_nothing() -> None:
    async with radio() as (robot, receiver, _):
        receiver.throttle, receiver.switch = 1.0, "half way"
        await asyncio.sleep(1.0)
        assert setpoint(robot) == 0.0 and robot.driver.name == "rc"
        receiver.switch = "hand"
        await asyncio.sleep(0.2)
        assert setpoint(robot) == 1.5


@pytest.mark.parametrize(("protocol", "fails"), FAILS)
@pytest.mark.parametrize("switch", ["hand", "half way", "computer"])
async def test_a_loss_stops_in_every_position_of_the_switch(protocol: str, fails: Fails, switch: str) -> None:
    async with radio(protocol, fails) as (robot, receiver, hand):
        receiver.switch = switch
        await asyncio.sleep(0.1)
        other = Other(robot, "ros")
        receiver.throttle = 1.0
        await asyncio.sleep(1.0)
        assert setpoint(robot) == {"hand": 1.5, "half way": 0.0, "computer": 0.5}[switch]
        receiver.on = False
        await asyncio.sleep(STOPS + (0.1 if fails == "statistics" else 0.0))
        assert hand.state is RcState.LOST and setpoint(robot) == 0.0
        await asyncio.sleep(2.0)
        await other.asks_anew()
        assert setpoint(robot) == 0.0
        receiver.on = True
        await asyncio.sleep(1.0)
        await other.asks_anew()
        assert hand.state is RcState.WAITING and setpoint(robot) == 0.0
        receiver.throttle, receiver.switch = 0.0, "hand"
        await asyncio.sleep(0.1)
        receiver.throttle = 1.0
        await asyncio.sleep(0.2)
        assert setpoint(robot) == 1.5


async def test_a_receiver_that_is_unplugged_stops_the_robot_and_is_found_again() -> None:
    async with radio() as (robot, receiver, hand):
        receiver.throttle = 1.0
        await asyncio.sleep(0.5)
        receiver.unplug()
        await asyncio.sleep(STOPS)
        assert hand.state is RcState.LOST and setpoint(robot) == 0.0
        assert "not plugged in" in " ".join(robot.runtime.state.warned()) or "closed" in hand.warning()
        receiver.plugged = True
        await asyncio.sleep(2.0)
        assert hand.state is RcState.WAITING
        receiver.throttle = 0.0
        await asyncio.sleep(0.2)
        assert hand.state is RcState.DRIVES


async def test_a_stop_of_anyone_binds_it_and_taking_over_clears_none() -> None:
    async with radio() as (robot, receiver, _):
        receiver.throttle = 1.0
        await asyncio.sleep(0.5)
        robot.stop()
        for position in ("computer", "hand", "half way", "hand"):
            receiver.switch = position
            await asyncio.sleep(0.5)
            assert not robot.armed and setpoint(robot) == 0.0
        await asyncio.sleep(3.0)
        robot.arm()
        await asyncio.sleep(0.5)
        assert setpoint(robot) == 0.0, "the stick was held while it was armed: it has to let go first"
        receiver.throttle = 0.0
        await asyncio.sleep(0.1)
        receiver.throttle = 1.0
        await asyncio.sleep(0.2)
        assert setpoint(robot) == 1.5


async def test_nothing_drives_before_the_transmitter_was_heard() -> None:
    receiver = VirtualReceiver("crsf")
    receiver.on = False
    async with Robot.open(settings=ENDLESS) as robot, beside(robot, SETTINGS["crsf"], receiver):
        other = Other(robot, "ros")
        await asyncio.sleep(1.0)
        await other.asks_anew()
        assert setpoint(robot) == 0.0 and robot.driver.name == "rc"


@pytest.mark.parametrize("switch", ["hand", "half way"])
async def test_counts_by_hand_end_where_the_computer_may_not_drive(switch: str) -> None:
    async with radio() as (robot, receiver, _):
        receiver.switch = "computer"
        await asyncio.sleep(0.1)
        robot.press(Button.CENTRE)
        await asyncio.sleep(0.3)
        robot.pwm_test(3000, 0, 0)
        await asyncio.sleep(0.1)
        assert robot.armed and robot.runtime.state.control.outputs.motor == 3000
        receiver.switch = switch
        await asyncio.sleep(0.1)
        assert not robot.armed and robot.runtime.state.control.outputs.motor == 0


async def test_no_source_may_have_priority_over_the_hand() -> None:
    with pytest.raises(ConfigError, match=r"commander.priorities.web: 70 is not below the radio control's 60"):
        async with radio("crsf", "silent", "commander.priorities={web: 70}"):
            pass
    with pytest.raises(ConfigError, match=r"commander.priorities.rc: 50 is not above the keys' 50"):
        async with radio("crsf", "silent", "commander.priorities={rc: 50}"):
            pass
    async with radio() as (robot, receiver, _):
        program = robot.source("above", priority=99)
        receiver.throttle = 1.0
        await asyncio.sleep(0.2)
        program.command(0.5, 0.0)
        await asyncio.sleep(0.1)
        assert not robot.armed and "another source has priority over the hand" in robot.reason


async def test_the_transmitter_is_told_battery_and_mode() -> None:
    async with radio() as (robot, receiver, _):
        await asyncio.sleep(1.0)
        assert b"HAND\0" in receiver.got
        receiver.switch = "computer"
        await asyncio.sleep(1.0)
        assert b"COMPUTER\0" in receiver.got
        robot.stop()
        await asyncio.sleep(1.0)
        assert b"DISARMED\0" in receiver.got
        volts = robot.battery.battery1
        assert volts is not None and bytes((0xC8, 10, 8, 0, round(10 * volts))) in receiver.got


# -- the dialogue -------------------------------------------------------------------------------------------------


async def found(
    receiver: VirtualReceiver, protocol: str = "crsf", robot: Robot | None = None
) -> tuple[dict[str, object], list[str]]:
    """The section that the dialogue finds with a person at this transmitter, and what it told."""
    moves = {
        "rest": {"throttle": 0.0, "steering": 0.0, "switch": "hand", "on": True},
        "throttle most": {"throttle": 1.0},
        "throttle least": {"throttle": -1.0},
        "steering most": {"throttle": 0.0, "steering": 1.0},
        "steering least": {"steering": -1.0},
        "computer": {"steering": 0.0, "switch": "computer"},
        "off": {"throttle": 1.0},
        "on": {"on": True, "throttle": 0.0},
    }

    async def ready(key: str, text: str) -> None:
        for name, value in moves[key].items():
            setattr(receiver, name, value)
        if key == "off":
            # it is held, then the power goes
            await asyncio.sleep(0.5)
            receiver.on = False

    told: list[str] = []
    given = RcParameters(protocol, "x" if robot is None else "board")  # type: ignore[arg-type]
    section = await calibration.calibrate(given, ready, told.append, receiver, robot)
    return section, told


@pytest.mark.parametrize(("protocol", "fails"), FAILS)
async def test_the_dialogue_finds_the_channels(protocol: str, fails: Fails) -> None:
    section, told = await found(VirtualReceiver(protocol, fails), protocol)
    assert told[-2] == "the receiver tells the loss of its transmitter"
    pico = json.loads(told[-1].partition(": ")[2])["receiver"]
    assert (pico["protocol"], pico["switch"]) == (protocol, [SWITCH.channel, 2000, 1000])
    for name, stick in (("throttle", THROTTLE), ("steering", STEERING)):
        given = section[name]
        assert isinstance(given, dict) and given["channel"] == stick.channel
        assert [given[end] for end in ("least", "middle", "most")] == pytest.approx(
            [stick.least, stick.middle, stick.most], abs=1.5
        )
    settings = [f"rc.{key}={value}" for key, value in section.items()]
    read = load(None, settings).config.section(RcParameters)
    assert read.switch is not None and (read.switch.channel, read.protocol) == (SWITCH.channel, protocol)


@pytest.mark.parametrize("protocol", PROTOCOLS)
async def test_the_dialogue_refuses_a_receiver_that_goes_on_telling_the_last_position(protocol: str) -> None:
    with pytest.raises(HalError, match=r"goes on telling the last position .* \(2000 us of throttle\)"):
        await found(VirtualReceiver(protocol, "hold"), protocol)


async def test_the_dialogue_refuses_what_it_does_not_hear() -> None:
    receiver = VirtualReceiver("sbus")
    with pytest.raises(HalError, match=r"no frame of crsf comes.* is it the right rc.protocol"):
        await found(receiver, "crsf")


# -- the line -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("protocol", PROTOCOLS)
async def test_a_port_gets_the_protocols_rate_from_the_kernel(protocol: str) -> None:
    ours, theirs = pty.openpty()
    try:
        # a pseudo-terminal has no parity
        rate = PROTOCOLS[protocol].baud
        port = DevicePort(os.ttyname(theirs), rate)
        link = await port.open(VirtualDevice())
        # TCGETS2 of Linux: four words of flags, a byte and 19 characters, then both speeds
        told = ioctl(theirs, 0x802C542A, bytes(44))
        assert struct.unpack("=4IB19s2I", told)[-2:] == (rate, rate)
        link.close()
    finally:
        os.close(ours)
        os.close(theirs)
