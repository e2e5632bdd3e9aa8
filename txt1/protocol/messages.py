"""The messages between computer and board (thesis 3.5), in SI units.

On the desk they are handed over as they are; the wire carries them as frames.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any, TypeVar


class Switch(IntEnum):
    """The power distribution board's switches."""

    ATX = 0x00
    ESC = 0x01


@dataclass(frozen=True, slots=True)
class Velocity:
    """Set-point from the host: v in m/s, omega in rad/s."""

    v: float
    omega: float


@dataclass(frozen=True, slots=True)
class EncoderOdometry:
    """The board's odometry: x, y in m, theta in rad, v in m/s, omega in rad/s.

    Off the wire, theta is what the board sent: original boards count 0 .. 6.283, and whoever uses it wraps it.
    """

    x: float
    y: float
    theta: float
    v: float
    omega: float


@dataclass(frozen=True, slots=True)
class CombinedOdometry:
    """Odometry the host has fused from several sensors; only v (m/s) and omega (rad/s) are used."""

    x: float
    y: float
    theta: float
    v: float
    omega: float


@dataclass(frozen=True, slots=True)
class BatteryLevels:
    """Voltages of the two packs, V."""

    battery1: float
    battery2: float


@dataclass(frozen=True, slots=True)
class PwmTest:
    """PWM counts for all five channels, whole on the wire; obeyed in manual mode only."""

    motor: float
    front: float
    rear: float
    pwm4: float
    pwm5: float


@dataclass(frozen=True, slots=True)
class PowerControl:
    """Switch the ATX supply or the ESC on or off."""

    switch: Switch
    on: bool


@dataclass(frozen=True, slots=True)
class PwmCommand:
    """PWM counts for the two free servos, whole on the wire; obeyed in every mode."""

    pwm4: float
    pwm5: float


@dataclass(frozen=True, slots=True)
class PidSet:
    """The gains: linear (kp, ki, kd) and up to 14 angular sets (v_max in m/s, kp, ki, kd), v_max rising."""

    linear: tuple[float, float, float]
    angular: tuple[tuple[float, float, float, float], ...]


@dataclass(frozen=True, slots=True)
class PidResponse:
    """The board's answer to a PID set."""

    accepted: bool


OdometryMessage = TypeVar("OdometryMessage", bound=EncoderOdometry | CombinedOdometry)


class _OpenOdometry:
    """The slots of an odometry message, open for writing."""

    __slots__ = ("omega", "theta", "v", "x", "y")


def odometry_message(
    kind: type[OdometryMessage], x: float, y: float, theta: float, v: float, omega: float
) -> OdometryMessage:
    """An odometry message, made in a third of the time that its class takes, as most of what the line carries is such.

    Filling in a frozen dataclass takes longer than checking its frame. So the fields go into a writable object with
    the same slots, which then becomes the message.
    """
    message: Any = _OpenOdometry()
    message.x = x
    message.y = y
    message.theta = theta
    message.v = v
    message.omega = omega
    message.__class__ = kind
    return message  # type: ignore[no-any-return]


class _OpenVelocity:
    """Likewise of a set-point."""

    __slots__ = ("omega", "v")


def velocity_message(v: float, omega: float) -> Velocity:
    """A set-point, made as quickly: hosts send one 20 times a second."""
    message: Any = _OpenVelocity()
    message.v = v
    message.omega = omega
    message.__class__ = Velocity
    return message  # type: ignore[no-any-return]


HostMessage = Velocity | CombinedOdometry | PwmTest | PowerControl | PwmCommand | PidSet
"""What a host sends to a board."""

BoardMessage = EncoderOdometry | BatteryLevels | PidResponse
"""What a board sends to its host."""

Message = HostMessage | BoardMessage
"""What goes over the wire, either way."""
