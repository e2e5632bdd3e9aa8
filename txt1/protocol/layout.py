"""The layout of each message on the wire (thesis 3.5): one table that encoding, decoding and recordings read.

A frame is 0xFA 0xFB | length (data bytes, 0 .. 249) | command | data | checksum high | checksum low.
All fields of a message are integers of one size, big-endian and two's complement. A new message is a dataclass in
`txt1.protocol.messages` and a line of `declare` here.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields
from enum import Enum
from operator import index
from struct import Struct
from typing import Any, Final, NamedTuple

from txt1.errors import EncodeError
from txt1.protocol import messages
from txt1.protocol.messages import HostMessage, Message, PidSet, PowerControl, Switch
from txt1.units import PER_UNIT, from_thousandths, to_thousandths

HEADER: Final = b"\xfa\xfb"
# angular gain sets that a PID set has room for
SETS_MAX: Final = 14
ACCEPTED: Final = 0x3C
REJECTED: Final = 0x55


class Role(Enum):
    """An end of the line, named as the one that receives."""

    HOST = "host"
    BOARD = "board"


class BadValue(ValueError):
    """An integer of an intact frame stands for nothing: such as switch 7."""


class FieldKind(NamedTuple):
    """The meaning of a field's integers: ValueError, TypeError and BadValue say that a value or integer has none."""

    to_wire: Callable[[Any], int]
    from_wire: Callable[[int], Any]
    # the value of a number that a recording has for it
    from_number: Callable[[float], Any]
    # the values there are, in words, with room for the smallest and the largest
    takes: str
    per_unit: int = 1


def _state(value: Any) -> int:
    if value not in (0, 1):
        raise BadValue(f"{value} is neither 0 nor 1")
    return int(value)


def _answered(integer: int) -> bool:
    if integer not in (ACCEPTED, REJECTED):
        raise BadValue(f"{integer:#04x} is no answer")
    return integer == ACCEPTED


SI: Final = FieldKind(to_thousandths, from_thousandths, float, "a number from {:.3f} to {:.3f}", PER_UNIT)
COUNT: Final = FieldKind(index, int, float, "a whole number from {:.0f} to {:.0f}")
STATE: Final = FieldKind(_state, _state, round, "a Switch or a bool")
ANSWER: Final = FieldKind(lambda value: ACCEPTED if _state(value) else REJECTED, _answered, bool, "a bool")


@dataclass(frozen=True, slots=True)
class Layout:
    """One message's command and data."""

    message: type[Message]
    command: int
    # the letter in `struct` of every integer of the data: "h", "i", "H" or "B"
    code: str
    # how many integers there may be
    counts: Sequence[int]
    kind: FieldKind
    # in the order of the wire, with the names of their fields
    values: Callable[[Any], Iterable[tuple[str, Any]]]
    # of such values
    make: Callable[..., Message]

    @property
    def receiver(self) -> Role:
        """The end of the line that receives it."""
        return Role.BOARD if issubclass(self.message, HostMessage) else Role.HOST

    def struct(self, count: int) -> Struct:
        """The data with `count` integers."""
        return Struct(f">{count}{self.code}")

    def pack(self, message: Message) -> bytes:
        """The data of a message's frame; an EncodeError names the field that is not finite or does not fit."""
        bits = 8 * Struct(f">{self.code}").size
        low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if self.code.islower() else (0, (1 << bits) - 1)
        integers = []
        for name, value in self.values(message):
            try:
                integer = self.kind.to_wire(value)
                if not low <= integer <= high:
                    raise ValueError
            except (ValueError, TypeError, AttributeError):
                takes = self.kind.takes.format(low / self.kind.per_unit, high / self.kind.per_unit)
                raise EncodeError(self.message.__name__, name, value, takes) from None
            integers.append(integer)
        return self.struct(len(integers)).pack(*integers)

    def reader(self, data: Struct) -> Callable[[bytes, int], Message]:
        """Return a function of a buffer and the data's place in it that makes the message, or raises BadValue."""
        unpack, make, from_wire = data.unpack_from, self.make, self.kind.from_wire
        # most of what the line carries; a call for each value would take half as long again
        if self.kind is SI:
            return lambda buffer, at: make(*[integer / 1000.0 for integer in unpack(buffer, at)])
        return lambda buffer, at: make(*[from_wire(integer) for integer in unpack(buffer, at)])


# every message's
LAYOUTS: Final[dict[type[Message], Layout]] = {}


