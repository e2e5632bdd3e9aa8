"""What each message's data looks like on the wire (thesis 3.5): one table that both encoding and decoding read.

All fields of a message are integers of one kind, big-endian and two's complement: `code` is their letter in `struct`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from enum import Enum
from functools import partial
from operator import index
from struct import Struct
from typing import Any, Final

from txt1.errors import EncodeError
from txt1.protocol.messages import (
    BatteryLevels,
    CombinedOdometry,
    EncoderOdometry,
    Message,
    PidResponse,
    PidSet,
    PowerControl,
    PwmCommand,
    PwmTest,
    Switch,
    Velocity,
)
from txt1.units import from_thousandths, to_thousandths

SETS_MAX: Final = 14
"""Angular gain sets that a PID set has room for."""

ACCEPTED: Final = 0x3C
REJECTED: Final = 0x55


class Role(Enum):
    """An end of the line, named as the one that receives."""

    HOST = "host"
    BOARD = "board"


class BadValue(ValueError):
    """An integer of an intact frame stands for nothing: such as switch 7."""


Reader = Callable[[bytes, int], Message]
"""The message from a buffer and its data's place in it; BadValue when one of its integers stands for nothing."""


@dataclass(frozen=True, slots=True)
class Layout:
    """One message's command and data."""

    message: type[Message]
    command: int
    receiver: Role
    code: str
    """The letter in `struct` of every integer of the data."""
    counts: Sequence[int]
    """How many integers there may be."""
    to_wire: Callable[[Any], int]
    """A field's value as an integer; a ValueError or TypeError says that there is none."""
    reader: Callable[[Struct], Reader]
    """What reads the message from data of this shape."""

    def struct(self, count: int) -> Struct:
        """The data with `count` integers."""
        return Struct(f">{count}{self.code}")

    @property
    def limits(self) -> tuple[int, int]:
        """The smallest and the largest integer that an integer of the data can be."""
        bits = 8 * Struct(f">{self.code}").size
        return (-(1 << bits - 1), (1 << bits - 1) - 1) if self.code.islower() else (0, (1 << bits) - 1)


def pack(layout: Layout, message: Message) -> bytes:
    """The data of a message's frame.

    Raises:
        EncodeError: a value is not finite, is no whole number where one is asked for, or does not fit its field; or
            a PID set has more than 14 angular sets or one that is not four numbers.

    """
    low, high = layout.limits
    integers = []
    for name, value in _named_values(message):
        try:
            integer = layout.to_wire(value)
        except (ValueError, TypeError, AttributeError):
            raise EncodeError(layout.message.__name__, name, value, _takes(layout)) from None
        if not low <= integer <= high:
            raise EncodeError(layout.message.__name__, name, value, _takes(layout))
        integers.append(integer)
    return layout.struct(len(integers)).pack(*integers)


def _named_values(message: Message) -> Iterator[tuple[str, Any]]:
    """Every value of a message in the order of the wire, with the name of its field."""
    if not isinstance(message, PidSet):
        for field in fields(message):
            yield field.name, getattr(message, field.name)
        return
    if len(message.linear) != 3:
        raise EncodeError("PidSet", "linear", message.linear, "three numbers")
    if len(message.angular) > SETS_MAX:
        raise EncodeError("PidSet", "angular", f"{len(message.angular)} sets", f"at most {SETS_MAX} sets")
    for name, gain in zip(("kp", "ki", "kd"), message.linear, strict=True):
        yield f"linear.{name}", gain
    for k, numbers in enumerate(message.angular):
        if len(numbers) != 4:
            raise EncodeError("PidSet", f"angular[{k}]", numbers, "four numbers")
        for name, number in zip(("v_max", "kp", "ki", "kd"), numbers, strict=True):
            yield f"angular[{k}].{name}", number


