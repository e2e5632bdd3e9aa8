"""The dialogue that finds a radio control's channels, and refuses a receiver that hides the loss of its transmitter.

It moves nothing: it listens to the receiver while a person moves the sticks.
"""

import asyncio
import json
from abc import ABC, abstractmethod
from collections.abc import Awaitable, Callable
from dataclasses import asdict
from statistics import median
from typing import Any, Final

from txt1.errors import ConfigError, HalError
from txt1.hal.serial import SerialHal
from txt1.link.base import Port
from txt1.rc.frames import RcFrame
from txt1.rc.receiver_port import ReceiverLine
from txt1.rc.settings import POSITIONS_APART, RcParameters, firmware_settings, take_over
from txt1.rc.take_over import ModeSwitch, RcState, Stick, TakeOver
from txt1.robot import Robot

# s for which the receiver is listened to after each answer
LISTENS: Final = 0.5
# s after which a receiver has to tell the loss, and s for which it then has to go on telling it
LOSS_TELL_TIME: Final = 1.5
STAYS: Final = 2.0
# s between two looks
STICK_CHECK_PERIOD: Final = 0.02

Ready = Callable[[str, str], Awaitable[None]]
"""Asks a person to do something (a key for programs, a text), and returns when it is done."""


class ChannelListener(ABC):
    """Collects what a receiver tells."""

    def __init__(self) -> None:
        self.rule: TakeOver | None = None
        """Also gets everything, once the channels are known."""
        self._heard: list[tuple[int, ...]] = []

    @abstractmethod
    async def open(self) -> None:
        """Begin to listen; raises HalError."""

    @abstractmethod
    async def close(self) -> None:
        """End it."""

    @abstractmethod
    def silence(self) -> str:
        """Return why nothing comes, and what to look at."""

    def _take(self, heard: RcFrame, now: float) -> None:
        if heard.pulses is not None:
            self._heard.append(heard.pulses)
        if self.rule is not None:
            self.rule.take(heard.pulses, heard.lost, now)

    async def pulses(self) -> tuple[float, ...]:
        """Return the median of each channel within the next `LISTENS` s, us; raises HalError if nothing comes."""
        self._heard.clear()
        await asyncio.sleep(LISTENS)
        if not self._heard:
            raise HalError(self.silence())
        return tuple(float(median(each)) for each in zip(*self._heard, strict=True))


class ReceiverListener(ChannelListener):
    """Listens to a receiver at this computer."""

    def __init__(self, parameters: RcParameters, port: Port | None) -> None:
        super().__init__()
        self._line = ReceiverLine(parameters.protocol, parameters.port or "", self._take, port)
        self._protocol = parameters.protocol

    async def open(self) -> None:
        """Open the port."""
        await self._line.open()

    async def close(self) -> None:
        """Close it."""
        await self._line.close()

    def silence(self) -> str:
        """Return what to look at."""
        return (
            f"no frame of {self._protocol} comes{self._line.problem and f' ({self._line.problem})'}: is "
            "the transmitter on and bound, is the wire at RX, and is it the right rc.protocol (sbus, crsf)?"
        )


class BoardListener(ChannelListener):
    """Listens to the three servo outputs of a receiver at a board, whose hand may not drive meanwhile."""

    def __init__(self, robot: Robot) -> None:
        super().__init__()
        if not isinstance(robot.hal, SerialHal):
            raise ConfigError(f"--rc board: the hardware layer '{robot.hal.name}' has no receiver; choose --hal serial")
        self._hal = robot.hal
        self._listening: asyncio.Task[None] | None = None

    async def open(self) -> None:
        """Forbid the hand, and begin to listen."""
        self._listening = asyncio.create_task(self._listen())

    async def close(self) -> None:
        """End it. The board frees the hand a second after this host, as nobody has stopped it."""
        if self._listening is not None:
            self._listening.cancel()
            self._listening = None

    def silence(self) -> str:
        """Return what to look at."""
        if self._hal.rc is None:
            return 'the board tells of no receiver: put `"receiver": {"protocol": "pwm", ...}` into its settings.json'
        return "no pulses come: is the transmitter on and bound, and are all three servo outputs wired to the pins?"

    async def _listen(self) -> None:
        last = None
        while True:
            self._hal.permit_hand(False, False)
            told = self._hal.rc
            if told is not None and told is not last:
                last, (report, arrived) = told, told
                pulses = int(report.throttle), int(report.steering), int(report.switch)
                if all(pulses):
                    self._take(RcFrame(pulses), arrived)
            await asyncio.sleep(STICK_CHECK_PERIOD)