def declare(
    message: type[Message],
    command: int,
    code: str,
    counts: int | Sequence[int],
    kind: FieldKind = SI,
    values: Callable[[Any], Iterable[tuple[str, Any]]] | None = None,
    make: Callable[..., Message] | None = None,
) -> None:
    """Give a message its place in the protocol: from now on it is encoded, decoded, listed and recorded.

    `message` is a frozen dataclass that is a HostMessage or a BoardMessage; see `Layout` for the others. Its values are
    its fields, and it makes itself of them, unless `values` and `make` say otherwise. A ValueError when its receiver
    understands another message with this command and length.
    """
    counts = (counts,) if isinstance(counts, int) else counts
    layout = Layout(message, command, code, counts, kind, values or _fields_of(message), make or message)
    sizes = {layout.struct(count).size for count in counts}
    for other in LAYOUTS.values():
        alike = other.command == command and other.receiver is layout.receiver and other.message is not message
        if alike and sizes & {other.struct(count).size for count in other.counts}:
            raise ValueError(f"{message.__name__}: {other.message.__name__} has command {command:#04x} already")
    LAYOUTS[message] = layout


def _fields_of(message: type[Message]) -> Callable[[Any], Iterable[tuple[str, Any]]]:
    names = [field.name for field in fields(message)]
    return lambda one: [(name, getattr(one, name)) for name in names]


def checksum(data: bytes) -> int:
    """The checksum, 0 .. 65535, of a frame's command and data.

    Pairs of bytes, the first one the high one, are added modulo 65536; an odd last byte is XORed into the low byte. Any
    single flipped bit is noticed; two that cancel out, or two pairs that changed places, are not.
    """
    total = sum(data[0:-1:2]) * 256 + sum(data[1::2])
    return (total ^ data[-1] if len(data) % 2 else total) & 0xFFFF


def encode(message: Message) -> bytes:
    """The frame of a message, values rounded to the nearest count of the wire, ties to the even one.

    An EncodeError names message, field, value and range of a value that is not finite or does not fit its field.
    """
    layout = LAYOUTS.get(type(message))
    if layout is None:
        raise TypeError(f"{message!r} is no message of the protocol")
    data = layout.pack(message)
    body = bytes((layout.command,)) + data
    return HEADER + bytes((len(data),)) + body + checksum(body).to_bytes(2, "big")


def numbers(message: Message) -> tuple[float, ...]:
    """A message's values as plain numbers in the order of the wire, as recordings have them."""
    return tuple([float(value) for _, value in LAYOUTS[type(message)].values(message)])


def from_numbers(name: str, values: Sequence[float]) -> Message:
    """The message of a name and its numbers, the inverse of `numbers`; ValueError when there is no such message."""
    for layout in LAYOUTS.values():
        if layout.message.__name__ == name and len(values) in layout.counts:
            return layout.make(*map(layout.kind.from_number, values))
    raise ValueError(f"there is no message {name!r} with {len(values)} numbers")


def _gains(message: PidSet) -> Iterable[tuple[str, Any]]:
    if len(message.linear) != 3:
        raise EncodeError("PidSet", "linear", message.linear, "three numbers")
    if len(message.angular) > SETS_MAX:
        raise EncodeError("PidSet", "angular", f"{len(message.angular)} sets", f"at most {SETS_MAX} sets")
    for name, gain in zip(("kp", "ki", "kd"), message.linear, strict=True):
        yield f"linear.{name}", gain
    for k, each in enumerate(message.angular):
        if len(each) != 4:
            raise EncodeError("PidSet", f"angular[{k}]", each, "four numbers")
        for name, number in zip(("v_max", "kp", "ki", "kd"), each, strict=True):
            yield f"angular[{k}].{name}", number


def _pid_set(kp: float, ki: float, kd: float, *rest: float) -> PidSet:
    sets = iter(rest)
    return PidSet((kp, ki, kd), tuple(zip(sets, sets, sets, sets, strict=True)))


declare(messages.Velocity, 0x67, "h", 2)
declare(messages.EncoderOdometry, 0x68, "i", 5)
declare(messages.CombinedOdometry, 0x69, "i", 5)
declare(messages.BatteryLevels, 0x6A, "H", 2)
declare(messages.PwmTest, 0x6C, "i", 5, COUNT)
declare(PowerControl, 0x6E, "B", 2, STATE, make=lambda switch, on: PowerControl(Switch(switch), on == 1))
declare(messages.PwmCommand, 0x6F, "i", 2, COUNT)
declare(PidSet, 0x70, "i", range(3, 3 + 4 * SETS_MAX + 1, 4), values=_gains, make=_pid_set)
declare(messages.PidResponse, 0x70, "B", 1, ANSWER)
