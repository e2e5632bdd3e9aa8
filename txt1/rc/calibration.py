"""The dialogue that finds a radio control's channels, and refuses a receiver that hides the loss of its transmitter.

It moves nothing: it listens to the receiver while a person moves the sticks.
"""

import asyncio
import json
from collections.abc import Awaitable, Callable
from dataclasses import asdict
from statistics import median
from typing import Any, Final

from txt1.errors import HalError
from txt1.link.base import Port
from txt1.rc.frames import CHANNELS, RcFrame
from txt1.rc.receiver_port import ReceiverLine
from txt1.rc.settings import APART, RcParameters, firmware_settings, take_over
from txt1.rc.take_over import ModeSwitch, RcState, Stick, TakeOver

# s for which the receiver is listened to after each answer
LISTENS: Final = 0.5
# s after which a receiver has to tell the loss, and s for which it then has to go on telling it
TELLS: Final = 1.5
STAYS: Final = 2.0
# s between two looks
LOOK: Final = 0.02

Ready = Callable[[str, str], Awaitable[None]]
"""Asks a person to do something (a key for programs, a text), and returns when it is done."""


class ReceiverListener:
    """Collects what a receiver tells."""

    def __init__(self, parameters: RcParameters, port: Port | None) -> None:
        self.line = ReceiverLine(parameters.protocol, parameters.port or "", self._take, port)
        self._protocol = parameters.protocol
        self._heard: list[tuple[int, ...]] = []
        self.rule: TakeOver | None = None
        """Also gets everything, once the channels are known."""

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
            raise HalError(
                f"no frame of {self._protocol} comes{self.line.problem and f' ({self.line.problem})'}: is "
                "the transmitter on and bound, is the wire at RX, and is it the right rc.protocol (sbus, crsf)?"
            )
        return tuple(float(median(each)) for each in zip(*self._heard, strict=True))


def moved(before: tuple[float, ...], after: tuple[float, ...], what: str, but: tuple[int, ...] = ()) -> int:
    """Return the index of the channel that moved; raises HalError if none or several did. `but`: known channels."""
    ways = [abs(a - b) for a, b in zip(after, before, strict=True)]
    found = [k for k in range(CHANNELS) if ways[k] >= APART and k not in but]
    if len(found) != 1:
        told = f"the channels {', '.join(str(k + 1) for k in found)} did" if found else "none did"
        raise HalError(
            f"{what}: one channel has to move by {APART:g} us, but {told}; begin again, and move nothing else"
        )
    return found[0]


async def calibrate(
    parameters: RcParameters, ready: Ready, tell: Callable[[str], None], port: Port | None = None
) -> dict[str, Any]:
    """Ask a person to move each stick and the switch, and to switch the transmitter off; return the section `rc`.

    Raises HalError: the receiver cannot be heard, or goes on telling positions without its transmitter.
    """
    listener = ReceiverListener(parameters, port)
    await listener.line.open()
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
        tell(f"the same for settings.json of a Pico: {json.dumps({'receiver': pico})}")
        await ready("on", "Let go, and switch the transmitter on again.")
        await listener.pulses()
        return {name: value for name, value in asdict(found).items() if value is not None}
    finally:
        await listener.line.close()


async def _tells_its_loss(listener: ReceiverListener, rule: TakeOver, throttle: Stick) -> None:
    """Raise HalError unless the receiver tells the loss soon, and goes on telling it."""
    loop = asyncio.get_running_loop()
    await asyncio.sleep(TELLS)
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
        await asyncio.sleep(LOOK)
