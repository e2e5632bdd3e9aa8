"""Frames: golden ones worked out by hand, rounding, ranges (thesis 3.5)."""

from __future__ import annotations

import math
from fractions import Fraction
from pathlib import Path

import protocol_streams as streams
import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.errors import EncodeError, Txt1Error
from txt1.protocol import messages, radio_control
from txt1.protocol.decoder import Decoder, receivable
from txt1.protocol.layout import LAYOUTS, Role, checksum, encode
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
    Velocity,
)
from txt1.units import from_thousandths, to_thousandths

THESIS = tuple(
    (v_max, float(kp), float(ki), 0.005)
    for v_max, kp, ki in zip(
        (-1.35, -1.15, -0.95, -0.75, -0.55, -0.35, -0.15, 0.15, 0.35, 0.55, 0.75, 0.95, 1.15, 1.35),
        (1, 1, 1, 1, 1, 1, 1, 6, 6, 4, 3, 4, 4, 4),
        (25, 25, 25, 35, 40, 50, 30, 200, 170, 130, 80, 60, 30, 20),
        strict=True,
    )
)


def golden() -> list[tuple[Role, Message, bytes]]:
    """The receiver, message and frame of every entry of the golden file."""
    text = (Path(__file__).parents[2] / "golden" / "frames.txt").read_text()
    entries: list[list[str]] = []
    for line in text.splitlines():
        if line.startswith("    "):
            entries[-1][2] += line
        elif line and not line.startswith("#"):
            entries.append(line.split("|"))
    names = {**vars(messages), **vars(radio_control), "THESIS": THESIS}
    return [(Role(role.strip()), eval(message, names), bytes.fromhex(frame)) for role, message, frame in entries]


GOLDEN = golden()


@pytest.mark.parametrize(("role", "message", "frame"), GOLDEN, ids=lambda value: str(value)[:60])
def test_golden_frames_both_ways(role: Role, message: Message, frame: bytes) -> None:
    assert encode(message) == frame
    assert Decoder(role).feed(frame) == [message]
    assert checksum(frame[3:-2]) == int.from_bytes(frame[-2:], "big")


def test_the_golden_frames_hold_every_message_and_the_longest_frame() -> None:
    assert {type(message) for _, message, _ in GOLDEN} == set(LAYOUTS)
    longest = max(legal.size for role in Role for legal in receivable(role).values())
    assert max(len(frame) for _, _, frame in GOLDEN) == 242 == longest <= 255


def test_a_checksum_is_the_sum_of_pairs_with_an_odd_last_byte_xored() -> None:
    assert checksum(b"") == 0
    assert checksum(b"\x12") == 0x12
    assert checksum(b"\x12\x34") == 0x1234
    assert checksum(b"\x12\x34\x56") == 0x1234 ^ 0x56
    assert checksum(b"\xff\xff\x00\x02") == 1
    assert checksum(b"\xff\xff" * 200) == 0xFFFF * 200 % 65536


