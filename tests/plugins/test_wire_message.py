"""A message of one's own costs two places: its class, and its line in the table of layouts."""

from collections.abc import Iterator
from dataclasses import dataclass

import pytest

from txt1.errors import EncodeError
from txt1.protocol.capture import describe
from txt1.protocol.decoder import Decoder
from txt1.protocol.layout import LAYOUTS, Role, declare, encode, from_numbers, numbers
from txt1.protocol.messages import BoardMessage, HostMessage


# the first place: in txt1/protocol/messages.py
@dataclass(frozen=True, slots=True)
class MotorTemperature(BoardMessage):
    """Of the drive motor, degrees Celsius."""

    celsius: float


@pytest.fixture(autouse=True)
def declared() -> Iterator[None]:
    declare(MotorTemperature, 0x71, "h", 1)  # the second place: in txt1/protocol/layout.py
    yield
    del LAYOUTS[MotorTemperature]


def test_it_is_encoded_and_decoded() -> None:
    frame = encode(MotorTemperature(31.25))
    assert frame == bytes.fromhex("FA FB 02 71 7A 12 71 68")
    assert Decoder(Role.HOST).feed(frame) == [MotorTemperature(31.25)]
    (fault,) = Decoder(Role.BOARD).feed(frame)
    assert fault != MotorTemperature(31.25), "only hosts receive it"


def test_what_does_not_fit_is_refused_by_name() -> None:
    with pytest.raises(EncodeError, match=r"MotorTemperature\.celsius is 40\.0, .* from -32\.768 to 32\.767"):
        encode(MotorTemperature(40.0))


def test_it_is_listed_counted_and_recorded() -> None:
    message = MotorTemperature(-4.5)
    decoder = Decoder(Role.HOST)
    decoder.feed(encode(message))
    assert decoder.messages[MotorTemperature] == 1
    assert describe(0, message) == "       0  MotorTemperature  celsius=-4.5"
    assert from_numbers("MotorTemperature", numbers(message)) == message


def test_a_command_that_is_taken_is_refused() -> None:
    @dataclass(frozen=True, slots=True)
    class Other(BoardMessage):
        humidity: float

    @dataclass(frozen=True, slots=True)
    class Question(HostMessage):
        sensor: float

    with pytest.raises(ValueError, match="MotorTemperature has command 0x71 already"):
        declare(Other, 0x71, "H", 1)
    declare(Question, 0x71, "h", 1)  # the other way the command is free
    del LAYOUTS[Question]
