"""An RPLIDAR: the vendor's published bytes, the vendor's own SDK and another reader judge what is sent and read."""

from __future__ import annotations

import asyncio
import json
import os
import struct
import sys
from collections.abc import Callable
from math import inf, nan, pi, tau
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigs.memory_line import MemoryLine
from tests.patience import LIMIT
from txt1.config import load
from txt1.errors import HalError
from txt1.link.device import DevicePort
from txt1.link.pty import listen_pty
from txt1.sensors import laser_rplidar as wire
from txt1.sensors.base import Reading, Setup
from txt1.sensors.laser_rplidar import RplidarDecoder, announce, command
from txt1.sensors.readings import Scan
from txt1.sensors.registry import DRIVERS
from txt1.sensors.stream import Measured
from txt1.sensors.virtual_rplidar import A1, A3, S2, RplidarModel, VirtualRplidar, nodes

DEGREES = np.arange(720) * 0.5 - 180.0
# a wall that comes nearer to the left and goes away to the right: a mirrored scan differs by metres
ROOM = (4.0 - DEGREES / 90.0).astype(np.float32)
SCAN = Scan(-pi, tau / 720, 0.1 / 720, ROOM, 0.02, 12.0)
# the SDK holds Python's lock while it waits, so it runs in an interpreter of its own
VENDOR = """
import json, sys
from pyrplidarsdk import RplidarDriver
driver = RplidarDriver(port=sys.argv[1], baudrate=115200)
assert driver.connect()
info, health = driver.get_device_info(), driver.get_health()
assert driver.start_scan()
for _ in range(60):
    # a busy computer's line loses bytes, and two turns become one
    scan = driver.get_scan_data()
    if scan and len(scan[0]) == int(sys.argv[2]):
        break
driver.stop_scan()
driver.disconnect()
angles, ranges, _ = scan
print(json.dumps([info.model, health.status, angles, ranges]))
"""


def talk(device: VirtualRplidar, decoder: RplidarDecoder, turns: int = 3, pauses: int = 20) -> list[Measured[Scan]]:
    """The turns that a decoder reads of a device, both in memory; pauses end at once when nothing is under way."""
    line = MemoryLine()
    device.connected(line)
    for _ in range(pauses):
        device.received(decoder.to_send())
        sent, line.sent = line.sent, b""
        assert decoder.feed(sent) == []
        if not sent and decoder.pause is not None and decoder.pause < inf:
            decoder.pause = None
            decoder.resume()
    found = []
    for k in range(turns):
        device.show(Reading(0.1 * k, SCAN))
        sent, line.sent = line.sent, b""
        found += decoder.feed(sent)
    return found


def right(ranges: Any, degrees: Any) -> float:
    """The largest error of ranges (m) seen at angles to the left (degrees), away from the seam behind the robot."""
    degrees = (np.asarray(degrees) + 180.0) % 360.0 - 180.0
    there = abs(degrees) < 175.0
    return float(np.nanmax(abs(np.asarray(ranges)[there] - (4.0 - degrees[there] / 90.0))))


def test_commands_and_announcements_are_those_of_the_makers_protocol() -> None:
    """The bytes are in Slamtec's "Interface Protocol and Application Notes" (LR001) and its SDK."""
    assert command(wire.STOP) == bytes.fromhex("A525")
    assert command(wire.EXPRESS, bytes(5)) == bytes.fromhex("A5 82 05 00 00 00 00 00 22")
    assert command(wire.MOTOR_PWM, struct.pack("<H", 660)) == bytes.fromhex("A5 F0 02 94 02 C1")
    assert announce(wire.INFO_TOLD, 20) == bytes.fromhex("A5 5A 14 00 00 00 04")
    assert announce(wire.HEALTH_TOLD, 3) == bytes.fromhex("A5 5A 03 00 00 00 06")
    assert announce(wire.STANDARD, 5, many=True) == bytes.fromhex("A5 5A 05 00 00 40 81")
    assert announce(wire.CAPSULE, 84, many=True) == bytes.fromhex("A5 5A 54 00 00 40 82")


