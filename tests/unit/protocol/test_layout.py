"""A message's place in the protocol, and its numbers as recordings have them."""

from dataclasses import dataclass
from math import inf

import protocol_streams as streams
import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.errors import EncodeError
from txt1.protocol.layout import LAYOUTS, Role, declare, encode, from_numbers, numbers
from txt1.protocol.messages import BoardMessage, HostMessage, Message, PowerControl, PwmCommand, Switch, Velocity


@dataclass(frozen=True, slots=True)
class Another(HostMessage):
    """Has a command and a length that are taken."""

    one: float
    two: float


@dataclass(frozen=True, slots=True)
class Answer(BoardMessage):
    """Has them as well, the other way."""

    one: float
    two: float


@given(st.one_of(streams.MESSAGES[Role.BOARD], streams.MESSAGES[Role.HOST]))
def test_a_message_is_made_again_of_its_numbers(message: Message) -> None:
    assert from_numbers(type(message).__name__, numbers(message)) == message


def test_a_whole_number_that_no_float_holds_is_infinite_in_a_recording() -> None:
    assert numbers(PwmCommand(10**400, -(10**400))) == (inf, -inf)


@pytest.mark.parametrize("name, count", [("Velocity", 3), ("Velocity", 0), ("Nothing", 2), ("PidSet", 4)])
def test_numbers_of_no_message_are_refused(name: str, count: int) -> None:
    with pytest.raises(ValueError, match=f"no message '{name}' with {count} numbers"):
        from_numbers(name, [0.0] * count)


def test_only_a_known_command_and_length_of_the_receiver_s_own_are_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("txt1.protocol.layout.LAYOUTS", LAYOUTS.copy())
    with pytest.raises(ValueError, match="Another: Velocity has command 0x67 already"):
        declare(Another, 0x67, "h", 2)
    declare(Another, 0x67, "h", 3)
    declare(Another, 0x50, "h", 2)
    declare(Answer, 0x67, "h", 2)
    declare(Velocity, 0x67, "h", 2)


def test_a_message_that_is_declared_is_encoded_decoded_and_recorded_by_its_fields(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("txt1.protocol.layout.LAYOUTS", layouts := LAYOUTS.copy())
    declare(Another, 0x50, "h", 2)
    declare(Answer, 0x51, "h", 2, values=lambda each: [("sum", each.one + each.two)] * 2, make=lambda *_: Answer(7, 8))
    assert layouts[Another].receiver is Role.BOARD
    assert encode(Another(0.5, -0.001)) == bytes.fromhex("FA FB 04 50 01 F4 FF FF 45 FF")
    assert from_numbers("Another", numbers(Another(0.5, -0.001))) == Another(0.5, -0.001)
    with pytest.raises(EncodeError, match=r"Another\.two is 33"):
        encode(Another(0.0, 33.0))
    assert numbers(Answer(1, 2)) == (3.0, 3.0)
    assert from_numbers("Answer", (3.0, 3.0)) == Answer(7, 8)


def test_the_switches_have_the_numbers_of_the_wire() -> None:
    assert numbers(PowerControl(Switch.ATX, True)) == (0.0, 1.0)
    assert numbers(PowerControl(Switch.ESC, False)) == (1.0, 0.0)
