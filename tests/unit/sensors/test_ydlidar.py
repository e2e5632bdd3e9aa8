"""A YDLIDAR: the vendor's published bytes and numbers, and another reader, judge what is sent and read."""

from __future__ import annotations

from math import inf, nan, pi, tau
from typing import Any

import numpy as np
import pytest

from rigs.memory_line import MemoryLine
from txt1.config import load
from txt1.errors import ConfigError
from txt1.sensors.base import Reading, Setup
from txt1.sensors.laser_ydlidar import MODELS, SCAN_COMMAND, STOP_COMMAND, Model, YdlidarDecoder, corrections, packet
from txt1.sensors.readings import Scan
from txt1.sensors.registry import DRIVERS
from txt1.sensors.stream import Measured
from txt1.sensors.virtual_ydlidar import RING, VirtualYdlidar

DEGREES = np.arange(720) * 0.5 - 180.0
# a wall that comes nearer to the left and goes away to the right: a mirrored scan differs by metres
ROOM = (4.0 - DEGREES / 90.0).astype(np.float32)
SCAN = Scan(-pi, tau / 720, 0.1 / 720, ROOM, 0.02, 12.0)
# as `lds2d` names them; its T-mini measures the time of flight as a TG does, with the same packets
OTHERS = {"x2": "YDLidarX2X2L", "x4": "YDLidarX4", "tg30": "YDLidarTmini"}
models = pytest.mark.parametrize("model", ["x2", "x4", "tg30"])


def begun(model: Model) -> tuple[VirtualYdlidar, YdlidarDecoder, MemoryLine]:
    """A device that scans, and a decoder that has told it to."""
    device, decoder, line = VirtualYdlidar(model), YdlidarDecoder(MODELS[model]), MemoryLine()
    device.connected(line)
    device.received(decoder.to_send())
    if MODELS[model].commands:
        decoder.resume()
        device.received(decoder.to_send())
    return device, decoder, line


def sent(model: Model, turns: int, scan: Scan = SCAN) -> tuple[YdlidarDecoder, bytes]:
    """A decoder, and the bytes of so many turns."""
    device, decoder, line = begun(model)
    for k in range(turns):
        device.show(Reading(0.1 * k, scan))
    return decoder, line.sent


def right(ranges: Any, degrees: Any) -> float:
    """The largest error of ranges (m) seen at angles to the left (degrees), away from the seam behind the robot."""
    degrees = (np.asarray(degrees) + 180.0) % 360.0 - 180.0
    there = abs(degrees) < 170.0
    return float(np.nanmax(abs(np.asarray(ranges)[there] - (4.0 - degrees[there] / 90.0))))


def test_packets_are_those_of_the_makers_protocol() -> None:
    """YDLidar-SDK-Communication-Protocol.md of YDLIDAR/YDLidar-SDK: the example of a packet without intensity."""
    published = bytes.fromhex("AA 55 01 01 53 AE 53 AE AB 54 00 00")
    degrees = (0xAE53 >> 1) / 64.0
    assert packet(1, degrees, degrees, np.zeros(1)) == published
    decoder = YdlidarDecoder(MODELS["x2"])
    assert decoder.feed(published) == []
    assert decoder.faults == 0
    for at in range(len(published) - 2):
        damaged = bytearray(published)
        damaged[at] ^= 0x10
        decoder = YdlidarDecoder(MODELS["x2"])
        decoder.feed(bytes(damaged) + published * 8)
        assert decoder.faults, at


def test_angles_are_corrected_as_in_the_makers_example() -> None:
    """The same document: 40 samples from 0x6FE5 to 0x79BD, of which the first is at 1 m and the last at 8 m."""
    assert corrections(np.array([1000.0, 8000.0, 0.0])) == pytest.approx([-6.7622, -7.8374, 0.0], abs=1e-4)
    first, last = (0x6FE5 >> 1) / 64.0, (0x79BD >> 1) / 64.0
    assert (first, last) == (pytest.approx(223.78, abs=0.01), pytest.approx(243.47, abs=0.01))
    samples = np.full(40, 4000.0)
    samples[-1] = 32000.0
    ring = packet(RING, 223.0, 223.0, np.zeros(1))
    rest = packet(0, 243.5, 223.0, np.zeros(40))
    data = ring + packet(0, first, last, samples) + rest + ring
    ((scan, *_),) = YdlidarDecoder(MODELS["x2"]).feed(data)
    there = np.isfinite(scan.ranges)
    clockwise = -np.degrees(scan.angles)[there] % 360.0
    # a beam is a degree wide
    assert clockwise[scan.ranges[there] == 1.0].min() == pytest.approx(217.0178, abs=0.5)
    assert clockwise[scan.ranges[there] == 8.0] == pytest.approx(235.6326, abs=0.5)