@pytest.mark.waits
@pytest.mark.parametrize("kind", [A1, A3, S2], ids=["express", "ultra", "dense"])
async def test_slamtecs_own_sdk_sees_the_room_and_so_do_we(kind: RplidarModel, tmp_path: Path) -> None:
    pytest.importorskip("pyrplidarsdk")
    device = VirtualRplidar(kind)
    listener = listen_pty(str(tmp_path / "laser"), device)
    try:
        path = os.path.realpath(tmp_path / "laser")
        pipe = asyncio.subprocess.PIPE
        words = (sys.executable, "-c", VENDOR, path, str(kind.samples))
        client = await asyncio.create_subprocess_exec(*words, stdout=pipe, stderr=pipe)
        ended = asyncio.ensure_future(client.communicate())
        ends = asyncio.get_running_loop().time() + LIMIT
        while not ended.done() and asyncio.get_running_loop().time() < ends:
            await asyncio.sleep(0.1)
            device.show(Reading(0.0, SCAN))
        out, told = await ended
    finally:
        listener.close()
    assert client.returncode == 0, told
    model, health, angles, ranges = json.loads(out)
    assert (model, health, len(angles)) == (kind.model, 0, kind.samples)
    # its angles are clockwise; nearest beams of half a degree differ by 6 mm
    assert right(ranges, -np.degrees(angles)) < 0.03
    found = talk(VirtualRplidar(kind), RplidarDecoder())
    assert right(found[-1].value.ranges, np.degrees(found[-1].value.angles)) < 0.03


def test_another_reader_understands_a_standard_sample_as_we_do() -> None:
    sample = pytest.importorskip("rplidar", reason="rplidar-roboticia")
    read = vars(sample)["_process_scan"]
    data = nodes(SCAN)
    seen = [read(data[at : at + 5]) for at in range(0, len(data), 5)]
    assert [new for new, *_ in seen] == [True] + [False] * 199
    assert right([mm / 1000.0 for *_, mm in seen], [-angle for *_, angle, _ in seen]) < 0.03
    found = talk(VirtualRplidar(A1, firmware=(1, 20)), RplidarDecoder())
    ((scan, _, age),) = found[-1:]
    assert right(scan.ranges, np.degrees(scan.angles)) < 0.03
    assert age == pytest.approx(0.1)
    # 200 samples leave beams of a degree empty, which are not free
    assert np.isnan(scan.ranges).sum() == 160


@pytest.mark.parametrize("kind", [A1, A3, S2], ids=["express", "ultra", "dense"])
def test_a_turn_is_as_old_as_its_samples_took(kind: RplidarModel) -> None:
    found = talk(VirtualRplidar(kind), RplidarDecoder())
    assert len(found) == 1
    scan, time, age = found[0]
    assert time is None
    assert scan.scan_time == pytest.approx(0.1, rel=0.01)
    assert 0.1 < age < 0.12
    assert scan.angle_step < 0.0
    assert scan.range_max == kind.reach


def test_a_wall_to_the_left_is_seen_to_the_left() -> None:
    ranges = np.full(720, inf, np.float32)
    ranges[360 + 180 - 2 : 360 + 180 + 3] = 1.0
    left = Scan(-pi, tau / 720, 0.1 / 720, ranges, 0.02, 12.0)
    for kind in (A1, A3, S2):
        device, decoder = VirtualRplidar(kind), RplidarDecoder()
        talk(device, decoder, turns=0)
        line = MemoryLine()
        device.connected(line)
        for _ in range(3):
            device.show(Reading(0.0, left))
        (scan, *_), *_ = decoder.feed(line.sent)
        x, y = np.mean(scan.points, axis=0) - (scan.mount.x, scan.mount.y)
        assert (x, y) == (pytest.approx(0.0, abs=0.03), pytest.approx(1.0, abs=0.03)), kind


def test_a_scanner_that_still_scans_is_stopped_and_quiet_before_it_is_asked() -> None:
    decoder = RplidarDecoder()
    assert decoder.to_send() == command(wire.STOP)
    assert decoder.pause == pytest.approx(0.1)
    # what an earlier host has asked for is still under way, and is no answer to this one
    assert decoder.feed(nodes(SCAN) + announce(wire.INFO_TOLD, 20) + bytes(20)) == []
    assert (decoder.to_send(), decoder.model) == (b"", 0)
    decoder.resume()
    assert decoder.to_send() == command(wire.INFO)


def test_a_faulty_scanner_is_reset_once_and_then_says_what_is_wrong() -> None:
    assert len(talk(VirtualRplidar(A1, ill=1), RplidarDecoder(), pauses=40)) == 1
    with pytest.raises(HalError, match=r"health 2, error 7.*not even after a reset: switch it off"):
        talk(VirtualRplidar(A1, ill=2), RplidarDecoder(), pauses=40)


