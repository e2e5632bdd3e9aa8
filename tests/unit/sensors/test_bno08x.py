"""A BNO08x in UART-RVC: the maker's example frame judges what is read."""

from __future__ import annotations

from itertools import pairwise
from math import cos, hypot, pi, radians, sin

import pytest

from txt1.sensors.base import Reading
from txt1.sensors.imu_bno08x import RvcDecoder, orientation_of, pack, product
from txt1.sensors.readings import ImuReading, Mount, heading
from txt1.sensors.virtual_bno08x import angles_of, bno08x

# the example in the BNO08X data sheet, section 1.3.5.2: index 222, yaw 0.01, pitch -1.10, roll 20.85 degrees,
# -371, -20 and 977 thousandths of g
EXAMPLE = bytes.fromhex("AA AA DE 01 00 92 FF 25 08 8D FE EC FF D1 03 00 00 00 E7")
G = 9.80665


def read(*frames: bytes, decoder: RvcDecoder | None = None) -> list[ImuReading]:
    """The readings of frames."""
    return [each.value for each in (decoder or RvcDecoder(Mount())).feed(b"".join(frames))]


def test_the_makers_example_frame_is_packed_and_read() -> None:
    assert pack(222, (0.01, -1.10, 20.85), (-0.371, -0.020, 0.977)) == EXAMPLE
    (reading,) = read(pack(221, (0.01, -1.10, 20.85), (0.0, 0.0, 1.0)), EXAMPLE)
    assert reading.acceleration == pytest.approx((-3.638, -0.196, 9.581), abs=0.001)  # as the data sheet says
    assert reading.rates == pytest.approx((0.0, 0.0, 0.0))


def test_gravity_in_the_makers_example_agrees_with_its_angles() -> None:
    (reading,) = read(pack(221, (0.01, -1.10, 20.85), (0.0, 0.0, 1.0)), EXAMPLE)
    assert reading.orientation is not None
    x, y, z, w = reading.orientation
    # the vertical as the device sees it: third row of its matrix
    up = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)
    size = hypot(*reading.acceleration)
    assert size == pytest.approx(G, rel=0.05)
    for felt, expected in zip(reading.acceleration, up, strict=True):
        assert felt / size == pytest.approx(expected, abs=0.003)


@pytest.mark.parametrize("rate", [1.0, -1.0, 10.0])
def test_a_turn_across_180_degrees_and_index_255_has_its_rate(rate: float) -> None:
    frames = []
    for k in range(100):
        yaw = (175.0 + rate * k * 0.01 * 180.0 / pi + 180.0) % 360.0 - 180.0
        frames.append(pack(230 + k, (yaw, 0.0, 0.0), (0.0, 0.0, 1.0)))
    readings = read(*frames)
    assert len(readings) == 99
    for reading in readings:
        # the angle has steps of 0.01 degrees
        assert reading.rates == pytest.approx((0.0, 0.0, rate), abs=0.02)


def test_a_lost_frame_does_not_double_the_rate_and_long_gaps_tell_none() -> None:
    frames = [pack(k, (k * 1.0, 0.0, 0.0), (0.0, 0.0, 1.0)) for k in range(60)]
    readings = read(*frames[:5], *frames[6:10], *frames[40:])
    assert len(readings) == 4 + 4 + 19
    for reading in readings:
        assert reading.rates[2] == pytest.approx(radians(100.0))


def test_a_device_that_starts_again_is_not_a_turn() -> None:
    readings = read(
        *(pack(k, (120.0, 0.0, 0.0), (0.0, 0.0, 1.0)) for k in (252, 253, 254)),
        *(pack(k, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)) for k in (0, 1, 2)),
    )
    assert [reading.rates[2] for reading in readings] == pytest.approx([0.0] * 4)


@pytest.mark.parametrize("yaw", [0.0, pi / 2, -pi / 2, pi])
def test_a_device_that_is_mounted_turned_tells_the_vehicles_axes(yaw: float) -> None:
    # the vehicle's nose is up by 10 degrees, and it turns to the left
    frames = []
    for k in range(3):
        vehicle = product((0.0, 0.0, sin(0.05 * k), cos(0.05 * k)), (0.0, sin(radians(-5.0)), 0.0, cos(radians(5.0))))
        device = product(vehicle, (0.0, 0.0, sin(0.5 * yaw), cos(0.5 * yaw)))
        ahead, up = sin(radians(10.0)), cos(radians(10.0))
        frames.append(pack(k, angles_of(device), (ahead * cos(yaw), -ahead * sin(yaw), up)))
    for reading in read(*frames, decoder=RvcDecoder(Mount(yaw=yaw))):
        assert reading.acceleration == pytest.approx((G * sin(radians(10.0)), 0.0, G * cos(radians(10.0))), abs=0.01)
        assert reading.rates == pytest.approx((10.0 * sin(radians(10.0)), 0.0, 10.0 * cos(radians(10.0))), abs=0.03)
        assert reading.mount.yaw == 0.0
        assert reading.orientation is not None


def test_angles_and_orientations_are_inverse() -> None:
    for given in ((10.0, 20.0, 30.0), (-170.0, -80.0, 170.0), (179.0, 5.0, -95.0)):
        assert angles_of(orientation_of(*(radians(each) for each in given))) == pytest.approx(given)


def test_damaged_frames_are_discarded() -> None:
    frames = [pack(k, (1.0, 2.0, 3.0), (0.0, 0.0, 1.0)) for k in range(20)]
    broken = bytearray(b"".join(frames))
    broken[19 * 10 + 7] ^= 4
    decoder = RvcDecoder(Mount())
    readings = read(bytes(broken), decoder=decoder)
    assert (len(readings), decoder.faults) == (18, 1)


def test_a_virtual_device_sends_the_readings_it_is_given() -> None:
    sent: list[bytes] = []
    device = bno08x()
    device.send = sent.append  # type: ignore[method-assign]
    for k in range(3):
        turned = (0.0, 0.0, sin(0.005 * k), cos(0.005 * k))
        device.show(Reading(0.01 * k, ImuReading((0.1, -0.2, 9.8), (0.0, 0.0, 1.0), turned)))
    readings = read(*sent)
    assert [heading(reading.orientation) for reading in readings if reading.orientation] == pytest.approx(
        [0.01, 0.02], abs=1e-4
    )
    for before, after in pairwise(readings):
        assert before.rates == pytest.approx((0.0, 0.0, 1.0), abs=0.02) == after.rates