def _takes(layout: Layout) -> str:
    """What a field of this layout takes, in words and SI units."""
    if layout.to_wire is to_thousandths:
        low, high = map(from_thousandths, layout.limits)
        return f"a number from {low:.3f} to {high:.3f}"
    if layout.to_wire is index:
        return "a whole number from {} to {}".format(*layout.limits)
    return "a Switch or a bool"


def _thousandths(message: Callable[..., Message], data: Struct) -> Reader:
    unpack = data.unpack_from
    return lambda buffer, at: message(*[from_thousandths(integer) for integer in unpack(buffer, at)])


def _counts(message: Callable[..., Message], data: Struct) -> Reader:
    unpack = data.unpack_from
    return lambda buffer, at: message(*unpack(buffer, at))


def _odometry(message: type[EncoderOdometry] | type[CombinedOdometry], data: Struct) -> Reader:
    """A quicker `_thousandths`, for most of what the line carries is odometry."""
    unpack = data.unpack_from

    def read(buffer: bytes, at: int) -> Message:
        x, y, theta, v, omega = unpack(buffer, at)
        return message(x / 1000.0, y / 1000.0, theta / 1000.0, v / 1000.0, omega / 1000.0)

    return read


def _pid_set(data: Struct) -> Reader:
    def read(buffer: bytes, at: int) -> PidSet:
        kp, ki, kd, *rest = map(from_thousandths, data.unpack_from(buffer, at))
        sets = iter(rest)
        return PidSet((kp, ki, kd), tuple(zip(sets, sets, sets, sets, strict=True)))

    return read


def _power_control(data: Struct) -> Reader:
    def read(buffer: bytes, at: int) -> PowerControl:
        switch, state = data.unpack_from(buffer, at)
        if switch not in tuple(Switch) or state not in (0, 1):
            raise BadValue(f"no switch {switch} can be switched to {state}")
        return PowerControl(Switch(switch), state == 1)

    return read


def _pid_response(data: Struct) -> Reader:
    def read(buffer: bytes, at: int) -> PidResponse:
        (answer,) = data.unpack_from(buffer, at)
        if answer not in (ACCEPTED, REJECTED):
            raise BadValue(f"{answer:#04x} is no answer")
        return PidResponse(answer == ACCEPTED)

    return read


def _switch_or_state(value: Any) -> int:
    if value not in (0, 1):
        raise ValueError(f"{value} is neither 0 nor 1")
    return int(value)


def _answer(accepted: Any) -> int:
    return ACCEPTED if _switch_or_state(accepted) else REJECTED


def _si(message: type[Message], command: int, receiver: Role, code: str, count: int) -> Layout:
    """A message whose fields are SI values."""
    return Layout(message, command, receiver, code, (count,), to_thousandths, partial(_thousandths, message))


def _pwm(message: type[Message], command: int, count: int) -> Layout:
    """A message whose fields are PWM counts."""
    return Layout(message, command, Role.BOARD, "i", (count,), index, partial(_counts, message))


LAYOUTS: Final = (
    _si(Velocity, 0x67, Role.BOARD, "h", 2),
    Layout(EncoderOdometry, 0x68, Role.HOST, "i", (5,), to_thousandths, partial(_odometry, EncoderOdometry)),
    Layout(CombinedOdometry, 0x69, Role.BOARD, "i", (5,), to_thousandths, partial(_odometry, CombinedOdometry)),
    _si(BatteryLevels, 0x6A, Role.HOST, "H", 2),
    _pwm(PwmTest, 0x6C, 5),
    Layout(PowerControl, 0x6E, Role.BOARD, "B", (2,), _switch_or_state, _power_control),
    _pwm(PwmCommand, 0x6F, 2),
    Layout(PidSet, 0x70, Role.BOARD, "i", range(3, 3 + 4 * SETS_MAX + 1, 4), to_thousandths, _pid_set),
    Layout(PidResponse, 0x70, Role.HOST, "B", (1,), _answer, _pid_response),
)
"""Every message."""
