"""The layout of each message on the wire (thesis 3.5): a table for encoding, decoding and recordings.

A frame is 0xFA 0xFB | length (data bytes, 0 .. 249) | command | data | checksum high | checksum low.
All fields of a message are integers of one size, big-endian and two's complement. A new message is a dataclass in
`txt1.protocol.messages` and a line of `declare` here.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields
from enum import Enum
from math import inf
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
    """The receiving end of the line: host or board."""

    HOST = "host"
    BOARD = "board"


class BadValue(ValueError):
    """An integer of an intact frame has no meaning, as switch 7."""


class FieldKind(NamedTuple):
    """Conversion between a field's values and its integers on the wire.

    The functions raise ValueError or TypeError for a value without an integer, and BadValue for an integer without a
    value.
    """

    to_wire: Callable[[Any], int]
    from_wire: Callable[[int], Any]
    # the value from its number in a recording
    from_number: Callable[[float], Any]
    # the allowed values, for error messages; a format string that takes the smallest and the largest
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
    # the allowed numbers of integers
    counts: Sequence[int]
    kind: FieldKind
    # the values of a message and the names of their fields, in the order of the wire
    values: Callable[[Any], Iterable[tuple[str, Any]]]
    # makes a message from these values
    make: Callable[..., Message]

    @property
    def receiver(self) -> Role:
        """The end of the line that receives the message."""
        return Role.BOARD if issubclass(self.message, HostMessage) else Role.HOST

    def struct(self, count: int) -> Struct:
        """Return the `struct` format of data with `count` integers."""
        return Struct(f">{count}{self.code}")

    def pack(self, message: Message) -> bytes:
        """Return the data of a message's frame.

        Raises EncodeError: it names the field that is not finite or does not fit.
        """
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
        """Return a function that reads a message from a buffer at an offset; the function raises BadValue."""
        unpack, make, from_wire = data.unpack_from, self.make, self.kind.from_wire
        # most messages on the line; a call for each value would take half as long again
        if self.kind is SI:
            return lambda buffer, at: make(*[integer / 1000.0 for integer in unpack(buffer, at)])
        return lambda buffer, at: make(*[from_wire(integer) for integer in unpack(buffer, at)])


# every other message
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
    """Add a message to the protocol. From then on it is encoded, decoded, listed and recorded.

    `message` is a frozen dataclass, derived from HostMessage or BoardMessage. `Layout` describes the other
    arguments. Without `values` and `make`, the values are the dataclass's fields. Raises ValueError when the receiver
    already has a message of this command and length.
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
    """Return the checksum, 0 .. 65535, of a frame's command and data.

    Pairs of bytes, high byte first, are added modulo 65536; an odd last byte is XORed into the low byte. The
    checksum detects every single flipped bit. It misses two flipped bits that cancel out, and two pairs that changed
    places.
    """
    total = sum(data[0:-1:2]) * 256 + sum(data[1::2])
    return (total ^ data[-1] if len(data) % 2 else total) & 0xFFFF


def encode(message: Message) -> bytes:
    """Return the frame of a message. Values are rounded to the nearest count of the wire, ties to even.

    Raises EncodeError for a value that is not finite or does not fit its field. The error names message, field,
    value and range.
    """
    layout = LAYOUTS.get(type(message))
    if layout is None:
        raise TypeError(f"{message!r} is no message of the protocol")
    data = layout.pack(message)
    body = bytes((layout.command,)) + data
    return HEADER + bytes((len(data),)) + body + checksum(body).to_bytes(2, "big")


def numbers(message: Message) -> tuple[float, ...]:
    """Return a message's values as plain numbers in the order of the wire, as recordings hold them.

    A whole number that no float holds is infinite.
    """
    return tuple([_as_float(value) for _, value in LAYOUTS[type(message)].values(message)])


def _as_float(value: float) -> float:
    try:
        return float(value)
    except OverflowError:
        return inf if value > 0 else -inf


def from_numbers(name: str, values: Sequence[float]) -> Message:
    """Return the message of this name and these numbers: the inverse of `numbers`.

    Raises ValueError for an unknown name.
    """
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