@given(st.binary(max_size=260), st.data())
def test_a_single_flipped_bit_changes_the_checksum(body: bytes, data: st.DataObject) -> None:
    if body:
        bit = data.draw(st.integers(0, 8 * len(body) - 1))
        flipped = bytearray(body)
        flipped[bit // 8] ^= 1 << bit % 8
        assert checksum(bytes(flipped)) != checksum(body)


@pytest.mark.parametrize("role", Role)
def test_the_legal_frames_are_those_of_the_table(role: Role) -> None:
    assert {tuple(pair) for pair in receivable(role)} == {
        (length, command) for command, lengths in streams.LENGTHS[role].items() for length in lengths
    }


@pytest.mark.parametrize("role", Role)
@given(st.data())
def test_every_message_survives_the_wire_within_rounding(role: Role, data: st.DataObject) -> None:
    message = data.draw(streams.MESSAGES[role])
    frame = encode(message)
    (received,) = Decoder(role).feed(frame)
    assert not isinstance(received, Exception)
    assert streams.difference(message, received) <= 0.0005 * (1 + 1e-9)
    assert encode(received) == frame
    assert type(received) is type(message)
    assert hash(received) == hash(type(message)(*(getattr(received, name) for name in type(message).__slots__)))


def test_a_received_message_is_as_frozen_as_any() -> None:
    for role, _, frame in GOLDEN:
        (message,) = Decoder(role).feed(frame)
        with pytest.raises(AttributeError):
            setattr(message, type(message).__slots__[0], 1.0)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_rounding_is_to_the_nearest_exactly_ties_to_even(value: float) -> None:
    assert to_thousandths(value) == round(Fraction(value) * 1000)


@pytest.mark.parametrize(
    ("value", "count"), [(0.0005, 1), (0.0625, 62), (0.1875, 188), (-0.0625, -62), (-0.0009, -1), (1.2344999, 1234)]
)
def test_rounding_examples(value: float, count: int) -> None:
    assert to_thousandths(value) == count


@given(st.integers(-(2**31), 2**31 - 1))
def test_a_count_of_the_wire_comes_back_as_itself(count: int) -> None:
    assert to_thousandths(from_thousandths(count)) == count
    assert from_thousandths(count) == float(f"{count}e-3")


NAN, INF = math.nan, math.inf


@pytest.mark.parametrize(
    ("message", "field"),
    [
        (Velocity(32.768, 0.0), "v"),
        (Velocity(0.0, -32.7686), "omega"),
        (Velocity(NAN, 0.0), "v"),
        (Velocity(0.0, INF), "omega"),
        (Velocity("0.5", 0.0), "v"),  # type: ignore[arg-type]
        (Velocity(1e300, 0.0), "v"),
        (EncoderOdometry(0.0, 0.0, 2147483.648, 0.0, 0.0), "theta"),
        (CombinedOdometry(0.0, -2147483.649, 0.0, 0.0, 0.0), "y"),
        (BatteryLevels(65.536, 0.0), "battery1"),
        (BatteryLevels(0.0, -0.001), "battery2"),
        (PwmTest(2**31, 0, 0, 0, 0), "motor"),
        (PwmTest(0, 0, 0, 0, -(2**31) - 1), "pwm5"),
        (PwmCommand(0.5, 0), "pwm4"),  # type: ignore[arg-type]
        (PwmCommand(0, NAN), "pwm5"),  # type: ignore[arg-type]
        (PowerControl(2, True), "switch"),  # type: ignore[arg-type]
        (PowerControl(messages.Switch.ESC, 7), "on"),  # type: ignore[arg-type]
        (PidSet((1.0, 2.0, NAN), ()), "linear.kd"),
        (PidSet((1.0, 2.0), ()), "linear"),  # type: ignore[arg-type]
        (PidSet((1.0, 2.0, 3.0), ((0.0, 1.0, 2.0, 3.0), (0.1, 1e9, 2.0, 3.0))), "angular[1].kp"),
        (PidSet((1.0, 2.0, 3.0), ((0.0, 1.0, 2.0),)), "angular[0]"),  # type: ignore[arg-type]
        (PidSet((1.0, 2.0, 3.0), tuple((float(k), 0.0, 0.0, 0.0) for k in range(15))), "angular"),
        (PidResponse(None), "accepted"),  # type: ignore[arg-type]
    ],
    ids=str,
)
def test_what_does_not_fit_is_refused_by_name(message: Message, field: str) -> None:
    with pytest.raises(EncodeError) as caught:
        encode(message)
    assert f"{type(message).__name__}.{field} is " in str(caught.value)
    assert isinstance(caught.value, Txt1Error)
    assert isinstance(caught.value, ValueError)


def test_the_ends_of_a_field_are_reached_by_rounding_and_the_refusal_names_them() -> None:
    assert encode(Velocity(32.7674, -32.7684)) == encode(Velocity(32.767, -32.768))
    with pytest.raises(EncodeError, match=r"^Velocity\.v is 40\.0, .* takes a number from -32\.768 to 32\.767$"):
        encode(Velocity(40.0, 0.0))
    with pytest.raises(EncodeError, match=r"takes a whole number from -2147483648 to 2147483647$"):
        encode(PwmCommand(2**40, 0))


@given(st.floats(), st.floats())
def test_a_velocity_is_sent_right_or_not_at_all(v: float, omega: float) -> None:
    fits = all(math.isfinite(value) and -32768 <= round(Fraction(value) * 1000) <= 32767 for value in (v, omega))
    if fits:
        assert (
            streams.difference(Decoder(Role.BOARD).feed(encode(Velocity(v, omega)))[0], Velocity(v, omega)) <= 0.00051
        )
    else:
        with pytest.raises(EncodeError):
            encode(Velocity(v, omega))


def test_what_is_no_message_is_refused() -> None:
    with pytest.raises(TypeError, match="is no message of the protocol"):
        encode("stop")  # type: ignore[arg-type]


def test_gain_sets_that_do_not_rise_are_a_frame_and_the_boards_business() -> None:
    message = PidSet((1.0, 2.0, 3.0), ((0.5, 1.0, 1.0, 1.0), (-0.5, 1.0, 1.0, 1.0)))
    assert Decoder(Role.BOARD).feed(encode(message)) == [message]
