"""Values as bytes and back: exact, and readable when a type has got or lost a field since."""

from __future__ import annotations

from dataclasses import dataclass
from math import copysign, inf, nan
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.hal.base import BoardLink, Button, Capabilities, Inputs
from txt1.model.odometry import Odometry
from txt1.sensors.light import Readings
from txt1.sensors.readings import DepthImage, FixReading, Image, ImuReading, Mount, Scan, TrackerReading
from txt1.telemetry.exact import decode, encode

VALUES = [
    1.5, True, "a word", 7, b"\x00\xff",
    ImuReading((0.1, -0.0, inf), (1e-300, 2.0, 3.0), (0.0, 0.0, 0.6, 0.8), None, Mount(0.1, 0.2, 0.3, 0.4)),
    FixReading(35.1, -106.6, 1.0, 2.0, satellites=7),
    TrackerReading(1.0, 2.0, 0.1, (0.0, 0.0, 0.0, 1.0), v=0.5, subject="txt1"),
    Image(640, 480, b"\xff\xd8 a picture"), DepthImage(2, 1, b"\x01\x00\x02\x00", 300.0),
    Readings(1.0, 2.0, 3.0, 4.0),
    Inputs((5, -6), Odometry(1.0, 2.0, 3.0, 4.0, 5.0), 0.25, (12.1, 0.0), True, Button.UP | Button.LEFT,
           link=BoardLink(True, 2, "gone", "back", {"line_bad_length": 3})),
    Capabilities(pwm=True, halt=True),
]  # fmt: skip


@pytest.mark.parametrize("value", VALUES, ids=lambda value: type(value).__name__)
def test_a_value_comes_back_as_it_was(value: Any) -> None:
    again = decode(type(value), encode(value))
    assert again == value
    assert type(again) is type(value)
    assert repr(again) == repr(value), "a zero keeps its sign"


@given(st.floats())
def test_a_number_keeps_every_bit(number: float) -> None:
    again = decode(float, encode(number))
    assert again == number or (number != number and again != again)
    assert copysign(1.0, again) == copysign(1.0, number)


def test_a_scan_keeps_its_arrays() -> None:
    ranges = np.array([0.5, inf, nan, 3.25], np.float32)
    scan = Scan(-1.0, 0.1, 1e-4, ranges, 0.06, 4.095, np.arange(4, dtype=np.float32))
    again = decode(Scan, encode(scan))
    assert again.ranges.dtype == np.float32
    assert again.ranges.tobytes() == scan.ranges.tobytes()
    assert again.intensities.tolist() == [0.0, 1.0, 2.0, 3.0]
    assert np.array_equal(again.points, scan.points)


def test_numbers_of_numpys_are_numbers() -> None:
    assert encode((np.float64(0.1), np.int32(3), np.bool_(True))) == encode((0.1, 3, True))


class Before(NamedTuple):
    heading: float
    gone: int = 0


class Now(NamedTuple):
    heading: float
    sure: bool = True
    height: float | None = None


def test_a_type_may_get_and_lose_fields() -> None:
    assert decode(Now, encode(Before(0.5, 3))) == Now(0.5, True, None)


@dataclass(frozen=True)
class Strange:
    """Holds something that has no exact bytes."""

    what: object


@pytest.mark.parametrize("value", [Strange(object()), {1, 2}, np.array([object()])])
def test_a_value_that_has_no_exact_bytes_is_refused(value: object) -> None:
    with pytest.raises(TypeError, match="has no exact bytes"):
        encode(value)
    with pytest.raises(OverflowError):
        encode(1 << 80)


@given(st.binary(max_size=60))
def test_bytes_that_are_no_value_are_refused(data: bytes) -> None:
    try:
        decode(ImuReading, data)
    except ValueError:
        return


@given(st.integers(0, 200), st.integers(0, 255))
def test_a_damaged_value_is_another_value_or_refused(place: int, byte: int) -> None:
    data = bytearray(encode(VALUES[5]))
    data[place % len(data)] = byte
    try:
        decode(ImuReading, bytes(data))
    except ValueError:
        return
