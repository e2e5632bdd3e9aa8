"""The messages between computer and board (thesis 3.5), in SI units.

In simulation the objects themselves are passed on. The wire carries them as frames.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import Final

# s between two attempts to have the gains acknowledged
PID_SET_PERIOD: Final = 1.0


class Switch(IntEnum):
    """The power distribution board's switches."""

    ATX = 0x00
    ESC = 0x01


@dataclass(frozen=True, slots=True)
class Message:
    """A message on the wire: a frozen dataclass in this module, with its layout in `txt1.protocol.layout`."""


@dataclass(frozen=True, slots=True)
class HostMessage(Message):
    """A message from host to board."""


@dataclass(frozen=True, slots=True)
class BoardMessage(Message):
    """A message from board to host."""


@dataclass(frozen=True, slots=True)
class Velocity(HostMessage):
    """Set-point from the host: v in m/s, omega in rad/s."""

    v: float
    omega: float


@dataclass(frozen=True, slots=True)
class EncoderOdometry(BoardMessage):
    """The board's odometry: x, y in m, theta in rad (original boards count 0 .. 6.283), v in m/s, omega in rad/s."""

    x: float
    y: float
    theta: float
    v: float
    omega: float


@dataclass(frozen=True, slots=True)
class CombinedOdometry(HostMessage):
    """Odometry the host has fused from several sensors; only v (m/s) and omega (rad/s) are used."""

    x: float
    y: float
    theta: float
    v: float
    omega: float


@dataclass(frozen=True, slots=True)
class BatteryLevels(BoardMessage):
    """Voltages of the two packs, V."""

    battery1: float
    battery2: float


@dataclass(frozen=True, slots=True)
class PwmTest(HostMessage):
    """PWM counts for all five channels, whole on the wire; obeyed in manual mode only."""

    motor: float
    front: float
    rear: float
    pwm4: float
    pwm5: float


@dataclass(frozen=True, slots=True)
class PowerControl(HostMessage):
    """Switch the ATX supply or the ESC on or off."""

    switch: Switch
    on: bool


@dataclass(frozen=True, slots=True)
class PwmCommand(HostMessage):
    """PWM counts for the two free servos, whole on the wire; obeyed in every mode."""

    pwm4: float
    pwm5: float


@dataclass(frozen=True, slots=True)
class PidSet(HostMessage):
    """The gains: linear (kp, ki, kd) and up to 14 angular sets (v_max in m/s, kp, ki, kd), v_max rising."""

    linear: tuple[float, float, float]
    angular: tuple[tuple[float, float, float, float], ...]


@dataclass(frozen=True, slots=True)
class PidResponse(BoardMessage):
    """The board's answer to a PID set."""

    accepted: bool
