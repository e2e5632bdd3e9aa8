"""The messages about a radio control at the board, as a Pico has one; they are known to those who import them."""

from dataclasses import dataclass

from txt1.protocol.layout import COUNT, STATE, declare
from txt1.protocol.messages import BoardMessage, HostMessage


@dataclass(frozen=True, slots=True)
class RcReport(BoardMessage):
    """Who drives by a radio control at the board, and its sticks: a state, v in mm/s, omega in mrad/s, all whole."""

    state: float
    v: float
    omega: float


@dataclass(frozen=True, slots=True)
class RcPermit(HostMessage):
    """Whether the hand at a radio control at the board may drive; it stays when the host dies."""

    on: bool


declare(RcReport, 0x71, "h", 3, COUNT)
declare(RcPermit, 0x72, "B", 1, STATE, make=lambda on: RcPermit(on == 1))
