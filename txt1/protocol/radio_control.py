"""The messages about a radio control at the board, as a Pico has one; they are known to those who import them."""

from dataclasses import dataclass

from txt1.protocol.layout import COUNT, STATE, declare
from txt1.protocol.messages import BoardMessage, HostMessage


@dataclass(frozen=True, slots=True)
class RcReport(BoardMessage):
    """Who drives by a radio control at the board, and its sticks: a state, v in mm/s, omega in mrad/s, all whole.

    Then the last pulses of throttle, steering and switch, us; 0 without the transmitter.
    """

    state: float
    v: float
    omega: float
    throttle: float = 0
    steering: float = 0
    switch: float = 0


@dataclass(frozen=True, slots=True)
class RcPermit(HostMessage):
    """Whether the hand at a radio control at the board may drive; if not, whether somebody stopped or disarmed it.

    A stop binds the hand until a host permits it again, also when this host dies. Without a stop the host's death frees
    the hand, once its switch was seen at "hand" with the throttle at neutral.
    """

    on: bool
    stopped: bool = False


declare(RcReport, 0x71, "h", 6, COUNT)
declare(RcPermit, 0x72, "B", 2, STATE, make=lambda on, stopped: RcPermit(on == 1, stopped == 1))