def moved(before: tuple[float, ...], after: tuple[float, ...], what: str, but: tuple[int, ...] = ()) -> int:
    """Return the index of the channel that moved; raises HalError if none or several did. `but`: known channels."""
    ways = [abs(a - b) for a, b in zip(after, before, strict=True)]
    found = [k for k in range(len(before)) if ways[k] >= POSITIONS_APART and k not in but]
    if len(found) != 1:
        told = f"the channels {', '.join(str(k + 1) for k in found)} did" if found else "none did"
        raise HalError(
            f"{what}: one channel has to move by {POSITIONS_APART:g} us, but {told}; begin again, and move nothing else"
        )
    return found[0]


async def calibrate(
    parameters: RcParameters,
    ready: Ready,
    tell: Callable[[str], None],
    port: Port | None = None,
    robot: Robot | None = None,
) -> dict[str, Any]:
    """Ask a person to move each stick and the switch, and to switch the transmitter off; return the section `rc`.

    `robot` has the board of a receiver whose port is board; it is not armed.

    Raises HalError: the receiver cannot be heard, or goes on telling positions without its transmitter.
    """
    listener: ChannelListener = ReceiverListener(parameters, port) if robot is None else BoardListener(robot)
    await listener.open()
    try:
        await ready("rest", "Switch the transmitter on, let go of its sticks, and put its switch to hand.")
        rest = await listener.pulses()
        sticks = {}
        taken: tuple[int, ...] = ()
        for name, most, least in (("throttle", "full ahead", "full back"), ("steering", "full left", "full right")):
            await ready(f"{name} most", f"Hold the {name} {most}.")
            at_most = await listener.pulses()
            channel = moved(rest, at_most, name, taken)
            await ready(f"{name} least", f"Hold the {name} {least}.")
            at_least = await listener.pulses()
            if moved(rest, at_least, name, taken) != channel:
                raise HalError(f"{name}: its two ends are on two channels; a stick with one channel is needed")
            sticks[name] = Stick(channel + 1, at_least[channel], rest[channel], at_most[channel])
            taken = (*taken, channel)
            tell(f"{name}: channel {channel + 1}, {at_least[channel]:g} {rest[channel]:g} {at_most[channel]:g} us")
        await ready("computer", "Let go of the sticks, and put the switch to computer.")
        at_computer = await listener.pulses()
        channel = moved(rest, at_computer, "switch", taken)
        switch = ModeSwitch(channel + 1, rest[channel], at_computer[channel])
        tell(f"switch: channel {channel + 1}, {rest[channel]:g} us at hand, {at_computer[channel]:g} us at computer")
        found = RcParameters(
            parameters.protocol, parameters.port, parameters.speed, sticks["throttle"], sticks["steering"], switch
        )
        listener.rule = take_over(found)
        await ready("off", "Hold the throttle full ahead, switch the transmitter off, and go on holding.")
        await _tells_its_loss(listener, listener.rule, sticks["throttle"])
        tell("the receiver tells the loss of its transmitter")
        pico = firmware_settings(found.throttle, found.steering, found.switch, found.protocol)
        told = "the same for settings.json of a Pico"
        if robot is not None:
            told = "for settings.json of the Pico, if the receiver has the pins 20, 21, 22 there now"
        tell(f"{told}: {json.dumps({'receiver': pico})}")
        await ready("on", "Let go, and switch the transmitter on again.")
        await listener.pulses()
        return {name: value for name, value in asdict(found).items() if value is not None}
    finally:
        await listener.close()


async def _tells_its_loss(listener: ChannelListener, rule: TakeOver, throttle: Stick) -> None:
    """Raise HalError unless the receiver tells the loss soon, and goes on telling it."""
    loop = asyncio.get_running_loop()
    await asyncio.sleep(LOSS_TELL_TIME)
    ends = loop.time() + STAYS
    while loop.time() < ends:
        if rule.look(loop.time()).state is not RcState.LOST:
            pulse = (await listener.pulses())[throttle.channel - 1]
            position = throttle.place(pulse)
            told = "the last position" if position is not None and position > 0.5 else "a position"
            raise HalError(
                f"the receiver goes on telling {told} without its transmitter ({pulse:g} us of throttle): nothing "
                "would stop the car. Set the receiver's failsafe to no pulses (no output), then calibrate again; a "
                "receiver that cannot do this must not be used"
            )
        await asyncio.sleep(STICK_CHECK_PERIOD)
