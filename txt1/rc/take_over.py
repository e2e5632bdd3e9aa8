"""The rule by which the hand at a radio control takes over from the computer, and gives back.

How it works
------------

A switch of the transmitter says who drives. In its position "hand" the sticks drive. In its position "computer" all
other sources may, by the ordinary rules. Half way is "hand" at zero: it stops the car, and the sticks do nothing.

A receiver without its transmitter has no hand behind it, whatever the switch was. So nobody drives then, the computer
neither. The link is *lost* when the receiver says so, or when no frame that counts has come for FRAME_SILENCE. A frame
with a pulse that no calibrated stick makes does not count: many receivers tell the loss by such a pulse.

At power-up and after each loss the robot *waits*: nothing moves until the switch is at "hand" with the throttle at
neutral. So neither a stick that was held, nor a program that went on commanding, drives off when the link is back.

The Pico's firmware has the same rule in whole numbers (`firmware/pico/txt1pico/radio.py`). Nothing here knows a
clock: all times are s of the same clock.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from math import inf
from typing import Annotated, Final, NamedTuple

from annotated_types import Ge, Le

from txt1.control.hand import shaped

# s without a frame that counts after which the link is lost
FRAME_SILENCE: Final = 0.25
# us by which a pulse may lie outside the calibrated range of its stick or switch
PULSE_MARGIN: Final = 100.0
# share of the way between the switch's positions that belongs to each of them
AT: Final = 0.25

Channel = Annotated[int, Ge(0), Le(16)]
Pulse = Annotated[float, Ge(500.0), Le(2500.0)]


class RcState(StrEnum):
    """Who drives, by the radio control."""

    LOST = "lost"
    """Nobody: the transmitter is not heard."""
    WAITING = "waiting"
    """Nobody: the switch was not seen at "hand" with the throttle at neutral since the transmitter is heard."""
    DRIVES = "hand"
    """The sticks."""
    HALF_WAY = "half way"
    """The hand, at zero."""
    COMPUTER = "computer"
    """Any other source."""


@dataclass(frozen=True, slots=True)
class Stick:
    """A stick's channel and its pulses, us: held to one end (back, right), let go, held to the other (ahead, left)."""

    channel: Channel = 0
    """1 to 16; 0: nobody has told it."""
    least: Pulse = 1000.0
    middle: Pulse = 1500.0
    most: Pulse = 2000.0

    def place(self, pulse: float) -> float | None:
        """Return where the stick is, -1 to 1, without its dead middle; None if it cannot be there."""
        if not min(self.least, self.most) - PULSE_MARGIN <= pulse <= max(self.least, self.most) + PULSE_MARGIN:
            return None
        forward = (pulse - self.middle) * (self.most - self.middle) > 0.0
        way = self.most - self.middle if forward else self.middle - self.least
        return shaped((pulse - self.middle) / way)


@dataclass(frozen=True, slots=True)
class ModeSwitch:
    """The switch's channel and its pulses, us, at "hand" and at "computer"."""

    channel: Channel = 0
    """1 to 16; 0: nobody has told it."""
    hand: Pulse = 1000.0
    computer: Pulse = 2000.0

    def position(self, pulse: float) -> RcState | None:
        """Return the switch's position; None if it cannot be there."""
        if not min(self.hand, self.computer) - PULSE_MARGIN <= pulse <= max(self.hand, self.computer) + PULSE_MARGIN:
            return None
        share = (pulse - self.hand) / (self.computer - self.hand)
        if share < AT:
            return RcState.DRIVES
        return RcState.COMPUTER if share > 1.0 - AT else RcState.HALF_WAY


class RcWish(NamedTuple):
    """Who drives, and the axes for the hand rule (`txt1.control.hand`) while the sticks do."""

    state: RcState
    ahead: float = 0.0
    left: float = 0.0


class TakeOver:
    """The rule, for a throttle, a steering and a switch."""

    def __init__(self, throttle: Stick, steering: Stick, switch: ModeSwitch) -> None:
        self._throttle, self._steering, self._switch = throttle, steering, switch
        self._heard = -inf
        self._lost, self._waiting = False, True
        # the throttle has to be seen at neutral before it drives
        self._let_go = True
        self._wish = RcWish(RcState.LOST)

    def take(self, pulses: Sequence[float] | None, lost: bool | None, now: float) -> None:
        """Take what a frame told (`txt1.rc.frames.RcFrame`) at `now`."""
        if lost is not None:
            self._lost = lost
            # a loss counts, even if nobody looks before the next frame
            self.look(now)
        if pulses is None:
            return
        position = self._switch.position(pulses[self._switch.channel - 1])
        ahead = self._throttle.place(pulses[self._throttle.channel - 1])
        left = self._steering.place(pulses[self._steering.channel - 1])
        if position is None or ahead is None or left is None:
            return
        # the silence before this frame counts, too, if nobody looked meanwhile
        self.look(now)
        self._heard = now
        if self._lost:
            return
        if ahead == 0.0:
            self._let_go = False
            if position is RcState.DRIVES:
                self._waiting = False
        if self._waiting:
            self._wish = RcWish(RcState.WAITING)
        elif position is RcState.DRIVES and not self._let_go:
            self._wish = RcWish(position, ahead, left)
        else:
            self._wish = RcWish(position)

    def let_go(self) -> None:
        """Let the throttle drive only once it was seen at neutral."""
        self._let_go = True
        if self._wish.state is RcState.DRIVES:
            self._wish = RcWish(RcState.DRIVES)

    def look(self, now: float) -> RcWish:
        """Return who drives at `now`."""
        if self._lost or now - self._heard > FRAME_SILENCE:
            self._waiting = self._let_go = True
            self._wish = RcWish(RcState.LOST)
        return self._wish