@pytest.mark.parametrize("kind", [A3, S2], ids=["PWM", "speed"])
def test_a_motor_is_started_by_its_models_command_and_stopped_at_the_end(kind: RplidarModel) -> None:
    device, decoder = VirtualRplidar(kind), RplidarDecoder()
    assert not device.turns
    talk(device, decoder)
    assert device.turns
    device.received(decoder.farewell)
    assert not device.turns


def test_a_scanner_is_called_at_the_rates_of_all_models_and_then_at_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    called = []

    class Silent(DevicePort):
        def __init__(self, address: str, baud: Callable[[], int], **_: Any) -> None:
            super().__init__(address, baud)
            called.append(baud)

    monkeypatch.setattr(wire, "DevicePort", Silent)
    made = []
    monkeypatch.setattr(wire, "RplidarDecoder", lambda mount, known: made.append(known) or RplidarDecoder(mount))
    sensor = DRIVERS.make("driver", "laser_rplidar", Setup("rates", {"baud": 256000}, load().config))
    (rate,), ladder = called, sensor.ladder
    seen = []
    for ladder.connections in range(5):
        seen.append(rate())
    assert seen == [256000, 115200, 460800, 1000000, 256000]
    sensor.port.rate = 1000000
    made[-1]()
    assert rate() == 1000000


async def test_the_line_dtr_is_held_down_while_an_a1_turns(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    lines: list[bool] = []
    monkeypatch.setattr(
        "serial.serialposix.Serial._update_dtr_state", lambda serial: lines.append(bool(vars(serial)["_dtr_state"]))
    )
    listener = listen_pty(str(tmp_path / "laser"), VirtualRplidar(A1))
    try:
        sensor = DRIVERS.make(
            "driver", "laser_rplidar", Setup("held", {"port": str(tmp_path / "laser")}, load().config)
        )
        await sensor.open()
        assert set(lines) == {False}
        await sensor.close()
        assert lines[-1]
    finally:
        listener.close()


def test_it_does_not_matter_where_the_answers_are_torn() -> None:
    device, line = VirtualRplidar(A1), MemoryLine()
    whole, torn = RplidarDecoder(), RplidarDecoder()
    talk(device, whole, turns=0)
    talk(VirtualRplidar(A1), torn, turns=0)
    device.connected(line)
    for _ in range(4):
        device.show(Reading(0.0, SCAN))
    expected = whole.feed(line.sent)
    found = [each for at in range(len(line.sent)) for each in torn.feed(line.sent[at : at + 1])]
    assert len(found) == len(expected) == 2
    for one, other in zip(found, expected, strict=True):
        assert np.array_equal(one.value.ranges, other.value.ranges, equal_nan=True)


@pytest.mark.parametrize("kind", [A1, A3, S2], ids=["express", "ultra", "dense"])
def test_a_damaged_packet_makes_no_wrong_range(kind: RplidarModel) -> None:
    rng = np.random.default_rng(1)
    device, decoder, line = VirtualRplidar(kind), RplidarDecoder(), MemoryLine()
    talk(device, decoder, turns=0)
    device.connected(line)
    for _ in range(10):
        device.show(Reading(0.0, SCAN))
    sent = bytearray(line.sent)
    for at in rng.integers(0, len(sent), 20):
        sent[at] ^= 1 << int(rng.integers(8))
    found = decoder.feed(bytes(sent))
    assert len(found) >= 8
    assert decoder.faults > 0
    for scan, *_ in found:
        assert right(np.where(np.isinf(scan.ranges), nan, scan.ranges), np.degrees(scan.angles)) < 0.03


def test_samples_that_were_lost_are_unknown_and_not_free() -> None:
    device, decoder, line = VirtualRplidar(S2), RplidarDecoder(), MemoryLine()
    talk(device, decoder, turns=0)
    device.connected(line)
    for _ in range(3):
        device.show(Reading(0.0, SCAN))
    # a turn is 80 packets of 84 bytes
    sent = line.sent[: 84 * 100] + line.sent[84 * 110 :]
    found = decoder.feed(sent)
    assert np.isnan(found[0].value.ranges).sum() >= 80
    assert not np.isinf(found[0].value.ranges).any()
    assert right(found[0].value.ranges, np.degrees(found[0].value.angles)) < 0.03