@models
def test_another_reader_sees_the_room_and_so_do_we(model: Model) -> None:
    drivers = pytest.importorskip("lds2d.drivers.ydlidar", reason="lds2d")
    decoder, data = sent(model, 3)

    class Line:
        def read(self, size: int) -> bytes:
            nonlocal data
            if not data:
                raise EOFError
            chunk, data = data[:size], data[size:]
            return chunk

    found = decoder.feed(data)
    reader, points = getattr(drivers, OTHERS[model])(Line()), []
    with pytest.raises(EOFError):
        for point in reader.points():
            points.append(point)
    assert len(points) == 3 * MODELS[model].rate / 10.0
    # its correction is cut to 1/64 degree; beams of half a degree differ by 6 mm
    assert right([each.dist_mm / 1000.0 for each in points], [-each.angle_deg for each in points]) < 0.03
    for scan, *_ in found:
        assert right(scan.ranges, np.degrees(scan.angles)) < 0.03


@models
@pytest.mark.parametrize("tells", [True, False])
def test_a_turn_is_as_old_as_it_is_long(model: Model, tells: bool) -> None:
    device, decoder, line = begun(model)
    device = VirtualYdlidar(model, tells)
    device.scans = True
    device.connected(line)
    for k in range(3):
        device.show(Reading(0.1 * k, SCAN))
    found: list[Measured[Scan]] = decoder.feed(line.sent)
    assert len(found) == 2
    for scan, time, age in found:
        assert (time, age, scan.scan_time) == (None, pytest.approx(0.1), pytest.approx(0.1))
        assert scan.angle_step < 0.0
        assert scan.range_max == MODELS[model].range_max


@models
def test_a_wall_to_the_left_is_seen_to_the_left(model: Model) -> None:
    ranges = np.full(720, inf, np.float32)
    ranges[360 + 180 - 4 : 360 + 180 + 5] = 1.0
    decoder, data = sent(model, 2, Scan(-pi, tau / 720, 0.1 / 720, ranges, 0.02, 12.0))
    (scan, *_), *_ = decoder.feed(data)
    x, y = np.mean(scan.points, axis=0) - (scan.mount.x, scan.mount.y)
    assert (x, y) == (pytest.approx(0.0, abs=0.04), pytest.approx(1.0, abs=0.04))


def test_an_x2_is_sent_nothing_and_the_others_are_stopped_first() -> None:
    silent = YdlidarDecoder(MODELS["x2"])
    assert (silent.to_send(), silent.greets, silent.pause, silent.farewell) == (b"", False, None, b"")
    for model in ("x4", "tg30"):
        decoder = YdlidarDecoder(MODELS[model])
        assert (decoder.to_send(), decoder.greets, decoder.farewell) == (STOP_COMMAND, True, STOP_COMMAND)
        assert decoder.pause == pytest.approx(0.1)
        decoder.resume()
        assert (decoder.to_send(), decoder.pause) == (SCAN_COMMAND, inf)


@models
def test_it_does_not_matter_where_the_packets_are_torn(model: Model) -> None:
    whole, data = sent(model, 3)
    torn, _ = sent(model, 0)
    expected = whole.feed(data)
    found = [each for at in range(0, len(data), 7) for each in torn.feed(data[at : at + 7])]
    assert len(found) == len(expected) == 2
    assert (whole.faults, torn.faults) == (0, 0)
    for one, other in zip(found, expected, strict=True):
        assert np.array_equal(one.value.ranges, other.value.ranges, equal_nan=True)


@models
def test_a_damaged_packet_makes_no_wrong_range(model: Model) -> None:
    rng = np.random.default_rng(1)
    decoder, whole = sent(model, 12)
    data = bytearray(whole)
    for at in rng.integers(0, len(data), 12):
        data[at] ^= 1 << int(rng.integers(8))
    found = decoder.feed(bytes(data))
    assert len(found) >= 7
    assert decoder.faults > 0
    for scan, *_ in found:
        assert right(np.where(np.isinf(scan.ranges), nan, scan.ranges), np.degrees(scan.angles)) < 0.03


def test_two_turns_whose_border_was_lost_are_not_one() -> None:
    decoder, data = sent("x4", 4)
    ring = packet(RING | 10 * 10 << 1, 0.0, 0.0, np.frombuffer(data[17:19], "<u2").astype(float))
    borders = [at for at in range(len(data)) if data.startswith(ring, at)]
    assert len(borders) == 4
    found = decoder.feed(data[: borders[1]] + data[borders[1] + len(ring) :])
    assert (len(found), decoder.faults) == (1, 1)


def test_a_model_has_to_be_named() -> None:
    with pytest.raises(ConfigError, match=r"sensors\.yd_unnamed\.options.*model"):
        DRIVERS.make("driver", "laser_ydlidar", Setup("yd_unnamed", {}, load().config))
    with pytest.raises(ConfigError, match=r"sensors\.yd_wrong\.options\.model"):
        DRIVERS.make("driver", "laser_ydlidar", Setup("yd_wrong", {"model": "x9"}, load().config))
